"""What weakens a robot that stands up, named by how it does.

As it rises its motors draw more than they ever do as it walks, and its feet drag over the floor: a
source that gives way, or a floor that lets feet slip, shows there and hardly anywhere else. Nor do
fits see it, which are made to the gait. So where a robot's gait has been looked at, these windows
are asked by themselves: of everything at all joints, the trunk or the floor, beside all that
tolerances may do about it within what the gait lets them. A name is given to what explains most of
it, if that is one of the few that show there; of all others the gait says more.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.effects.effect import TRUNK

from ..joint.confidence import NORMAL, estimate
from ..joint.fit import bounded_step
from ..noise import Block, Noise, huber, huber_weight, whiten
from ..result import Cause, Estimate
from .causes import ENGINES_SHARE, rivals_of, scope_of
from .effects import EVERYWHERE
from .fit import FIRM, RobotFit
from .gains import RobotGain
from .improved import tolerated
from .model import Progress, RobotModel
from .nuisances import READ
from .pool import Job
from .rise import Rise
from .search import RobotSearch
from .sizes import best_size
from .steps import BESIDE, HELD_OUT

Floats = NDArray[np.float64]

#: effects that show as a robot rises, and hardly as it walks
RISERS = frozenset({"voltage_sag", "foot_slip"})
#: by how much the means of two engines differ as a robot rises, once tolerances are fitted: two
#: cases of another engine leave 2 to 4 mrad with the truth in them; how long it lasts is assumed
ENGINES = Noise(2.0e-3, 3.5e-3, 1.0)
TRACED = 0.5  #: deviations of a tolerance by which its trace is taken, towards what is believed
#: sizes at which those are asked first, in first tries: what weakens a robot that rises does more
#: than twice as much where there is twice of it
FINE = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)
ROUGH = (0.1, 0.3, 1.0)  #: and all others, either way
NEARER = (0.7, 0.85, 1.2, 1.4)  #: times the best size that was asked, which are asked next
FITTED = 4  #: effects that promise most, of which the gait is asked as well


@dataclass(frozen=True, slots=True, eq=False)
class Sized:
    """An effect at a size: what it gains [nats], and the vector there, its knob the last."""

    name: str
    nats: float
    z: Floats

    @property
    def knob(self) -> float:
        """How much of it."""
        return float(self.z[-1])


def at_best(asked: Sequence[Sized]) -> list[Sized]:
    """Each effect once, where it gains most; the best first."""
    best: dict[str, Sized] = {}
    for one in sorted(asked, key=lambda one: -one.nats):
        best.setdefault(one.name, one)
    return list(best.values())


def peak(asked: Sequence[Sized]) -> float:
    """The knob at the peak of a parabola through the best of some sizes and its neighbours."""
    own = sorted(asked, key=lambda one: one.knob)
    at = int(np.argmax([one.nats for one in own]))
    if not 0 < at < len(own) - 1:
        return own[at].knob
    knobs, nats = zip(*((one.knob, one.nats) for one in own[at - 1 : at + 2]), strict=True)
    bent, steep, _ = np.polyfit(np.array(knobs) - own[at].knob, nats, 2)
    return own[at].knob - float(steep / (2.0 * bent))


@dataclass(frozen=True, slots=True, eq=False)
class Riser:
    """What was named by how a robot rises: the gain, with a fit to its gait, and the cause."""

    gain: RobotGain
    cause: Cause


class Rising:
    """How a robot rises in the first of some recordings, and in those that judge."""

    def __init__(
        self, search: RobotSearch, which: Sequence[int], judges: Sequence[int], say: Progress
    ) -> None:
        self.search, self.judges, self._say = search, judges, say
        self.model: RobotModel = search.model
        self._which = which

    @cached_property
    def _rises(self) -> list[Rise | None]:
        return [Rise.of(features) for features in self.model.features]

    @cached_property
    def _first(self) -> int | None:
        """The first of the recordings that are fitted in which a robot rises."""
        return next((r for r in self._which if self._rises[r] is not None), None)

    def named(self, after: RobotFit, without: Collection[str] = ()) -> Riser | None:
        """What explains how a robot rises beside a fit to its gait, where judges bear it out."""
        if self._first is None:
            return None
        self._say("asking how the robot stands up")
        stand = _Stand(self, after, self._first)
        every = self.model.placed.items()
        names = [
            name
            for name, one in every
            if one.place in (EVERYWHERE, TRUNK)
            and name not in after.names
            and not one.left_out(without)
        ]
        sized = stand.sized(names)
        if not sized:
            return None
        best, *others = sized
        if not self.rises(best.name) or best.nats < BESIDE:
            return None
        plain, there = stand.fit(stand.plain), self._finer(stand.fit(best), self._first)
        before, left = self._cost(plain, self.judges), self._cost(there, self.judges)
        if before - left < HELD_OUT:
            there, left = self._resized(there)
        nats = self._total(plain, self._first) - self._total(there, self._first)
        exact = Sized(best.name, nats, there.z)
        if nats < BESIDE or before - left < HELD_OUT or self._ordinary(exact):
            return None
        behind = [replace(one, nats=one.nats - best.nats) for one in others]
        share = (before - left) / max(before - self._quiet(self.judges), before - left)
        return self._told(
            exact, behind, self._settled(there, after, self._first), before - left, share
        )

    def _settled(self, there: RobotFit, after: RobotFit, r: int) -> RobotFit:
        """A fit to the gait beside what was found, its size held, or the fit that found it.

        Where something else is the matter, a fit to the gait alone may spoil how the robot rises.
        """
        name, knob = there.settings[-1]
        search = self.search
        search.sight.held[name] = knob
        fit = search.settle(search.fitted(there.names, there.z, after.noise))
        best = min(fit, there, key=lambda one: self._total(one, r))
        search.around(best)
        return best

    def _finer(self, found: RobotFit, r: int) -> RobotFit:
        """A fit with what all that is in it does there, its effect's size as well, if that is more.

        A source that gives way does so more steeply the more it does, and tolerances beside it.
        """
        stand = _Stand(self, found, r)
        finer = stand.fit(stand.plain)
        return min(finer, found, key=lambda fit: self._total(fit, r))

    def _resized(self, found: RobotFit) -> tuple[RobotFit, float]:
        """A fit of the size that judges like best, as far as engines differ, and what it costs."""
        search, name = self.search, found.names[-1]
        best, cost = best_size(search, found, name, lambda one: self._cost(one, self.judges))
        return (found if best is found else search.replayed(best)), cost

    def _total(self, found: RobotFit, r: int) -> float:
        """What windows and gait cost a fit [nats], the gait for less than it believes."""
        return self._cost(found, [r]) + found.cost / FIRM

    def _ordinary(self, best: Sized) -> bool:
        """Whether an effect may be no more than a tolerance has it, by its interval."""
        model = self.model
        ends = tolerated(model.base, model.placed[best.name], model.nuisances)
        low, high = self._number(best).ci95
        return ends is not None and low <= ends[1] and high >= ends[0]

    def _number(self, best: Sized) -> Estimate:
        """A size with its interval: what two engines differ about it is more than what scatters."""
        wide = NORMAL * ENGINES_SHARE * abs(best.knob)
        knob = self.model.placed[best.name].knob
        return estimate(knob, best.knob, [best.knob - wide, best.knob + wide], "pinned")

    def rises(self, name: str) -> bool:
        """Whether a placed effect is one of those that show as a robot rises."""
        return self.model.placed[name].effect.name in RISERS

    def rows(self, found: RobotFit, r: int) -> Floats:
        """Recorded less replayed windows of a recording (rows,) [rad]."""
        rise = self._rises[r]
        assert rise is not None
        return rise.recorded - self.replayed([found], r)[0]

    def replayed(self, fits: Sequence[RobotFit], r: int) -> list[Floats]:
        """Windows of a recording by exact replays of some fits, as they would have been read."""
        model = self.model
        told = [model.told(fit.settings, fit.nuisances) for fit in fits]
        jobs = [Job(r, effects, nuisances=z, rise=True) for effects, z in told]
        shown = [_shown(model, fit.nuisances, self._rises[r]) for fit in fits]
        ran = model.replays.run(jobs)
        return [own.risen_rad + more for own, more in zip(ran, shown, strict=True)]

    def whitened(self, r: int, columns: Floats) -> Floats:
        """Columns (rows, k) of a recording's windows as noise sees them, where somebody looked."""
        rise = self._rises[r]
        assert rise is not None
        known = np.isfinite(rise.recorded)
        own = np.ascontiguousarray(np.nan_to_num(columns[known]))
        block = Block(rise.t_s[known], own[:, 0], np.zeros(int(known.sum())))
        return whiten(block, ENGINES, own)[0]

    def _cost(self, found: RobotFit, which: Sequence[int]) -> float:
        """What windows cost a fit [nats], a mean over recordings: each tells the same."""
        some = [r for r in which if self._rises[r] is not None]
        each = [
            float(np.sum(huber(self.whitened(r, self.rows(found, r)[:, None])[:, 0]))) for r in some
        ]
        return float(np.mean(each)) if each else 0.0

    def _quiet(self, which: Sequence[int]) -> float:
        """What windows cost where no more than noise is left [nats], as :meth:`_cost` has it."""
        looked = [np.isfinite(rise.recorded).sum() for r in which if (rise := self._rises[r])]
        return 0.5 * float(np.mean(looked)) if looked else 0.0

    def _told(
        self,
        found: Sized,
        behind: Sequence[Sized],
        fit: RobotFit,
        outside: float,
        share: float,
    ) -> Riser:
        """A cause of what was found; ``behind`` are others, with how much less they gain."""
        model, every = self.model, self.model.placed
        placed = every[found.name]
        others = {every[one.name].effect.name: (-one.nats, one.name) for one in reversed(behind)}
        own, close = rivals_of(model, found.nats, others)
        cause = Cause(
            effect=placed.effect.name,
            scope=scope_of(placed, model),
            parameters={placed.parameter.name: self._number(found)},
            held_out_gain_nats=outside,
            explained_share=share,
            probability=own,
            indistinguishable_from=tuple(close),
            shown_by="how the robot stands up",
        )
        return Riser(RobotGain(found.name, fit, found.nats, 1.0, outside), cause)


def risen(named: Riser | None) -> tuple[str, ...]:
    """What is to be said of a name that how a robot stands up has given."""
    if named is None:
        return ()
    told = "was named by how the robot stands up before it walks: what it explains, and by how much"
    return (f"{named.cause.effect} {told}, is of that, and it hardly shows in the gait",)


class _Stand:
    """Windows of one recording around a fit to the gait, linear in all that was fitted.

    What the gait knows counts for less than it believes, as gains on it do.
    """

    def __init__(self, rising: Rising, after: RobotFit, r: int) -> None:
        self._rising, self._after, self._r = rising, after, r
        self._sight = rising.search.sight
        rising.search.around(after)
        self._left = rising.rows(after, r)
        self._columns = -self._traces()
        self._gait = self._sight.linearised(after.names, after.z, after.noise)
        self.plain = self._solved("", after.z, self._left, self._gait)

    def _traces(self) -> Floats:
        """What each number of the fit does to windows, for one unit of it (rows, numbers)."""
        after, model = self._after, self._rising.model
        able = [n.name.split()[0] not in READ for n in model.nuisances]
        steps = np.where(after.z > 0.0, -TRACED, TRACED)
        moved, which = [], []
        for k, step in enumerate(steps.tolist()):
            if k < len(able) and not able[k]:
                continue
            z = after.z.copy()
            z[k] += step
            moved.append(replace(after, z=z))
            which.append(k)
        base, *found = self._rising.replayed([after, *moved], self._r)
        rise = self._rising._rises[self._r]
        traces = np.zeros((len(base), len(after.z)))
        for k, rows in zip(which, found, strict=True):
            traces[:, k] = np.nan_to_num((rows - base) / steps[k])
        for k, known in enumerate(able):
            if not known:
                unit = np.zeros(len(able))
                unit[k] = 1.0
                traces[:, k] = _shown(model, unit, rise)
        return traces

    def sized(self, names: Sequence[str]) -> list[Sized]:
        """Effects at the size of each that does best, the best first.

        None where what shows as a robot rises promises too little for a name. Gains are first told
        as if no effect did anything to the gait, then those of the most promising with that.
        """
        risers = [name for name in names if self._rising.rises(name)]
        promised = self._asked({name: self._sizes(name, FINE) for name in risers}, gait=False)
        if max((one.nats for one in promised), default=0.0) < BESIDE:
            return []
        others = {name: self._sizes(name, ROUGH) for name in names if name not in risers}
        some = at_best([*promised, *self._asked(others, gait=False)])[:FITTED]
        nearer = {one.name: [one.knob, *(one.knob * x for x in NEARER)] for one in some}
        asked = self._asked(nearer, gait=True)
        first = at_best(asked)[0].name
        asked += self._asked({first: [peak([o for o in asked if o.name == first])]}, gait=True)
        return at_best(asked)

    def _sizes(self, name: str, shares: Sequence[float]) -> list[float]:
        """Knobs of an effect, either way where it has two."""
        model = self._rising.model
        low, high = model.placed[name].knob.bounds
        first = model.curves.first_z(name)
        both = [side * share * first for share in shares for side in (1.0, -1.0)]
        return [z for z in both if low <= z <= high]

    def fit(self, sized: Sized) -> RobotFit:
        """A fit at what was found, its gait by exact replays."""
        names = (*self._after.names, sized.name) if sized.name else self._after.names
        z = np.clip(sized.z, *self._box(sized))
        return self._rising.search.replayed(RobotFit(names, z, self._after.noise, math.inf))

    def _box(self, sized: Sized) -> tuple[Floats, Floats]:
        names = (*self._after.names, sized.name) if sized.name else self._after.names
        low, high = self._sight.box(names)
        if sized.name:
            low[-1] = high[-1] = sized.knob
        return low, high

    def _asked(self, knobs: Mapping[str, Sequence[float]], *, gait: bool) -> list[Sized]:
        """Effects at some knobs each."""
        after = self._after
        every = [(name, k) for name, own in knobs.items() for k in own]
        fits = [self._beside(name, k) for name, k in every]
        rise = self._rising._rises[self._r]
        assert rise is not None
        rows = self._rising.replayed(fits, self._r)
        asked = []
        for (name, _), fit, there in zip(every, fits, rows, strict=True):
            if not np.isfinite(there[np.isfinite(rise.recorded)]).all():
                continue
            residual, jacobian = self._gait
            told = residual + jacobian @ (fit.z[:-1] - after.z), jacobian
            if gait:
                residual, jacobian = self._sight.linearised(fit.names, fit.z, after.noise)
                told = residual, jacobian[:, :-1]
            one = self._solved(name, fit.z, rise.recorded - there, told)
            asked.append(replace(one, nats=self.plain.nats - one.nats))
        return asked

    def _beside(self, name: str, k: float) -> RobotFit:
        """The fit with so much of an effect, beside which some tolerances are idle."""
        names = (*self._after.names, name)
        z = np.append(self._after.z, k)
        return replace(self._after, names=names, z=np.clip(z, *self._sight.box(names)))

    def _solved(self, name: str, z: Floats, left: Floats, gait: tuple[Floats, Floats]) -> Sized:
        """What all that was fitted does best about windows and gait, and what that costs [nats]."""
        count = len(self._after.z)
        rows = self._rising.whitened(self._r, np.column_stack([left, self._columns]))
        own, columns = rows[:, 0], rows[:, 1:]
        residual, jacobian = gait
        weight = huber_weight(residual) / FIRM
        prior = np.ones(count)
        prior[count - len(self._after.names) :] = 1e-9
        system = columns.T @ columns + (jacobian * weight[:, None]).T @ jacobian + np.diag(prior)
        slope = columns.T @ own + jacobian.T @ (weight * residual) + prior * z[:count]
        low, high = self._box(Sized(name, 0.0, z))
        way = bounded_step(system, slope, z[:count], (low[:count], high[:count]), "bvls")
        there = own + columns @ way, residual + jacobian @ way, z[:count] + way
        cost = 0.5 * float(there[0] @ there[0] + weight @ there[1] ** 2 + prior @ there[2] ** 2)
        return Sized(name, cost, np.append(there[2], z[count:]))


def _shown(model: RobotModel, z: Floats, rise: Rise | None) -> Floats:
    """What registers that show another count add to a joint's windows (rows,) [rad]."""
    assert rise is not None
    reading = {n.name: float(x) * n.deviation for n, x in zip(model.nuisances, z, strict=False)}
    own = [reading.get(f"reading {joint.name}", 0.0) for joint in model.base.joints]
    return np.repeat(np.array(own), rise.windows)
