"""A limit on duty that nobody set."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="torque_limit",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="|duty| <= duty",
    source="torque limit and PWM limit, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "duty",
            "(ratio)",
            0.02,
            1.0,
            typical=0.6,
            off=1.0,
            source="the whole range of the register",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, duty_cap=min(d.duty_cap, v["duty"]))),
)
