"""A goal takes a while from the bus to the controller; what else is told holds at once."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="transport_delay",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="goal acts delay later",
    source="17 to 50 ms from command to motion, AX-12+, ROBOTIS forum",
    parameters=(
        Parameter(
            "delay_s",
            "s",
            0.0,
            0.2,
            typical=0.02,
            off=0.0,
            source="AX-12+ 17 to 50 ms, ROBOTIS forum",
        ),
    ),
    change=on_drives(lambda d, v: replace(d, delay_s=d.delay_s + v["delay_s"])),
)
