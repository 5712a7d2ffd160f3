"""What a whole robot's model left out: effects at places, one by one, while they gain.

The likelihood, the fits and what a gain must be divided by are those of one joint. An effect is
taken when it gains enough on what it is fitted to and, where there are several groups of
recordings, on those left out. Then exactly that robot is replayed, and the search goes on from
there; in the end effects are dropped again without which the rest does as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from .fit import Fit, fit
from .model import Hypothesis
from .noise import Noise, cost
from .robot_features import RobotKind
from .robot_model import RobotModel
from .robot_screen import ALIKE, Screen, Screened
from .search import HELD_OUT, NEEDED, inflation

if TYPE_CHECKING:
    from .model import JointModel

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

CONFIRMED = 8  #: effects of a screening that are fitted
A_KIND = 2  #: of them at most so many places of one effect
MOST = 3  #: effects that are taken
CLOSE = 4.0  #: gain [nats, deflated] within which another effect would have done as well
TRIED = (0.3, 1.0, 3.0, 8.0)  #: in first tries, where fits start


@dataclass(frozen=True, slots=True, eq=False)
class RobotGain:
    """What an effect at a place gains over a hypothesis without it."""

    name: str
    fit: Fit
    nats: float
    inflation: float
    held_out: float | None  #: [nats]; ``None`` where all recordings are of one group

    @property
    def deflated(self) -> float:
        """The gain that counts [nats]."""
        return self.nats / self.inflation


@dataclass(frozen=True, slots=True, eq=False)
class RobotFindings:
    """What came of a search. ``taken``: in order; ``tried``: all that were fitted, by step.

    ``alike``: for each effect taken, those this data cannot tell from it, with the cosine of their
    traces (1 where only their gains are close). ``screened`` is the first screening, with what
    could be seen at all. RMS [rad] of the joint rows: as believed, with nuisances, at the end.
    """

    base: Fit
    fit: Fit
    taken: tuple[RobotGain, ...]
    tried: tuple[tuple[RobotGain, ...], ...]
    alike: Mapping[str, tuple[tuple[str, float], ...]]
    screened: tuple[Screened, ...]
    rms_rad: tuple[float, float, float]
    off_rad: float  #: how far the curves were from a replay of the final robot

    @property
    def names(self) -> tuple[str, ...]:
        """Effects taken, sorted."""
        return tuple(sorted(gain.name for gain in self.taken))


class RobotSearch:
    """A search on some recordings of a model, with some kinds of channels."""

    def __init__(
        self,
        model: RobotModel,
        which: Sequence[int] | None = None,
        kinds: Iterable[RobotKind] = tuple(RobotKind),
        say: Progress = lambda _: None,
    ) -> None:
        self.model, self._say = model, say
        self.which = list(range(len(model.features)) if which is None else which)
        self._view = _View(model, frozenset(kinds), tuple(self.which))
        self._kinds = tuple(kinds)

    def run(self, names: Iterable[str] | None = None, most: int = MOST) -> RobotFindings:
        """Search among placed effects; all, and legs only where legs stand out, if None."""
        model = self.model
        model.recentre([])
        base = self._fit(Hypothesis(), np.zeros(len(model.nuisances)))
        first = self.screen(base)
        wanted = list(names) if names is not None else self._worth_looking(first)
        self._say(f"replaying {len(wanted)} effects")
        ranking = first.rank(wanted)
        screened = tuple(ranking)
        now, taken, tried, alike = base, [], [], {}
        off = 0.0
        for step in range(most):
            gains = self._step(now, ranking, step)
            tried.append(tuple(gains))
            chosen = next((g for g in gains[:2] if self._holds(g)), None)
            if chosen is None:
                break
            alike[chosen.name] = self._alike(first, chosen, gains, wanted)
            now = chosen.fit
            for _ in range(2):
                off = model.recentre(model.settings(now.hypothesis, now.z[self._count :]))
                now = self._fit(now.hypothesis, now.z, now.noise)
            taken.append(chosen)
            if step + 1 < most:
                ranking = self.screen(now).rank(
                    n for n in wanted if n not in now.hypothesis.effects
                )
        now, taken = self._prune(now, taken)
        rms = tuple(
            self._rms(h, z)
            for h, z in (
                (Hypothesis(), np.zeros(self._count)),
                (Hypothesis(), base.z),
                (now.hypothesis, now.z),
            )
        )
        return RobotFindings(
            base, now, tuple(taken), tuple(tried), alike, screened, cast(Any, rms), off
        )

    @property
    def _count(self) -> int:
        return len(self.model.nuisances)

    def _fit(
        self, hypothesis: Hypothesis, z: Floats, noise: Mapping[Any, Noise] | None = None
    ) -> Fit:
        return fit(self._view.joint, hypothesis, z, noise, which=self.which)

    def screen(self, now: Fit) -> Screen:
        """A screening of what a fit leaves."""
        settings = self.model.settings(now.hypothesis, now.z[self._count :])
        left = [
            {
                kind: self.model.recorded(r, kind) - rows
                for kind, rows in self.model.modelled(settings, r).items()
            }
            for r in range(len(self.model.features))
        ]
        noise = cast(dict[RobotKind, Noise], dict(now.noise))
        there = [kind for kind in self._kinds if kind in noise]
        return Screen(self.model, noise, left, there, self.which, tuple(now.hypothesis.effects))

    def _worth_looking(self, screen: Screen) -> list[str]:
        legs = {leg.name for leg in self.model.base.legs}
        worst = set(screen.standing_out())
        names = []
        for name in self.model.placed:
            place = name.partition("@")[2]
            if place not in legs or place in worst:
                names.append(name)
        return names

    def _step(self, now: Fit, ranking: Sequence[Screened], step: int) -> list[RobotGain]:
        gains: list[RobotGain] = []
        count: dict[str, int] = {}
        for one in ranking:
            kind = one.name.partition("@")[0]
            if one.gain_nats <= 0.0 or count.get(kind, 0) >= A_KIND or len(gains) == CONFIRMED:
                continue
            count[kind] = count.get(kind, 0) + 1
            self._say(f"step {step + 1}: fitting {one.name}")
            gains.append(self._confirm(now, one))
        return sorted(gains, key=lambda g: -g.deflated)

    def _confirm(self, now: Fit, one: Screened) -> RobotGain:
        placed = self.model.placed[one.name]
        hypothesis = Hypothesis((*now.hypothesis.knobs, placed.knob))
        low, high = placed.knob.bounds
        sign = -1.0 if one.z < 0.0 else 1.0
        starts = {float(np.clip(sign * placed.first_z * x, low, high)) for x in TRIED}
        vectors = [np.append(now.z, z) for z in sorted(starts)]
        found = self._view.joint.residuals(hypothesis, vectors, self.which)
        best = int(
            np.argmin(
                [sum(cost(b, now.noise[k[1]]) for k, b in blocks.items()) for blocks in found]
            )
        )
        fitted = self._fit(hypothesis, vectors[best], now.noise)
        wide = inflation(self._view.joint, fitted, [len(fitted.z) - 1])
        return RobotGain(one.name, fitted, now.cost - fitted.cost, wide, self._outside(now, fitted))

    def _outside(self, without: Fit, with_it: Fit) -> float | None:
        """Gain [nats] on groups left out in turn, both fitted anew without them."""
        groups: dict[str, list[int]] = {}
        for r in self.which:
            groups.setdefault(self.model.observed[r].group, []).append(r)
        if len(groups) < 2:
            return None
        total = 0.0
        for part in groups.values():
            rest = [r for r in self.which if r not in part]
            costs = []
            for found in (without, with_it):
                again = fit(self._view.joint, found.hypothesis, found.z, found.noise, rest, 1, 4)
                (blocks,) = self._view.joint.residuals(found.hypothesis, [again.z], part)
                costs.append(sum(cost(b, again.noise[k[1]]) for k, b in blocks.items()))
            total += costs[0] - costs[1]
        return total

    @staticmethod
    def _holds(gain: RobotGain) -> bool:
        outside = gain.held_out is None or gain.held_out / gain.inflation > HELD_OUT
        return gain.deflated >= NEEDED and outside

    def _alike(
        self, screen: Screen, chosen: RobotGain, gains: Sequence[RobotGain], names: Sequence[str]
    ) -> tuple[tuple[str, float], ...]:
        found = dict(screen.alike(chosen.name, names))
        for gain in gains:
            if gain.name != chosen.name and chosen.deflated - gain.deflated < CLOSE:
                found.setdefault(gain.name, 1.0)
        return tuple(sorted(found.items(), key=lambda pair: -abs(pair[1])))

    def _prune(self, now: Fit, taken: list[RobotGain]) -> tuple[Fit, list[RobotGain]]:
        while len(taken) > 1:
            losses = []
            for gain in taken:
                keep = [k.effect != gain.name for k in now.hypothesis.knobs]
                start = np.concatenate([now.z[: self._count], now.z[self._count :][keep]])
                without = self._fit(now.hypothesis.without(gain.name), start, now.noise)
                k = self._count + keep.index(False)
                wide = inflation(self._view.joint, now, [k])
                losses.append(((without.cost - now.cost) / wide, gain, without))
            loss, gain, without = min(losses, key=lambda entry: entry[0])
            if loss >= NEEDED:
                break
            now, taken = without, [g for g in taken if g is not gain]
        return now, taken

    def _rms(self, hypothesis: Hypothesis, z: Floats) -> float:
        (blocks,) = self.model.residuals(hypothesis, [z], self.which)
        rows = [b.value for k, b in blocks.items() if k[1] is RobotKind.JOINTS]
        return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


class _View:
    """A robot's model as the fits of one joint see it: some recordings, some kinds."""

    def __init__(
        self, model: RobotModel, kinds: frozenset[RobotKind], which: tuple[int, ...]
    ) -> None:
        self._model, self._kinds, self._which = model, kinds, which
        self.nuisances, self.observed = model.nuisances, model.observed
        self.turns_controller = model.turns_controller

    @property
    def joint(self) -> JointModel:
        """Itself: the fits need no more of a model than is here."""
        return cast("JointModel", self)

    def floors(self) -> Mapping[RobotKind, float]:
        """See :class:`RobotModel`."""
        return {k: v for k, v in self._model.floors().items() if k in self._kinds}

    def residuals(
        self,
        hypothesis: Hypothesis,
        vectors: Sequence[Floats],
        which: Sequence[int] | None = None,
        kinds: Sequence[object] = (),
    ) -> list[dict[tuple[int, RobotKind], Any]]:
        """See :class:`RobotModel`."""
        chosen = self._which if which is None else which
        found = self._model.residuals(hypothesis, vectors, chosen)
        return [{k: b for k, b in blocks.items() if k[1] in self._kinds} for blocks in found]


def indistinguishable(screen: Screen, names: Sequence[str]) -> list[tuple[str, str, float]]:
    """Pairs of effects that data cannot tell apart, with the cosine, the most alike first."""
    pairs = [(a, b, screen.cosine(a, b)) for i, a in enumerate(names) for b in names[i + 1 :]]
    return sorted((p for p in pairs if abs(p[2]) > ALIKE), key=lambda p: -abs(p[2]))
