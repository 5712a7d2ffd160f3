"""A dead zone in the position law that the registers do not tell."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="dead_zone",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="duty = 0 while |error| <= margin of the registers + margin",
    source="compliance margin, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "margin_rad",
            "rad",
            0.0,
            0.2,
            typical=0.0051,
            off=0.0,
            source="one count of 0.29 deg, ROBOTIS e-manual",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, margin_more_rad=d.margin_more_rad + v["margin_rad"])),
)
