"""The physical part of a robot file: from TOML to a :class:`PhysicalRobot`, without effects.

A file with ``[[body]]`` describes a rig (:mod:`sim.rig`), one with ``[trunk]`` a hexapod
(:mod:`sim.hexapod`). Effects of ``[[effect]]`` are added by :func:`sim.model.read_model`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from busemu.tables import ControlTable, Robot

from .drive.parameters import read_drive
from .entries import PhysicsError, Section
from .hexapod import read_hexapod
from .rig import read_rig
from .tree import SEGMENTS, Contact, Joint, PhysicalRobot, Supply

__all__ = ["SEGMENTS", "Joint", "PhysicalRobot", "read_physics"]

#: what a robot file may hold; "gait" is the walking program's, "bus" and "servo" are the wiring
SECTIONS = (
    "format", "name", "title", "bus", "servo", "supply", "drive", "rest", "effect", "body",
    "payload", "trunk", "leg", "link", "contact", "gait",
)  # fmt: skip
AIR = Contact(friction=1.0, restitution=0.0)  #: of a rig, which touches nothing but itself; assumed


def read_physics(robot: Robot, *, trunk_load_kg: float = 0.0) -> PhysicalRobot:
    """The physical part of a robot file, without its effects.

    ``trunk_load_kg`` is added to the trunk, spread evenly (the thesis's torque experiment). Raises
    :class:`PhysicsError` with one line when anything is missing or cannot be true.
    """
    if not 0.0 <= trunk_load_kg <= 20.0:
        raise PhysicsError(f"trunk_load_kg = {trunk_load_kg} kg is not within 0 to 20 kg")
    top = Section(robot.path, "", robot.document)
    top.only(*SECTIONS)
    supply = top.section("supply")
    supply.only("voltage_v", "resistance_ohm")
    fed = Supply(
        supply.number("voltage_v", "V", 1.0, 50.0),
        supply.number("resistance_ohm", "ohm", 0.0, 5.0),
    )
    if "body" in top:
        if "trunk" in top or trunk_load_kg:
            raise PhysicsError(f"{robot.path}: a rig of [[body]] has a fixed base and no trunk")
        rig = read_rig(top)
        rest = MappingProxyType(dict(rig.rest_rad))
        return PhysicalRobot(
            name=robot.name,
            trunk=None,
            bodies=rig.bodies,
            legs=(),
            joints=_joints(robot, rig.limits_rad),
            contact=AIR,
            supply=fed,
            rest_rad=rest,
            neutral_rad=rest,
            payload=rig.payload,
        )
    body = read_hexapod(top, trunk_load_kg)
    names = [leg.name for leg in body.legs]
    legs = {f"{name}.{segment}": (name, segment) for name in names for segment in SEGMENTS}
    return PhysicalRobot(
        name=robot.name,
        trunk=body.trunk,
        bodies=body.bodies,
        legs=body.legs,
        joints=_joints(robot, body.limits_rad, legs),
        contact=body.contact,
        supply=fed,
        rest_rad=MappingProxyType(dict(body.rest_rad)),
        neutral_rad=MappingProxyType(dict(body.neutral_rad)),
    )


def _joints(
    robot: Robot,
    limits_rad: Mapping[str, tuple[float, float]],
    legs: Mapping[str, tuple[str, str]] | None = None,
) -> tuple[Joint, ...]:
    drives = Section(robot.path, "", robot.document).section("drive")
    missing = sorted(set(limits_rad) - set(robot.by_joint))
    foreign = sorted(set(robot.by_joint) - set(limits_rad))
    if missing or foreign:
        nobody = "no body is" if legs is None else "no leg has"
        what = f"joint {missing[0]} has no servo" if missing else f"{nobody} {foreign[0]}"
        raise PhysicsError(f"{robot.path}: [[servo]] {what}: each joint needs one")
    models = {mount.model for mount in robot.servos}
    known = {model: read_drive(drives.section(model)) for model in sorted(models)}
    joints = []
    for mount in robot.servos:
        leg, segment = (legs or {}).get(mount.joint, ("", mount.joint))
        reach = servo_reach_rad(robot.tables[mount.servo_id])
        ends = sorted(mount.to_joint(side * reach) for side in (-1.0, 1.0))
        lower = max(ends[0], limits_rad[mount.joint][0])
        upper = min(ends[1], limits_rad[mount.joint][1])
        if not lower < upper:
            raise PhysicsError(
                f"{robot.path}: [[servo]] id {mount.servo_id}: zero_rad = {mount.zero_rad} rad "
                f"leaves {mount.joint} no range within {ends[0]:.3f} to {ends[1]:.3f} rad"
            )
        joints.append(
            Joint(
                mount.joint,
                leg,
                segment,
                mount.servo_id,
                mount.direction,
                mount.zero_rad,
                lower,
                upper,
                known[mount.model],
            )
        )
    return tuple(joints)


def servo_reach_rad(table: ControlTable) -> float:
    """How far a servo turns either side of its centre: 150 degrees for AX-12A and XL-320.

    Servos that tell positions over a whole turn or more have no stop of their own.
    """
    register = table["goal_position"]
    span = (register.maximum + 1 - register.minimum) * register.si_scale
    return 0.5 * span if span < 2.0 * math.pi - 0.1 else math.inf
