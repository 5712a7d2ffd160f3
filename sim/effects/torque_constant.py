"""The motor gives more or less torque per current than the data sheet says."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="torque_constant",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="drive",
    equation="k = scale x k of the base, and back-EMF with it",
    source="strength of the magnets; both constants are the same flux",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.3,
            3.0,
            typical=1.2,
            off=1.0,
            source="assumed: specimens within 10 %, data sheets within 20 %",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d,
            torque_constant_nm_a=d.torque_constant_nm_a * v["scale"],
            back_emf_v_s_rad=d.back_emf_v_s_rad * v["scale"],
        )
    ),
)
