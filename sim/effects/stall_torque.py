"""The motor gives more or less torque at stall than the data sheet says, its voltage as told."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="stall_torque",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="drive",
    equation="k_t = scale x k_t of the base, k_e as it is",
    source="a stall torque may be the shaft's, or the motor's before friction takes its part",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.5,
            2.0,
            typical=0.95,
            off=1.0,
            source="friction takes 6 % of an XL-320's motor at stall; bounds assumed",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(d, torque_constant_nm_a=d.torque_constant_nm_a * v["scale"])
    ),
)
