"""What a whole robot's model left out: effects at places, one by one, while they gain.

The likelihood, the fits and what a gain must be divided by are those of one joint. An effect is
taken when it gains enough on what it is fitted to and, where there are several groups of
recordings, on those left out. Then exactly that robot is replayed, and the search goes on from
there; in the end effects are dropped again without which the rest does as well.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .noise import Noise
from .robot_features import MEANS, RobotKind
from .robot_fit import ENOUGH, RobotFit, Sight
from .robot_gains import RobotFindings, RobotGain, levelled
from .robot_improved import of_settings
from .robot_judging import judge, rmse_rad
from .robot_model import RobotModel
from .robot_screen import Screen, Screened, stretched, worth_fitting
from .watch import OutOfTimeError

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

NEEDED = 7.0  #: gain [nats, deflated] of an effect to be taken
BESIDE = 15.0  #: the same of an effect beside others: what those leave unexplained it may take up
HELD_OUT = 1.5  #: gain [nats, deflated] it must have on groups of recordings left out
MOST = 3  #: effects that are taken
CLOSE = 4.0  #: gain [nats, deflated] within which another effect would have done as well
AT_END = 0.99  #: share of what a tolerance may be, from which it is at its end
WORSE = 1.5  #: times the mean square of a whole recording that no effect may make of it
WIDENED = 3  #: times at most that a curve is made longer for a fit
KEPT = 0.8  #: of a promised gain that an exact replay must bear out for curves to be believed
PART = 0.3  #: of the way that a fit would go, where the whole of it leads to worse
SETTLED = 3  #: times at most that exact replays and a fit take turns
REFINED = 2  #: times at most that what nuisances do is taken anew where a fit has led
WORTH = 5.0  #: gain [nats] of the first of them from which there is another
BEST = 2  #: effects of a step that are refined before one is chosen
TRIED = (0.3, 1.0, 3.0, 8.0)  #: in first tries, where fits start
#: what is looked for from a large try whatever curves promise, and where: a little of a spring, and
#: much of it, are two valleys
SPRINGS = frozenset(
    f"joint_compliance@{where}" for where in ("all", "femur", "tibia", "femur+tibia")
)
FAR_FITS = 2  #: exact replays and fits in turns before such a spring is judged


class RobotSearch:
    """A search on some recordings of a model, with some kinds of channels."""

    def __init__(
        self,
        model: RobotModel,
        which: Sequence[int] | None = None,
        kinds: Iterable[RobotKind] = MEANS,
        say: Progress = lambda _: None,
    ) -> None:
        self.model, self._say = model, say
        self.which = list(range(len(model.features)) if which is None else which)
        self.sight = Sight(model, self.which, kinds)

    def run(
        self,
        names: Iterable[str] | None = None,
        most: int = MOST,
        without: Collection[str] = (),
        base: RobotFit | None = None,
        enough: Callable[[RobotFit], bool] = lambda _: False,
    ) -> RobotFindings:
        """Search among placed effects; all, and legs only where legs stand out, if None.

        ``without`` are effects of the catalogue that are left out, ``base`` is what the operator
        believes if that was fitted already. Where a fit is ``enough``, no further one is sought.
        """
        model = self.model
        base = base or self.believed()
        self._around(base)
        first = self.screen(base)
        wanted = list(names) if names is not None else self._worth_looking(first)
        wanted = [name for name in wanted if model.placed[name].effect.name not in without]
        self._say(f"replaying {len(wanted)} effects")
        ranking = first.rank(wanted)
        screened = tuple(ranking)
        now, taken, tried, alike = base, [], [], {}
        try:
            for step in range(most):
                named = stretched(model.nuisances, now.nuisances)
                gains = self._step(worth_fitting(ranking, named), now, step)
                gains = self._with_springs(gains, now, SPRINGS.intersection(wanted))
                chosen = self._that_holds(now, gains, named)
                tried.append(tuple(gains))
                if chosen is None:
                    break
                alike[chosen.name] = self._alike(first, chosen, gains, wanted)
                now = chosen.fit
                taken.append(chosen)
                if enough(now):
                    break
                if step + 1 < most:
                    ranking = self.screen(now).rank(n for n in wanted if n not in now.names)
        except OutOfTimeError:
            self._around(now)  # what was taken until then is told
        pruned, taken = self._prune(now, taken)
        now = now if pruned is now else self.settle(pruned)
        return RobotFindings(
            base, now, tuple(taken), tuple(tried), alike, screened, self._rms(base), self._rms(now)
        )

    def believed(self) -> RobotFit:
        """What the operator believes, with all that is never exactly so."""
        self._say("fitting what the operator believes")
        return self.refined(self.settle(self.sight.fit()))

    def nothing(self, base: RobotFit) -> RobotFindings:
        """That what the operator believes is all there is to say."""
        rms = self._rms(base)
        return RobotFindings(base, base, (), (), {}, (), rms, rms)

    def settle(self, found: RobotFit, begun: RobotFit | None = None) -> RobotFit:
        """A fit whose replays are exact where it is: traces and curves only lead there.

        Where they lead to worse than there was (``begun`` at first), it goes a part of that way.
        """
        best = begun
        for _ in range(SETTLED):
            exact = self._replayed(found)
            if best is not None and exact.cost > best.cost - ENOUGH:
                exact = self._replayed(replace(found, z=best.z + PART * (found.z - best.z)))
                if exact.cost > best.cost - ENOUGH:
                    break
            best = exact
            found = self._fit(exact.names, exact.z, exact.noise)
        assert best is not None
        self.model.recentre(best.settings, best.nuisances, self.which)
        return best

    def refined(self, settled: RobotFit) -> RobotFit:
        """A settled fit that goes on with what nuisances do there, which is where that is left."""
        for _ in range(REFINED):
            before = settled.cost
            self.model.retrace(settled.settings, settled.nuisances)
            further = self._fit(settled.names, settled.z, settled.noise)
            settled = self.settle(further, settled)
            if settled.cost > before - WORTH:
                break
        return settled

    def _around(self, found: RobotFit) -> None:
        """Let the model be exact at a fit, and know what nuisances do there."""
        self.model.retrace(found.settings, found.nuisances)
        self.model.recentre(found.settings, found.nuisances, self.which)

    def _replayed(self, found: RobotFit) -> RobotFit:
        self.model.recentre(found.settings, found.nuisances, self.which)
        return self.sight.at(found)

    def _fit(
        self, names: Sequence[str], start: Floats, noise: Mapping[RobotKind, Noise]
    ) -> RobotFit:
        """A fit whose knobs are not at the ends of their curves, which are made longer."""
        found = self.sight.fit(names, start, noise)
        for _ in range(WIDENED):
            longer = [name for name, z in found.settings if self.model.curves.widen(name, z)]
            if not longer:
                break
            found = self.sight.fit(names, found.z, found.noise)
        return found

    def _that_holds(
        self, now: RobotFit, gains: list[RobotGain], named: Collection[str]
    ) -> RobotGain | None:
        """The gain that exact replays bear out best; those take their places among the gains.

        What stands for a tolerance at its end (``named``) is replayed whatever curves promise;
        what they promise is counted in full here.
        """
        plain, begun = self._left_out(now), self._whole_square(now)
        for k, gain in enumerate(gains):
            if gain.nats < NEEDED and gain.name not in named:
                continue
            self._say(f"replaying {gain.name} exactly")
            self.model.recentre(now.settings, now.nuisances, self.which)
            with self.model.following():
                exact = self._exactly(gain, now)
            gains[k] = self._with(gain, now, self._replayed(exact), plain)
        best = sorted(range(len(gains)), key=lambda k: -gains[k].deflated)[:BEST]
        for k in best:
            if gains[k].nats >= NEEDED:
                self._say(f"replaying what is ordinary beside {gains[k].name}")
                gains[k] = self._with(gains[k], now, self.refined(gains[k].fit), plain)
        held = [gain for gain in gains if self._stands(gain, now, begun)]
        chosen = max(held, key=lambda gain: gain.deflated, default=None)
        if chosen is not None:
            self._say(f"replaying much of {chosen.name}")
            far = self._with(chosen, now, self._from_far(chosen.fit), plain)
            if far.nats > chosen.nats + ENOUGH and self._stands(far, now, begun):
                gains[next(k for k, gain in enumerate(gains) if gain is chosen)] = far
                chosen = far
        gains.sort(key=lambda gain: -gain.deflated)
        fit = now if chosen is None else chosen.fit
        self._around(fit)
        return chosen

    def _with(
        self, gain: RobotGain, now: RobotFit, exact: RobotFit, plain: float | None
    ) -> RobotGain:
        """A gain by exact replays; ``plain`` is what left-out recordings make of ``now``."""
        outside = None if plain is None else plain - (self._left_out(exact) or 0.0)
        return replace(gain, fit=exact, nats=now.cost - exact.cost, held_out=outside)

    def _stands(self, gain: RobotGain, now: RobotFit, begun: float) -> bool:
        """Whether a gain holds, and no whole recording is much worse than ``begun`` [rad^2]."""
        return self._holds(gain, now) and self._whole_square(gain.fit) <= WORSE * begun

    def _exactly(self, gain: RobotGain, now: RobotFit) -> RobotFit:
        """An effect's exact fit: from where curves led, or, if that disappoints, from a large try.

        Curves know an effect with all else as believed. Of what changes a robot much, as a spring
        of a tenth does, they know too little; replayed exactly there, the fit finds the way.
        """
        off = np.append(now.z, 0.0)
        best = self.settle(gain.fit, replace(gain.fit, z=off, noise=now.noise, cost=now.cost))
        if best.cost < gain.fit.cost + (1.0 - KEPT) * gain.nats:
            return best
        return self._from_far(best)

    def _from_far(self, found: RobotFit) -> RobotFit:
        """An exact fit, or that from a large try of its last effect, if that is deeper.

        A spring has two valleys: a little of it, which tolerances of a stiff robot help, and much.
        """
        best = found
        _, *large = self.model.curves.tries(found.names[-1])
        for z in large:
            if found.z[-1] > 0.5 * z:
                continue
            there = replace(found, z=np.append(found.z[:-1], z))
            self.model.recentre(there.settings, there.nuisances, self.which)
            settled = self.settle(self._fit(there.names, there.z, there.noise))
            best = min(best, settled, key=lambda fit: fit.cost)
        return best

    def _whole_square(self, found: RobotFit) -> float:
        """Mean square [rad^2] of a whole recording, standing up as well, which no fit has seen."""
        model = self.model
        added = of_settings(model.placed, found.settings, "fitted")
        return rmse_rad(judge(model, model.robot, found.nuisances, added, self.which[:1])) ** 2

    def screen(self, now: RobotFit) -> Screen:
        """A screening of what a fit leaves, on the recordings of one motion: fits take them all."""
        motion = self.model.motion
        some = [r for r in self.which if motion[r] == motion[self.which[0]]]
        ends = np.array([nuisance.ends for nuisance in self.model.nuisances]).T
        held = (now.nuisances <= AT_END * ends[0]) | (now.nuisances >= AT_END * ends[1])
        at = np.where(held, now.nuisances, 0.0)
        left = [
            {
                kind: self.model.recorded(r, kind) - rows
                for kind, rows in self.model.modelled(now.settings, at, r).items()
            }
            for r in range(len(self.model.features))
        ]
        noise = dict(now.noise)
        return Screen(self.model, noise, left, self.sight.kinds, some, now.names, held)

    def _worth_looking(self, screen: Screen) -> list[str]:
        legs = {leg.name for leg in self.model.base.legs}
        worst = set(screen.standing_out())
        names = []
        for name in self.model.placed:
            place = name.partition("@")[2]
            if place not in legs or place in worst:
                names.append(name)
        return names

    def _step(self, some: Sequence[Screened], now: RobotFit, step: int) -> list[RobotGain]:
        gains: list[RobotGain] = []
        for one in some:
            self._say(f"step {step + 1}: fitting {one.name}")
            gains.append(self._confirm(now, one))
        return levelled(gains)

    def _confirm(self, now: RobotFit, one: Screened) -> RobotGain:
        placed, sight = self.model.placed[one.name], self.sight
        names = (*now.names, one.name)
        low, high = placed.knob.bounds
        first = self.model.curves.first_z(one.name)
        starts = {float(np.clip(side * first * x, low, high)) for x in TRIED for side in (-1, 1)}
        box = sight.box(names)
        wanted = sorted({*starts, one.z} - {0.0})
        vectors = [np.clip(np.append(now.z, z), *box) for z in wanted]
        costs = [sight.cost(sight.blocks(names, z), now.noise) for z in vectors]
        fitted = self._fit(names, vectors[int(np.argmin(costs))], now.noise)
        wide = sight.inflation(fitted, one.name)
        return RobotGain(one.name, fitted, now.cost - fitted.cost, wide, None)

    def _with_springs(
        self, gains: Sequence[RobotGain], now: RobotFit, springs: frozenset[str]
    ) -> list[RobotGain]:
        """Gains, and those of springs that are begun with much of them, where these are larger."""
        best = {gain.name: gain for gain in gains}
        for name in sorted(springs.difference(now.names)):
            self._say(f"looking for much of {name}")
            *_, large = self.model.curves.tries(name)
            at = RobotFit((*now.names, name), np.append(now.z, large), now.noise, now.cost)
            self.model.recentre(now.settings, now.nuisances, self.which)
            with self.model.following():
                for _ in range(FAR_FITS):
                    self.model.recentre(at.settings, at.nuisances, self.which)
                    at = self._fit(at.names, at.z, at.noise)
            at = self._replayed(at)
            nats = now.cost - at.cost
            if nats >= NEEDED and (name not in best or nats > best[name].nats):
                best[name] = RobotGain(name, at, nats, self.sight.inflation(at, name), None)
        self.model.recentre(now.settings, now.nuisances, self.which)
        return levelled(list(best.values()))

    def _left_out(self, found: RobotFit) -> float | None:
        """What groups cost that are left out in turn [nats], fitted anew without them.

        ``None`` where all recordings are of one group.
        """
        groups: dict[str, list[int]] = {}
        for r in self.which:
            groups.setdefault(self.model.observed[r].group, []).append(r)
        if len(groups) < 2:
            return None
        self.model.recentre(found.settings, found.nuisances, self.which)
        total, sight = 0.0, self.sight
        for part in groups.values():
            rest = [r for r in self.which if r not in part]
            again = sight.fit(found.names, found.z, found.noise, rest, rounds=1)
            total += sight.cost(sight.blocks(found.names, again.z, part), found.noise)
        return total

    @staticmethod
    def _holds(gain: RobotGain, now: RobotFit) -> bool:
        outside = gain.held_out is None or gain.held_out / gain.inflation > HELD_OUT
        return gain.deflated >= (BESIDE if now.names else NEEDED) and outside

    def _alike(
        self, screen: Screen, chosen: RobotGain, gains: Sequence[RobotGain], names: Sequence[str]
    ) -> tuple[tuple[str, float], ...]:
        found = dict(screen.alike(chosen.name, names))
        for gain in gains:
            if gain.name != chosen.name and chosen.deflated - gain.deflated < CLOSE:
                found.setdefault(gain.name, 1.0)
        return tuple(sorted(found.items(), key=lambda pair: -abs(pair[1])))

    def _prune(self, now: RobotFit, taken: list[RobotGain]) -> tuple[RobotFit, list[RobotGain]]:
        while len(taken) > 1:
            losses = []
            for gain in taken:
                without = self.sight.without(now, gain.name)
                wide = self.sight.inflation(now, gain.name)
                losses.append(((without.cost - now.cost) / wide, gain, without))
            loss, gain, without = min(losses, key=lambda entry: entry[0])
            if loss >= NEEDED:
                break
            now, taken = without, [g for g in taken if g is not gain]
        return now, taken

    def _rms(self, found: RobotFit) -> float:
        self.model.recentre(found.settings, found.nuisances, self.which)
        blocks = self.model.residuals(found.names, found.z, self.which)
        rows = [b.value for k, b in blocks.items() if k[1] is RobotKind.JOINTS]
        return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
