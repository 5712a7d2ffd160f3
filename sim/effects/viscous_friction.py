"""Viscous friction, more or less of it than the robot file says."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="viscous_friction",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="friction level + more |w|",
    source="viscous term of the friction models of Duclusaud et al. (2025)",
    parameters=(
        Parameter(
            "more_nm_s_rad",
            "N m s/rad",
            -1.0,
            1.0,
            typical=0.02,
            off=0.0,
            source="published fits of small servos: 0.005 to 0.05 N m s/rad",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d,
            friction=replace(
                d.friction,
                viscous_nm_s_rad=max(0.0, d.friction.viscous_nm_s_rad + v["more_nm_s_rad"]),
            ),
        )
    ),
)
