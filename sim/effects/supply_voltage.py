"""The supply has another voltage than the operator typed in."""

from __future__ import annotations

from dataclasses import replace

from ..robot import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Scale the unloaded voltage of the supply."""
    supply = replace(robot.supply, voltage_v=robot.supply.voltage_v * values["scale"])
    return replace(robot, supply=supply)


EFFECT = Effect(
    name="supply_voltage",
    group=Group.ELECTRICAL,
    scope=Scope.ROBOT,
    enters="drive",
    equation="V = scale x V of the robot file",
    source="voltages of packs: 7.4 V nominal is 6.0 to 8.4 V",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.4,
            2.0,
            typical=0.9,
            off=1.0,
            source="a pack from empty to full",
        ),
    ),
    change=change,
)
