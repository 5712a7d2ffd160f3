"""The ground, or a rig's stand, is not level."""

from __future__ import annotations

from dataclasses import replace

from ..tree import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Lean the ground."""
    ground = replace(
        robot.ground,
        pitch_rad=robot.ground.pitch_rad + values["pitch_rad"],
        roll_rad=robot.ground.roll_rad + values["roll_rad"],
    )
    return replace(robot, ground=ground)


EFFECT = Effect(
    name="ground_tilt",
    group=Group.BODY,
    scope=Scope.ROBOT,
    enters="contact",
    equation="gravity leans by pitch and roll in the ground's frame",
    source="pitch: rises towards +y (forward); roll: falls towards +x (right)",
    parameters=(
        Parameter(
            "pitch_rad",
            "rad",
            -0.6,
            0.6,
            typical=0.017,
            off=0.0,
            source="a floor or a table leans by 2 degrees at most, assumed; beyond is a slope",
        ),
        Parameter(
            "roll_rad",
            "rad",
            -0.6,
            0.6,
            typical=0.0,
            off=0.0,
            source="as pitch_rad",
        ),
    ),
    change=change,
)
