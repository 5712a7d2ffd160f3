"""A rig of one joint as the compiled rollouts see it: an inertia and gravity's torque."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .condition import under
from .entries import PhysicsError
from .tree import PhysicalRobot


@dataclass(frozen=True, slots=True)
class OneJointLoad:
    """What hangs on a joint, in the joint's frame.

    Gravity turns the joint with ``-gravity_nm * sin(q - centre_rad)`` at the joint angle ``q``: it
    hangs at ``centre_rad``.
    """

    inertia_kg_m2: float  #: of all that moves about the joint's axis
    gravity_nm: float
    centre_rad: float
    moment_nm: float  #: weight times lever: ``gravity_nm`` if the axis lay level


def one_joint_load(
    robot: PhysicalRobot, condition: Mapping[str, Any] | None = None
) -> OneJointLoad:
    """The load on the only joint of a rig under a recording's condition.

    Raises :class:`PhysicsError` for a robot with more joints, or nothing that moves.
    """
    robot = under(robot, condition or {})
    if robot.trunk is not None or len(robot.bodies) != 1:
        raise PhysicsError(
            f"{robot.name} has {len(robot.bodies)} joints: only a rig of one joint on a fixed base "
            "is a load of one joint"
        )
    (body,) = robot.bodies
    mass = robot.mass_of(body)
    if mass.mass_kg <= 0.0:
        raise PhysicsError(
            f"{robot.name}: body {body.name} has no mass: give it mass_kg, or a payload_kg"
        )
    axis, centre = np.array(body.axis), np.array(mass.centre_m)
    arm = centre - axis * (axis @ centre)  # at right angles to the axis
    inertia = float(axis @ mass.tensor_kg_m2 @ axis + mass.mass_kg * (arm @ arm))
    gravity = np.array(robot.ground.gravity_m_s2)
    pull = gravity - axis * (axis @ gravity)
    torque = mass.mass_kg * float(np.linalg.norm(arm) * np.linalg.norm(pull))
    hangs = math.atan2(float(axis @ np.cross(arm, pull)), float(arm @ pull)) if torque else 0.0
    if inertia <= 0.0:
        raise PhysicsError(
            f"{robot.name}: inertia_kg_m2 of body {body.name} about its axis is 0: give it one, or "
            "a weight off the axis"
        )
    moment = mass.mass_kg * float(np.linalg.norm(arm) * np.linalg.norm(gravity))
    return OneJointLoad(inertia, torque, hangs, moment)
