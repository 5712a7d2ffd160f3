"""Stribeck friction: sticking, and friction that falls with velocity."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="stribeck_friction",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="friction level + exp(-|w / velocity|) stribeck",
    source="model M2 of Duclusaud et al. (2025)",
    parameters=(
        Parameter(
            "stribeck_nm",
            "N m",
            0.0,
            3.0,
            typical=0.03,
            off=0.0,
            source="published fits of small servos; assumed for others",
        ),
        Parameter(
            "velocity_rad_s",
            "rad/s",
            0.005,
            5.0,
            typical=0.2,
            off=0.2,
            source="published fits: 0.1 to 2.9 rad/s",
            shape=True,
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d,
            friction=replace(
                d.friction,
                stribeck_nm=d.friction.stribeck_nm + v["stribeck_nm"],
                stribeck_velocity_rad_s=v["velocity_rad_s"]
                if v["stribeck_nm"] > 0.0
                else d.friction.stribeck_velocity_rad_s,
            ),
        )
    ),
)
