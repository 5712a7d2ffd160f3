"""Friction that grows with load, otherwise when driving than when driven back."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="directional_load_friction",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="friction level + |driving motor torque - backdriving external torque|",
    source="model M5 of Duclusaud et al. (2025)",
    parameters=(
        Parameter(
            "driving",
            "(ratio)",
            0.0,
            0.9,
            typical=0.15,
            off=0.0,
            source="assumed, about the load friction of an XL-320",
        ),
        Parameter(
            "backdriving",
            "(ratio)",
            0.0,
            2.0,
            typical=0.4,
            off=0.0,
            source="assumed: worm-like gears resist being driven back",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d,
            friction=replace(
                d.friction,
                load_motor=d.friction.load_motor + v["driving"],
                load_external=d.friction.load_external + v["backdriving"],
            ),
        )
    ),
)
