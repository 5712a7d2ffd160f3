"""A weight nobody told of: on a hexapod's trunk, or where a rig carries its payload."""

from __future__ import annotations

from dataclasses import replace

from ..shapes import MassProperties, Vector, together
from ..tree import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Add a point mass to the trunk, to the payload's place, or to the outermost body's centre."""
    if values["mass_kg"] == 0.0:
        return robot
    offset = (values["x_m"], values["y_m"], values["z_m"])
    if robot.trunk is not None:
        weight = _point(values["mass_kg"], (0.0, 0.0, 0.0), offset)
        trunk = replace(robot.trunk, mass=together(robot.trunk.mass, weight))
        return replace(robot, trunk=trunk)
    body, at = robot.bodies[-1], robot.bodies[-1].mass.centre_m
    if robot.payload is not None and robot.payload.body is not None:
        body, at = robot.body(robot.payload.body), robot.payload.at_m
    weight = _point(values["mass_kg"], at, offset)
    return robot.with_bodies(replace(body, mass=together(body.mass, weight)))


def _point(mass_kg: float, at: Vector, offset: Vector) -> MassProperties:
    x, y, z = (a + b for a, b in zip(at, offset, strict=True))
    return MassProperties(mass_kg, (x, y, z), (0.0,) * 6)


EFFECT = Effect(
    name="payload",
    group=Group.BODY,
    scope=Scope.ROBOT,
    enters="body",
    equation="a point mass at (x, y, z) from its place",
    source="trunk frame on a hexapod; from [payload] at_m on a rig",
    parameters=(
        Parameter(
            "mass_kg",
            "kg",
            0.0,
            5.0,
            typical=0.1,
            off=0.0,
            source="330 g and 46 g are batteries of the reference robots",
        ),
        *(
            Parameter(f"{axis}_m", "m", -0.2, 0.2, typical=0.0, off=0.0, source="assumed")
            for axis in "xyz"
        ),
    ),
    change=change,
)
