"""What of an effect is left beside a robot's tolerances while it walks.

As :mod:`bench.blind.imitation` has it of joints: the robot as it truly is, against the same robot
without the effect, where every nuisance may have any value within its bounds, and every other part
any size from nothing to its double. It is measured where sizes are, from where a robot has stood
up; on a stand, throughout. A play takes seconds, and there is one for each of some eighty numbers.

Whoever diagnoses may have to grant more: a battery's charge, or a gain of which nobody says how its
register scales. What is :class:`Granted` so widens a tolerance, or adds one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .imitation import Free, Left, imitated, of_parts
from .legged_case import TOLERANCES, LeggedCase, LeggedHidden, droop_most_v_s
from .legged_effects import Whole
from .legged_sizing import legged_floor, sized_on, tracks, walk

Floats = NDArray[np.float64]

GAIN = "gain_factor"  #: of all joints; off by nothing unless that is granted


DRAWN = TOLERANCES["supply_factor"][1]  #: how far a supply is off at most


@dataclass(frozen=True, slots=True)
class Granted:
    """How far a supply and a gain may be off, as a share; a supply no less than it is drawn."""

    supply: float = DRAWN
    gain: float = 0.0

    def tolerances(self) -> Mapping[str, tuple[float, float]]:
        """What nuisances may be: as believed, and how far off at most."""
        return {**TOLERANCES, "supply_factor": (1.0, self.supply)}


NO_MORE = Granted()  #: than the generator draws


def legged_left(case: LeggedCase, index: int, granted: Granted = NO_MORE) -> Left:
    """What is left of one of the hidden effects of a case, beside all else in it."""
    without = dataclasses.replace(
        case, hidden=tuple(h for k, h in enumerate(case.hidden) if k != index)
    )
    free = tuple(_free(without, granted))
    floor = legged_floor(case.scene.name)
    true = _shown(case)

    def shown_at(units: Floats) -> list[Floats]:
        gain = next((f.value(u) for f, u in zip(free, units, strict=True) if f.name == GAIN), 1.0)
        return _shown(moved(without, free, units), gain)

    def rest_at(units: Floats) -> Floats:
        return np.concatenate(
            [
                (one[:n] - other[:n]).ravel()
                for one, other, n in zip(true, shown_at(units), ends, strict=True)
            ]
        )

    ends = [len(one) for one in true]
    return imitated(rest_at, free, floor)


def _shown(case: LeggedCase, gain: float = 1.0) -> list[Floats]:
    """Angles [rad] of the groups that sizes are measured on, of a robot with so much more gain."""
    scene = case.scene
    changed = {g.name: _gained(case.truth(g.plan)[0], gain) for g in sized_on(scene)}
    found = tracks(scene, changed)
    walks = scene.support == "ground"
    return [(walk(track) if walks else track).angle_rad for track in found]


def _gained(whole: Whole, gain: float) -> Whole:
    if gain == 1.0:
        return whole
    known = whole.electrics.gain_factor or {}
    every = {joint: gain * known.get(joint, 1.0) for joint in whole.robot.by_joint}
    return whole.electrics_but(gain_factor=every)


def _free(case: LeggedCase, granted: Granted = NO_MORE) -> Iterator[Free]:
    nuisances = case.nuisances
    for name, (middle, most) in granted.tolerances().items():
        now = getattr(nuisances, name)
        ends = middle - most, middle + most
        if isinstance(now, dict):
            for joint, value in now.items():
                yield Free(f"{name}.{joint}", value, *ends, most)
        elif isinstance(now, tuple):
            for k, value in enumerate(now):
                yield Free(f"{name}.{k}", value, *ends, most)
        else:
            yield Free(name, now, *ends, most)
    most = droop_most_v_s(case.scene)
    yield Free("droop_v_s", nuisances.droop_v_s, 0.0, most, 0.5 * most)
    if granted.gain:
        yield Free(GAIN, 1.0, 1.0 - granted.gain, 1.0 + granted.gain, granted.gain)
    yield from of_parts((*case.ordinary, *case.hidden))


def moved(case: LeggedCase, free: Sequence[Free], units: Floats) -> LeggedCase:
    """A case with other values of what is free, each so many steps from where it is."""
    values = {f.name: f.value(u) for f, u in zip(free, units.tolist(), strict=True)}
    nuisances = case.nuisances
    for name in TOLERANCES:
        now = getattr(nuisances, name)
        new: Any
        if isinstance(now, dict):
            new = {joint: values[f"{name}.{joint}"] for joint in now}
        elif isinstance(now, tuple):
            new = tuple(values[f"{name}.{k}"] for k in range(len(now)))
        else:
            new = values[name]
        nuisances = dataclasses.replace(nuisances, **{name: new})
    nuisances = dataclasses.replace(nuisances, droop_v_s=values["droop_v_s"])
    sizes = {f.part: values[f.name] for f in free if f.part is not None}
    every: list[LeggedHidden] = [
        dataclasses.replace(part, size=sizes[k])
        for k, part in enumerate((*case.ordinary, *case.hidden))
    ]
    masks = len(case.ordinary)
    return dataclasses.replace(
        case, nuisances=nuisances, ordinary=tuple(every[:masks]), hidden=tuple(every[masks:])
    )
