"""What of an effect is left beside a robot's tolerances while it walks.

As :mod:`bench.blind.imitation` has it of joints: the robot as it truly is, against the same robot
without the effect, where every nuisance may have any value within its bounds, and every other part
any size from nothing to its double. It is measured where sizes are, from where a robot has stood
up; on a stand, throughout. A play takes seconds, and there is one for each of some eighty numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .imitation import Free, Left, imitated, of_parts
from .legged_case import TOLERANCES, LeggedCase, LeggedHidden, droop_most_v_s
from .legged_sizing import legged_floor, sized_on, tracks, walk

Floats = NDArray[np.float64]


def legged_left(case: LeggedCase, index: int) -> Left:
    """What is left of one of the hidden effects of a case, beside all else in it."""
    without = dataclasses.replace(
        case, hidden=tuple(h for k, h in enumerate(case.hidden) if k != index)
    )
    free = tuple(_free(without))
    floor = legged_floor(case.scene.name)
    true = _shown(case)

    def rest_at(units: Floats) -> Floats:
        return np.concatenate(
            [
                (one[:n] - other[:n]).ravel()
                for one, other, n in zip(
                    true, _shown(moved(without, free, units)), ends, strict=True
                )
            ]
        )

    ends = [len(one) for one in true]
    return imitated(rest_at, free, floor)


def _shown(case: LeggedCase) -> list[Floats]:
    """Angles [rad] of the groups that sizes are measured on."""
    scene = case.scene
    changed = {group.name: case.truth(group.plan)[0] for group in sized_on(scene)}
    found = tracks(scene, changed)
    walks = scene.support == "ground"
    return [(walk(track) if walks else track).angle_rad for track in found]


def _free(case: LeggedCase) -> Iterator[Free]:
    nuisances = case.nuisances
    for name, (middle, most) in TOLERANCES.items():
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
