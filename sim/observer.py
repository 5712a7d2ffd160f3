"""What an outside observer sees of a robot: pose, forces, and a camera's place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .shapes import Vector
from .watch import Contacts

Quaternion = tuple[float, float, float, float]  #: x, y, z, w
Frame = tuple[Vector, Quaternion]


@dataclass(frozen=True, slots=True)
class Camera:
    """Where a picture is taken from (world frame) and its size; ``field_deg`` is up and down."""

    eye_m: Vector
    target_m: Vector
    field_deg: float
    width_px: int
    height_px: int


def pose_seen(position: Vector, rotation: Sequence[float]) -> dict[str, float]:
    """``mocap/...`` of a trunk frame in the world; ``rotation`` is its matrix, row by row.

    Yaw is the heading about +z, pitch the nose-up angle about x (right), roll the angle about y
    (forward), positive with the right side down; all zero when level and facing +y.
    """
    x, y, z = position
    return {
        "mocap/base_x_m": x,
        "mocap/base_y_m": y,
        "mocap/base_z_m": z,
        "mocap/base_roll_rad": math.atan2(-rotation[6], rotation[8]),
        "mocap/base_pitch_rad": math.asin(max(-1.0, min(1.0, rotation[7]))),
        "mocap/base_yaw_rad": math.atan2(-rotation[1], rotation[4]),
    }


def forces_seen(contacts: Contacts, feet: Mapping[str, str], *, trunk: bool) -> dict[str, float]:
    """``contact/...``: of the ground on each leg and on the rest, of the robot on itself by pair.

    ``feet``: legs by the body whose contacts are theirs; without a ``trunk`` there is no rest.
    """
    seen = {f"contact/{leg}_n": contacts.ground_n.get(body, 0.0) for body, leg in feet.items()}
    if trunk:
        seen["contact/trunk_n"] = sum(
            force for body, force in contacts.ground_n.items() if body not in feet
        )
    seen["contact/self_n"] = sum(contacts.own_n.values())
    for (one, other), force in contacts.own_n.items():
        seen[f"contact/self/{one}/{other}_n"] = force
    return seen


def lean_rad(orientation: Quaternion) -> float:
    """Angle between a frame's z axis and the world's [rad]."""
    x, y, _, _ = orientation
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))
