"""The servo lets go when its duty has been high for too long."""

from __future__ import annotations

import math
from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="overload_shutdown",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="controller",
    equation="torque off once |duty| >= duty for time",
    source="overload shutdown, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "duty",
            "(ratio)",
            0.02,
            1.0,
            typical=0.9,
            off=math.inf,
            source="assumed",
        ),
        Parameter(
            "time_s",
            "s",
            0.05,
            30.0,
            typical=1.0,
            off=1.0,
            source="assumed",
            shape=True,
        ),
    ),
    change=on_drives(lambda d, v: replace(d, overload_duty=v["duty"], overload_time_s=v["time_s"])),
)
