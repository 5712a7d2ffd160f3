"""What a search on legs tries at every step, however little curves promise of it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .fit import RobotFit, Sight
from .gains import HOPELESS, NEEDED, RobotGain, levelled
from .improved import within

#: looked for from a large try whatever is promised: a little of a spring and much are two valleys
SPRINGS = frozenset(
    f"joint_compliance@{where}" for where in ("all", "femur", "tibia", "femur+tibia")
)

#: limits that are looked for likewise, from the middle one of their levels: femurs carry the robot
LIMITS = frozenset({"torque_limit@all", "torque_limit@femur"})
LIMIT = "torque_limit@"  #: and of whole legs, where these stand out

LITTLE = 0.5  #: of much of a spring, below which much is tried as well

#: what is looked for together, as both give under the same load and neither shows without the other
PAIRS = (("joint_compliance@femur+tibia", "foot_compliance@all"),)
SOFT = 3.0  #: of tips beside a spring, in first tries, where a fit begins
#: and where servos show another voltage: what a servo does about being off goes with the product of
#: gain and supply, so that positions show neither where the other one hides it
GAIN, SUPPLY, SAG = "gain_error@all", "supply_voltage@all", "voltage_sag@all"


@dataclass(frozen=True, slots=True)
class Pair:
    """Two effects at places, and knobs from which they are tried."""

    names: tuple[str, str]
    knobs: tuple[float, float]
    anyhow: bool = False  #: fitted to the end however much worse than one of them it begins


def opposed(sight: Sight, now: RobotFit, more_v: float, names: Collection[str]) -> tuple[Pair, ...]:
    """A supply that is so much more at the servos [V], or a source that gives way, behind a gain.

    They begin with the supply that servos show, and with the gain that hides it from positions.
    None where servos show no other voltage, where a name is not looked for, or beside one of them:
    what is missing then shows by itself.
    """
    if more_v == 0.0 or GAIN not in names or {GAIN, SUPPLY, SAG}.intersection(now.names):
        return ()
    model = sight.model
    off = {
        nuisance.same[0]: 1.0 + z * nuisance.deviation
        for nuisance, z in zip(model.nuisances, now.nuisances.tolist(), strict=True)
        if nuisance.same and nuisance.same[0] in (GAIN, SUPPLY)
    }
    shown = off[SUPPLY] + more_v / model.base.supply.voltage_v
    supply = within(model.placed[SUPPLY].parameter, shown)
    gain = within(model.placed[GAIN].parameter, off[GAIN] * off[SUPPLY] / supply)
    hides = model.placed[GAIN].knob.at(gain)
    begins = {SUPPLY: model.placed[SUPPLY].knob.at(supply)}
    if more_v < 0.0:
        begins[SAG] = model.curves.first_z(SAG)
    every = [n for n in begins if n in names]
    return tuple(Pair((n, GAIN), (begins[n], hides), anyhow=True) for n in every)


@dataclass(frozen=True, slots=True, eq=False)
class Sought:
    """Effects at places that are tried, from such a knob if nothing is promised of them (``at``).

    These are springs and limits, much of them, and whatever gained in place of what was taken, from
    where it had come to: it may be beside that, too. Curves of limits say little, as they are those
    of a robot as believed in all else: of one of 0.4 duty in another engine they promised nothing,
    and a fit that began there gained 700 nats. ``pairs`` are tried at the first step, by whose
    inflation (``widest``, once it is over) all gains are divided at most: later ones have few.
    """

    sight: Sight
    at: Mapping[str, float]
    pairs: tuple[Pair, ...] = ()
    gained: frozenset[str] = frozenset()  #: of those, what had gained in place of what was taken
    widest: float = math.inf

    @classmethod
    def much(cls, sight: Sight, names: Collection[str]) -> Sought:
        """Springs and limits among some names, from where a robot feels them."""
        tries = sight.model.curves.tries
        springs = {name: tries(name)[-1] for name in sorted(SPRINGS.intersection(names))}
        limited = LIMITS | {LIMIT + leg.name for leg in sight.model.base.legs}
        levels = {name: sight.model.placed[name].levels for name in limited.intersection(names)}
        limits = {name: some[len(some) // 2] for name, some in levels.items()}
        pairs = [
            Pair((spring, tips), (springs[spring], SOFT * sight.model.curves.first_z(tips)))
            for spring, tips in PAIRS
            if spring in springs and tips in names
        ]
        return cls(sight, springs | limits, tuple(pairs))

    def beside(self, now: RobotFit, promised: Sequence[RobotGain]) -> list[RobotGain]:
        """What is promised, and what is sought of which nothing is; best first.

        Of a spring of which little is promised much is sought as well: there are two gains of it.
        Much of what is there already at some of the same places is not sought beside it.
        """
        found = [g for g in promised if g.name not in self.at or not self._unpromised(g)]
        here = {name for own in now.names for name in self._here(own)}
        enough = {gain.name for gain in found if not self._little(gain)}
        for name in sorted(self.at.keys() - here - enough):
            fit = replace(now, names=(*now.names, name), z=np.append(now.z, self.at[name]))
            found.append(RobotGain(name, fit, 0.0, self.sight.inflation(fit, name), None))
        return levelled(found, self.widest)

    def asked(self, promised: Sequence[RobotGain]) -> set[str]:
        """What is tried however much others promise: all that is sought, and limits of promise."""
        limits = {g.name for g in promised if self._limit(g.name) and not self._unpromised(g)}
        return limits | self.at.keys()

    def after(self, fitted: Sequence[RobotGain]) -> Sought:
        """What is sought after a step that has fitted so much to the end."""
        hopeless = {gain.name for gain in fitted if gain.nats < -HOPELESS}
        found = {name: z for name, z in self.at.items() if name not in hopeless}
        enough = [g for g in fitted if g.name not in SPRINGS and g.deflated >= NEEDED]
        found |= {gain.name: float(gain.fit.knobs[-1]) for gain in enough}
        gained = (self.gained - hopeless).union(gain.name for gain in enough)
        first = fitted[0].inflation if fitted else math.inf
        widest = first if math.isinf(self.widest) else self.widest
        return replace(self, at=found, gained=gained, widest=widest)

    def rivals(self, now: RobotFit) -> Sought:
        """Nothing but what had gained in place of what a fit has, and may be beside that."""
        rest = self.gained.difference(*(self._here(own) for own in now.names))
        return replace(self, at={name: z for name, z in self.at.items() if name in rest}, pairs=())

    def _little(self, gain: RobotGain) -> bool:
        """Whether much less is promised of it than is sought, limits aside."""
        much, promised = self.at.get(gain.name, 0.0), float(gain.fit.knobs[-1])
        return not self._limit(gain.name) and promised * much < LITTLE * much**2

    def _here(self, own: str) -> set[str]:
        """What is sought that is what a robot has already."""
        return {name for name in self.at if self._again(name, own)}

    def _again(self, name: str, own: str) -> bool:
        """Whether two are one number of one effect, at some joint both."""
        one, other = (self.sight.model.placed[each] for each in (name, own))
        if one.effect is not other.effect or one.parameter is not other.parameter:
            return False
        anywhere = not one.where or not other.where
        return anywhere or not set(one.where).isdisjoint(other.where)

    def _limit(self, name: str) -> bool:
        return bool(self.sight.model.placed[name].levels)

    def _unpromised(self, gain: RobotGain) -> bool:
        """Whether that is a limit which promises next to nothing."""
        return self._limit(gain.name) and gain.nats < NEEDED
