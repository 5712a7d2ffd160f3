"""An integral term that the registers do not tell."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="integral_action",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="duty + gain x integral of the error",
    source="PID position law, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "gain_per_rad_s",
            "1/(rad s)",
            0.0,
            100.0,
            typical=2.0,
            off=0.0,
            source="assumed",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d, integral_more_per_rad_s=d.integral_more_per_rad_s + v["gain_per_rad_s"]
        )
    ),
)
