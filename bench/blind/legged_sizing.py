"""How much effects move a robot, in units of its noise floor, and in which phase of its gait."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.motions import StandPlan, WalkPlan

from .drives import Electrics
from .legged import Body
from .legged_effects import LEGGED, Where, Whole
from .scenes import OBSERVE_S, SCENES, Group, Plan, Scene, play
from .sizing import rms

Floats = NDArray[np.float64]

#: of a walk, in which it stands up, until every leg has been lifted, and lies down. Measured: from
#: 2 s on, a gain's share in stance of a PhantomX is 0.50; from 3 s on it is 0.18, from 4 s on 0.16
BEGINNING_S, END_S = 3.0, 0.5
SIZED_S = 5.0  #: of a walk on which sizes are measured


def believed(scene: Scene, plan: Plan | None = None) -> Whole:
    """The robot as its operator believes it to be."""
    weight = plan.payload_kg if isinstance(plan, WalkPlan | StandPlan) else 0.0
    body = Body(support=scene.support, legs=scene.legs, payload_kg=weight)
    return Whole(scene.robot, body, Electrics())


def sized_on(scene: Scene) -> list[Group]:
    """Groups that sizes are measured on; of walks the beginning is enough."""
    some = [group for group in scene.groups if group.name in scene.sized_on]
    return [
        replace(g, plan=replace(g.plan, seconds=SIZED_S)) if isinstance(g.plan, WalkPlan) else g
        for g in some
    ]


class Track(NamedTuple):
    """Servo angles [rad] of a recording, and whether their legs stand: (instants, servos)."""

    angle_rad: Floats
    stands: NDArray[np.bool_]


def tracks(scene: Scene, changed: Mapping[str, Whole]) -> list[Track]:
    """Tracks of the groups that sizes are measured on, of a robot that is given for each group."""
    found = []
    for group in sized_on(scene):
        whole = changed[group.name]
        played = play(scene, group.plan, whole.body, whole.electrics)
        found.append(Track(played.track_rad, played.stands))
    return found


def _apart(first: list[Track], second: list[Track]) -> float:
    """RMS between tracks; one may be a few instants longer than the other."""
    parts = []
    for one, two in zip(first, second, strict=True):
        n = min(len(one.angle_rad), len(two.angle_rad))
        parts.append((one.angle_rad[:n] - two.angle_rad[:n]).ravel())
    return rms(np.concatenate(parts))


@cache
def base(name: str) -> list[Track]:
    """Tracks of the robot as it is believed to be."""
    scene = SCENES[name]
    return tracks(scene, {g.name: believed(scene, g.plan) for g in scene.groups})


@cache
def legged_floor(name: str) -> float:
    """Noise floor of a scene's joint angles [rad]: quantisation and spread of repeats."""
    scene = SCENES[name]
    step = next(iter(scene.robot.tables.values()))["present_position"].si_scale
    weak = {g.name: passing(believed(scene, g.plan), 1.0) for g in scene.groups}
    spread = _apart(base(name), tracks(scene, weak)) / math.sqrt(2.0)
    return math.sqrt(step**2 / 12.0 + spread**2)


def passing(whole: Whole, late: float) -> Whole:
    """A robot at an instant of its session, 0 to 1: the battery runs down by 1 %."""
    volts = whole.electrics.supply_v or whole.robot.document["supply"]["voltage_v"]["value"]
    return whole.electrics_but(supply_v=volts * (1.0 - 0.01 * late))


@lru_cache(maxsize=4096)
def legged_ratio(name: str, effect: str, size: float, where: Where) -> float:
    """An effect's RMS change of all joint angles over the noise floor."""
    return _apart(base(name), _with(name, effect, size, where)) / legged_floor(name)


def walking_ratio(name: str, effect: str, size: float, where: Where) -> float:
    """The same while the robot walks: standing up and lying down are left out."""
    walks = (
        [walk(track) for track in one] for one in (base(name), _with(name, effect, size, where))
    )
    return _apart(*walks) / legged_floor(name)


@lru_cache(maxsize=64)
def _with(name: str, effect: str, size: float, where: Where) -> list[Track]:
    """Tracks of the robot as it is believed to be, but for one effect."""
    scene = SCENES[name]
    changed = {
        g.name: LEGGED[effect].apply(believed(scene, g.plan), size, where)[0]
        for g in sized_on(scene)
    }
    return tracks(scene, changed)


def walk(track: Track) -> Track:
    """A track while the robot walks."""
    n = len(track.angle_rad)
    own = slice(round(BEGINNING_S / OBSERVE_S), n - round(END_S / OBSERVE_S))
    return Track(track.angle_rad[own], track.stands[own])


def standing_share(first: Sequence[Track], second: Sequence[Track]) -> float:
    """Share of the squares between tracks that joints have while their legs stand, in a walk.

    Legs stand as they do in the first. Standing up and lying down are left out.
    """
    total = standing = 0.0
    for one, two in zip(map(walk, first), map(walk, second), strict=True):
        n = min(len(one.angle_rad), len(two.angle_rad))
        square = (one.angle_rad[:n] - two.angle_rad[:n]) ** 2
        total += float(square.sum())
        standing += float(square[one.stands[:n]].sum())
    return standing / total
