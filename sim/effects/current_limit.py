"""The bridge gives no more than a current."""

from __future__ import annotations

import math
from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="current_limit",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="drive",
    equation="|current| <= limit",
    source="current limit of a bridge; in no register of the smaller models",
    parameters=(
        Parameter(
            "limit_a",
            "A",
            0.02,
            20.0,
            typical=0.8,
            off=math.inf,
            source="half the stall current of small servos",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, current_cap_a=min(d.current_cap_a, v["limit_a"]))),
)
