"""The sensor or the horn is mounted turned."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="zero_offset",
    group=Group.SENSING,
    scope=Scope.JOINT,
    enters="sensor",
    equation="sensed angle = angle + offset",
    source="horns are splined; potentiometers have an offset",
    parameters=(
        Parameter(
            "offset_rad",
            "rad",
            -0.6,
            0.6,
            typical=0.0175,
            off=0.0,
            source="up to 2 deg; judgement",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, zero_offset_rad=d.zero_offset_rad + v["offset_rad"])),
)
