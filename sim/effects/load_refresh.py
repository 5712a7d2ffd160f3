"""The load register is made anew in a period, and held."""

from __future__ import annotations

from dataclasses import replace

from ..robot import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Change how the bus reads."""
    return replace(robot, reading=replace(robot.reading, load_refresh_s=values["period_s"]))


EFFECT = Effect(
    name="load_refresh",
    group=Group.SENSING,
    scope=Scope.BUS,
    enters="bus",
    equation="load(t) = load at the last multiple of the period",
    source="130 ms, the figures of Nguyenova (2019) on AX-12A",
    parameters=(
        Parameter(
            "period_s",
            "s",
            0.0,
            3.0,
            typical=0.13,
            off=0.0,
            source="130 ms measured",
        ),
    ),
    change=change,
)
