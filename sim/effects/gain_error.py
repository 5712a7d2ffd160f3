"""The position law has another gain than the registers say."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="gain_error",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="gains = scale x gains of the registers",
    source="scale of a gain register, not known for many models",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.1,
            10.0,
            typical=1.2,
            off=1.0,
            source="assumed",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, gain_scale=d.gain_scale * v["scale"])),
)
