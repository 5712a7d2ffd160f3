"""Coulomb friction, more or less of it than the robot file says."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="coulomb_friction",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="friction level + more",
    source="Coulomb term of the friction models of Duclusaud et al. (2025)",
    parameters=(
        Parameter(
            "more_nm",
            "N m",
            -1.0,
            1.0,
            typical=0.02,
            off=0.0,
            source="published XL-320 fits: 0.02 to 0.03 N m",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d,
            friction=replace(d.friction, coulomb_nm=max(0.0, d.friction.coulomb_nm + v["more_nm"])),
        )
    ),
)
