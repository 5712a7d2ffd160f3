"""Backlash: play between the gear's teeth."""

from __future__ import annotations

import math
from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="backlash",
    group=Group.GEAR,
    scope=Scope.JOINT,
    enters="drive",
    equation="gear torque = 0 while |twist| < width / 2",
    source="dead zone between two masses, Nordin and Gutman, Automatica 38 (2002)",
    parameters=(
        Parameter(
            "width_rad",
            "rad",
            0.0,
            0.1,
            typical=math.radians(0.6),
            off=0.0,
            source="0.25 deg (XM540) to 1.3 deg (STS3215 under load), published measurements",
        ),
    ),
    change=on_drives(lambda drive, values: replace(drive, backlash_rad=values["width_rad"])),
)
