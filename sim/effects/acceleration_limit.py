"""A limit on how fast the goal's speed changes that nobody set."""

from __future__ import annotations

import math
from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """The least of the limits there are."""
    cap = min(drive.acceleration_cap_rad_s2, values["limit_rad_s2"])
    return replace(drive, acceleration_cap_rad_s2=cap)


EFFECT = Effect(
    name="acceleration_limit",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="|d^2 goal / dt^2| <= limit",
    source="goal acceleration and profile acceleration, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "limit_rad_s2",
            "rad/s^2",
            0.3,
            1000.0,
            typical=20.0,
            off=math.inf,
            source="a register of 1 to 254 in steps of 0.15 rad/s^2 spans 0.15 to 38",
        ),
    ),
    change=on_drives(change),
)
