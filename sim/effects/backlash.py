"""Backlash: play between the gear's teeth."""

from __future__ import annotations

import math
from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives

TOOTH_STIFFNESS_NM_RAD = 250.0  #: of teeth that touch, in a gear that is else rigid; assumed
TOOTH_DAMPING_NM_S_RAD = 0.05  #: assumed: they hardly bounce


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Widen the dead zone; a rigid gear gets teeth, which no rigid body may touch with."""
    width = values["width_rad"]
    if width > 0.0 and math.isinf(drive.gear_stiffness_nm_rad):
        drive = replace(
            drive,
            gear_stiffness_nm_rad=TOOTH_STIFFNESS_NM_RAD,
            gear_damping_nm_s_rad=TOOTH_DAMPING_NM_S_RAD,
        )
    return replace(drive, backlash_rad=drive.backlash_rad + width)


EFFECT = Effect(
    name="backlash",
    group=Group.GEAR,
    scope=Scope.JOINT,
    enters="drive",
    equation="gear torque = 0 while |twist| < width / 2; beyond, teeth push and never pull",
    source="dead zone between two masses, Nordin and Gutman, Automatica 38 (2002)",
    parameters=(
        Parameter(
            "width_rad",
            "rad",
            0.0,
            0.25,
            typical=math.radians(0.6),
            off=0.0,
            source="0.25 deg (XM540) to 1.3 deg (STS3215 under load), published measurements; "
            "worn gears up to 14 deg: assumed",
        ),
    ),
    change=on_drives(change),
)
