"""Friction that grows with the torque through the gear, alike in both directions."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="load_friction",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="friction level + ratio |motor torque - external torque|",
    source="model M3 of Duclusaud et al. (2025)",
    parameters=(
        Parameter(
            "ratio",
            "(ratio)",
            0.0,
            0.9,
            typical=0.15,
            off=0.0,
            source="published: XL-320 0.22",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d,
            friction=replace(
                d.friction,
                load_motor=d.friction.load_motor + v["ratio"],
                load_external=d.friction.load_external + v["ratio"],
            ),
        )
    ),
)
