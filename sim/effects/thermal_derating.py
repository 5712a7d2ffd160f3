"""The winding warms over its case, and copper warmer is copper worse."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="thermal_derating",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="drive",
    equation="R = R0 (1 + alpha dT), time d(dT)/dt = heat resistance x loss - dT",
    source="two-node thermal model of a motor; copper 0.39 %/K",
    parameters=(
        Parameter(
            "heat_resistance_k_w",
            "K/W",
            0.0,
            500.0,
            typical=20.0,
            off=0.0,
            source="assumed: windings of a few grams",
        ),
        Parameter(
            "time_s",
            "s",
            0.2,
            300.0,
            typical=10.0,
            off=1.0,
            source="assumed",
            shape=True,
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d, winding_heat_resistance_k_w=v["heat_resistance_k_w"], winding_heat_time_s=v["time_s"]
        )
    ),
)
