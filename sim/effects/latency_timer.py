"""The adapter holds replies back."""

from __future__ import annotations

from dataclasses import replace

from ..robot import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Change how the bus reads."""
    return replace(robot, reading=replace(robot.reading, latency_timer_s=values["timer_s"]))


EFFECT = Effect(
    name="latency_timer",
    group=Group.SENSING,
    scope=Scope.BUS,
    enters="bus",
    equation="reply reaches the host up to timer later",
    source="latency timer of FTDI adapters: 16 ms, 1 ms when set",
    parameters=(
        Parameter(
            "timer_s",
            "s",
            0.0,
            0.3,
            typical=0.016,
            off=0.0,
            source="FTDI: 1 to 255 ms",
        ),
    ),
    change=change,
)
