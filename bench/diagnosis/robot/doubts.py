"""How sure a robot file is of its numbers, where it says so: how wide nuisances are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from busemu.tables import Robot
from sim.entries import Section
from sim.tree import SEGMENTS

from ..joint.nuisances import DOUBTS, FARTHEST
from .nuisances import RobotNuisance

#: of entries of a [drive], by what one joint makes of them: the nuisance that all joints share
SHARED = {"torque_constant": "motors", "coulomb_level": "gears", "viscous_level": "gears"}
SHARED |= {"rotor_level": "rotors"}
LEAST = 0.1  #: share of a number that is left of it at least, however little a file knows; assumed


def doubted(robot: Robot, nuisances: Sequence[RobotNuisance]) -> tuple[RobotNuisance, ...]:
    """Nuisances as wide as a robot file says, which may then go as far as of one joint."""
    told = dict(_told(Section(robot.path, "", robot.document)))
    return tuple(
        replace(n, deviation=told[n.name], reach=FARTHEST, least=_least(told[n.name]), doubt=0.0)
        if n.name in told
        else n
        for n in nuisances
    )


def _least(deviation: float) -> float:
    """The least a ratio may take [deviations]: nothing is lighter than weightless."""
    return -min(FARTHEST, (1.0 - LEAST) / deviation)


def _told(top: Section) -> Iterator[tuple[str, float]]:
    """Relative deviations by nuisance, where a file gives any; of several the widest is last."""
    drives = [top.section("drive").section(model) for model in top.section("drive").table]
    told = [
        (SHARED[of_joint], deviation)
        for drive in drives
        for key, of_joint in DOUBTS.items()
        if of_joint in SHARED and (deviation := drive.deviation(key)) is not None
    ]
    yield from sorted(told, key=lambda pair: pair[1])
    for section, key, name in _plain(top):
        if (deviation := section.deviation(key)) is not None:
            yield name, deviation
    if "trunk" in top and (deviation := _of_trunk(top.section("trunk"))) is not None:
        yield "mass trunk", deviation


def _plain(top: Section) -> Iterator[tuple[Section, str, str]]:
    """Entries that one nuisance is of: their section, their key, its name."""
    yield top.section("supply"), "voltage_v", "supply"
    if "contact" in top:
        yield top.section("contact"), "friction", "grip"
    if "link" in top:
        for segment in SEGMENTS:
            yield top.section("link").section(segment), "mass_kg", f"mass {segment}"


def _of_trunk(trunk: Section) -> float | None:
    """Deviation of the trunk's mass with its battery, if either's is told."""
    parts = [key for key in ("mass_kg", "battery_kg") if key in trunk]
    kg = {key: trunk.number(key, "kg", 0.0, 50.0) for key in parts}
    off = {key: trunk.deviation(key) for key in parts}
    if all(deviation is None for deviation in off.values()):
        return None
    return math.hypot(*(kg[key] * (off[key] or 0.0) for key in parts)) / sum(kg.values())
