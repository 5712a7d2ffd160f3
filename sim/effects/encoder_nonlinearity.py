"""The sensor is not linear: a wave over the turn."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="encoder_nonlinearity",
    group=Group.SENSING,
    scope=Scope.JOINT,
    enters="sensor",
    equation="sensed angle = angle + amplitude sin(periods angle + phase)",
    source="off-centre magnets and potentiometer tracks",
    parameters=(
        Parameter(
            "amplitude_rad",
            "rad",
            0.0,
            0.5,
            typical=0.01,
            off=0.0,
            source="assumed: 0.5 deg",
        ),
        Parameter(
            "periods",
            "(ratio)",
            0.5,
            12.0,
            typical=1.0,
            off=1.0,
            source="once or twice a turn for magnets",
            shape=True,
        ),
        Parameter(
            "phase_rad",
            "rad",
            -3.2,
            3.2,
            typical=0.0,
            off=0.0,
            source="where the wave begins",
            shape=True,
        ),
    ),
    change=on_drives(
        lambda d, v: replace(
            d, wave_rad=v["amplitude_rad"], wave_periods=v["periods"], wave_phase_rad=v["phase_rad"]
        )
    ),
)
