"""A limit on how fast the goal moves that nobody set."""

from __future__ import annotations

import math
from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="velocity_limit",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="|d goal / dt| <= limit",
    source="moving speed and profile velocity, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "limit_rad_s",
            "rad/s",
            0.1,
            200.0,
            typical=3.0,
            off=math.inf,
            source="no-load speeds of small servos; a register may hold 20 times as much",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(d, velocity_cap_rad_s=min(d.velocity_cap_rad_s, v["limit_rad_s"]))
    ),
)
