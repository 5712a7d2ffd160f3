"""Some reads fail and are logged as something."""

from __future__ import annotations

from dataclasses import replace

from ..robot import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Change how the bus reads."""
    return replace(robot, reading=replace(robot.reading, lost_share=values["share"]))


EFFECT = Effect(
    name="lost_samples",
    group=Group.SENSING,
    scope=Scope.BUS,
    enters="bus",
    equation="a share of the samples is garbage",
    source="failed reads logged as a constant, seen in published logs",
    parameters=(
        Parameter(
            "share",
            "(ratio)",
            0.0,
            0.5,
            typical=0.01,
            off=0.0,
            source="published logs: below a few percent",
        ),
    ),
    change=change,
)
