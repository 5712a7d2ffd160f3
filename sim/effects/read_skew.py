"""Positions are of other instants than believed."""

from __future__ import annotations

from dataclasses import replace

from ..robot import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Change how the bus reads."""
    return replace(robot, reading=replace(robot.reading, skew_s=values["skew_s"]))


EFFECT = Effect(
    name="read_skew",
    group=Group.SENSING,
    scope=Scope.BUS,
    enters="bus",
    equation="the position shown at t is that of t + skew; below 0 an older one",
    source="18 joints read one after another are 18 instants",
    parameters=(
        Parameter(
            "skew_s",
            "s",
            -0.2,
            0.2,
            typical=0.005,
            off=0.0,
            source="a cycle of 13 to 19 ms on a hexapod",
        ),
    ),
    change=change,
)
