"""The supply has a source resistance, beyond that of the robot file."""

from __future__ import annotations

from dataclasses import replace

from ..robot import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Put a resistance in series with the supply."""
    resistance = robot.supply.resistance_ohm + values["resistance_ohm"]
    return replace(robot, supply=replace(robot.supply, resistance_ohm=resistance))


EFFECT = Effect(
    name="voltage_sag",
    group=Group.ELECTRICAL,
    scope=Scope.ROBOT,
    enters="drive",
    equation="V at the terminals = V - resistance x current",
    source="Thevenin source",
    parameters=(
        Parameter(
            "resistance_ohm",
            "ohm",
            0.0,
            30.0,
            typical=0.3,
            off=0.0,
            source="0.05 to 0.5 ohm for pack and wires, more for a bad contact; judgement",
        ),
    ),
    change=change,
)
