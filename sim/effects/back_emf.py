"""The motor makes more or less voltage per speed than the data sheet says, its torque as told."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="back_emf",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="drive",
    equation="k_e = scale x k_e of the base, k_t as it is",
    source="k_t of a data sheet is the stall torque's, k_e the no-load speed's: losses part them",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.5,
            2.0,
            typical=1.1,
            off=1.0,
            source="assumed: no-load figures of data sheets within 10 %",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, back_emf_v_s_rad=d.back_emf_v_s_rad * v["scale"])),
)
