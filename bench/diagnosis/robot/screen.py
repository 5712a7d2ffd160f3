"""Which effects could explain a whole robot's misfit, and which of them look alike.

Every effect at every place is replayed at a small size and, if it has one sign, at a large one: a
spring that doubles its give does far more than twice as much. Its trace, whitened, with all that
nuisances could do instead taken out, is held against the residual; the angle between two such
traces says whether the data can tell the two apart.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..noise import Noise, huber_weight, whiten
from .curves import Rows
from .features import MEANS, RobotKind
from .model import RobotModel
from .nuisances import RobotNuisance

Floats = NDArray[np.float64]

ALIKE = 0.95  #: cosine beyond which two effects are one class
STANDS_OUT = 1.4  #: times the middle leg's misfit from which a leg is looked at on its own
SEEN = 3.0  #: deviations at which an effect of that size would be seen
CONFIRMED = 6  #: effects of a screening that are fitted
PROMISING = 3.0  #: gain [nats] in the screening of those that are
A_KIND = 2  #: of them at most so many places of one effect
STRETCHED = 0.9  #: of what a tolerance may be, from which its effect is tried by name


@dataclass(frozen=True, slots=True)
class Screened:
    """One effect in the screening.

    ``gain_nats`` is what the linear fit of its knob gains, ``z`` the knob there, ``floor_z`` the
    least ``z`` that would be seen (infinite where the data does not show it at all).
    """

    name: str
    gain_nats: float
    z: float
    floor_z: float


def stretched(every: Sequence[RobotNuisance], z: Floats) -> frozenset[str]:
    """Effects that are a nuisance without its prior, of nuisances that go as far as they may."""
    far = [n for n, x in zip(every, z.tolist(), strict=True) if n.far(x, STRETCHED)]
    return frozenset(name for nuisance in far for name in nuisance.same)


def worth_fitting(ranking: Sequence[Screened], named: Collection[str]) -> list[Screened]:
    """Effects of a screening to be fitted: the best, few of a kind, and those ``named``."""
    found: list[Screened] = []
    count: dict[str, int] = {}
    for one in ranking:
        kind = one.name.partition("@")[0]
        room = len(found) < CONFIRMED and count.get(kind, 0) < A_KIND
        if one.gain_nats >= PROMISING and room:
            count[kind] = count.get(kind, 0) + 1
            found.append(one)
    return found + [one for one in ranking if one.name in named and one not in found]


def _columns(rows: Rows, which: NDArray[np.bool_]) -> Rows:
    return {kind: values[:, which] for kind, values in rows.items()}


class Screen:
    """Whitened traces of effects in the data's own units, nuisances projected out.

    ``kinds``: those used; leave :attr:`RobotKind.HEIGHT` out for what joint registers alone tell.
    ``already``: effects in the model, whose traces are projected out as well. ``held``: nuisances
    that have gone as far as they may, and do nothing instead of an effect.
    """

    def __init__(
        self,
        model: RobotModel,
        noise: dict[RobotKind, Noise],
        residual: Sequence[Rows],
        kinds: Iterable[RobotKind] = MEANS,
        which: Sequence[int] | None = None,
        already: Sequence[str] = (),
        held: NDArray[np.bool_] | None = None,
    ) -> None:
        self._model, self._noise = model, noise
        self._kinds = tuple(kind for kind in kinds if kind in noise)
        self._which = list(range(len(model.features)) if which is None else which)
        self.residual = self._whitened([residual[r] for r in self._which])[:, 0]
        free = np.ones(len(model.nuisances), bool) if held is None else ~held
        nuisances = self._whitened([_columns(model.traces[r], free) for r in self._which])
        self._free = [
            n.name for n, kept in zip(model.nuisances, free.tolist(), strict=True) if kept
        ]
        self._nuisances = nuisances
        self._weight = huber_weight(self.residual)
        normal = (nuisances * self._weight[:, None]).T @ nuisances + np.eye(nuisances.shape[1])
        self._solve = np.linalg.inv(normal)
        self._traces: dict[tuple[str, float], Floats] = {}
        for name in already:  # nor what they could do
            self._project(name)

    def _whitened(self, rows: Sequence[Rows]) -> Floats:
        """Columns of several recordings, (rows,) or (rows, k) of each kind, as noise sees them."""
        parts = []
        for r, by_kind in zip(self._which, rows, strict=True):
            for kind in self._kinds:
                if kind not in by_kind:
                    continue
                values = by_kind[kind]
                columns = values[:, None] if values.ndim == 1 else values
                block = self._model.block(r, kind, np.zeros(len(columns)))
                known = np.isfinite(self._model.recorded(r, kind))
                out, _ = whiten(block, self._noise[kind], np.ascontiguousarray(columns[known]))
                parts.append(out)
        return np.concatenate(parts)

    def _project(self, name: str) -> None:
        self._nuisances = np.column_stack([self._nuisances, self.trace(name)])
        normal = (self._nuisances * self._weight[:, None]).T @ self._nuisances
        prior = np.full(len(normal), 1.0)
        prior[len(self._free) :] = 1e-6
        self._solve = np.linalg.inv(normal + np.diag(prior))

    def _inner(self, a: Floats, b: Floats) -> float:
        """Product of two whitened traces with the nuisances projected out, under their priors."""
        wa, wb = self._weight * a, self._weight * b
        return float(wa @ b - (self._nuisances.T @ wa) @ self._solve @ (self._nuisances.T @ wb))

    def trace(self, name: str) -> Floats:
        """An effect's whitened trace at its first try, for one unit of its knob."""
        return self._trace(name, self._model.curves.first_z(name))

    def _trace(self, name: str, at: float) -> Floats:
        if (name, at) not in self._traces:
            model = self._model
            rows = [model.trace_at(name, at, r) for r in self._which]
            self._traces[name, at] = self._whitened(rows)[:, 0]
        return self._traces[name, at]

    def one(self, name: str) -> Screened:
        """Screen one effect: at the size that explains most."""
        tried = [self._one(name, at) for at in self._model.curves.tries(name)]
        floor = min(one.floor_z for one in tried)
        return replace(max(tried, key=lambda one: one.gain_nats), floor_z=floor)

    def _one(self, name: str, at: float) -> Screened:
        trace = self._trace(name, at)
        size = self._inner(trace, trace)
        if size <= 1e-12:
            return Screened(name, 0.0, 0.0, float("inf"))
        z = self._inner(trace, self.residual) / size
        low, high = self._model.placed[name].knob.bounds
        z = min(high, max(low, z))
        gain = z * self._inner(trace, self.residual) - 0.5 * z * z * size
        floor = SEEN / float(np.sqrt(size))
        return Screened(name, max(0.0, gain), z, floor)

    def rank(self, names: Iterable[str]) -> list[Screened]:
        """Effects by what they gain, the most first."""
        wanted = list(names)
        motions = sorted({self._model.like[r] for r in self._which})
        self._model.curves.prepare(wanted, motions)
        self._model.curves.enlarge(wanted, motions)
        return sorted((self.one(name) for name in wanted), key=lambda s: -s.gain_nats)

    def cosine(self, one: str, other: str) -> float:
        """How alike two effects look in this data: 1 is the same, 0 is nothing in common."""
        a, b = self.trace(one), self.trace(other)
        size = self._inner(a, a) * self._inner(b, b)
        return self._inner(a, b) / float(np.sqrt(size)) if size > 0.0 else 0.0

    def alike(self, name: str, others: Iterable[str]) -> list[tuple[str, float]]:
        """Those that this data cannot tell from an effect, with the cosine."""
        found = [(other, self.cosine(name, other)) for other in others if other != name]
        return sorted(((n, c) for n, c in found if abs(c) > ALIKE), key=lambda p: -abs(p[1]))

    def standing_out(self, most: int = 2) -> list[str]:
        """Legs with clearly more misfit than the rest, worst first, each with such joints of it.

        They are to be looked at alone. What a leg's own nuisances must do against their priors to
        fit it is misfit as well. A joint is held against those of its kind in the other legs.
        """
        own = self._misfits()
        legs: dict[str, float] = {}
        kinds: dict[str, list[float]] = {}
        for joint in self._model.base.joints:
            legs[joint.leg] = legs.get(joint.leg, 0.0) + own[joint.name]
            kinds.setdefault(joint.segment, []).append(own[joint.name])
        usual = STANDS_OUT * float(np.median(list(legs.values())))
        found = []
        for leg in sorted(legs, key=lambda leg: -legs[leg])[:most]:
            if legs[leg] > usual:
                some = [joint for joint in self._model.base.joints if joint.leg == leg]
                worst = [
                    j for j in some if own[j.name] > STANDS_OUT * float(np.median(kinds[j.segment]))
                ]
                found += [leg, *(j.name for j in sorted(worst, key=lambda j: -own[j.name]))]
        return found

    def _misfits(self) -> dict[str, float]:
        """What is left of every joint, and what its own nuisances do against their priors."""
        model = self._model
        joints = [joint.name for joint in model.base.joints]
        energy = dict.fromkeys(joints, 0.0)
        taken = self._solve @ (self._nuisances.T @ (self._weight * self.residual))
        left = self.residual - self._nuisances @ taken
        for name, z in zip(self._free, taken[: len(self._free)].tolist(), strict=True):
            joint = name.split()[-1]
            if joint in energy:
                energy[joint] += z * z
        at = 0
        for r in self._which:
            features = model.features[r]
            for kind in self._kinds:
                if kind not in model.centre[r]:
                    continue
                known = np.isfinite(model.recorded(r, kind))
                part, at = left[at : at + known.sum()], at + int(known.sum())
                for j, joint in enumerate(joints):
                    own = features.of_joint(j, kind)[known]
                    energy[joint] += float((part[own] ** 2).sum())
        return energy
