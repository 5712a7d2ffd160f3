"""A cable that pulls the output shaft towards an angle."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="cable_drag",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="torque = stiffness (rest - angle)",
    source="Hookean cable; assumed",
    parameters=(
        Parameter(
            "stiffness_nm_rad",
            "N m/rad",
            0.0,
            1.0,
            typical=0.02,
            off=0.0,
            source="assumed",
        ),
        Parameter(
            "rest_rad",
            "rad",
            -3.2,
            3.2,
            typical=0.0,
            off=0.0,
            source="angle of the servo at which the cable is slack",
            shape=True,
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d, cable_stiffness_nm_rad=v["stiffness_nm_rad"], cable_rest_rad=v["rest_rad"]
        )
    ),
)
