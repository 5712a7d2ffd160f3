"""A body's centre of mass is not where the operator believes."""

from __future__ import annotations

from dataclasses import replace

from ..shapes import MassProperties
from .effect import Effect, Group, Parameter, Scope, Values, on_masses


def moved(mass: MassProperties, values: Values) -> MassProperties:
    """Move the centre of mass; the inertia about it stays."""
    x, y, z = mass.centre_m
    return replace(mass, centre_m=(x + values["x_m"], y + values["y_m"], z + values["z_m"]))


EFFECT = Effect(
    name="com_offset",
    group=Group.BODY,
    scope=Scope.BODY,
    enters="body",
    equation="c = c of the robot file + (x, y, z), in the body's frame",
    source="rigid body; the inertia about the centre stays",
    parameters=tuple(
        Parameter(
            f"{axis}_m",
            "m",
            -0.1,
            0.1,
            typical=0.005,
            off=0.0,
            source="assumed: 3 to 5 mm on a small robot",
        )
        for axis in "xyz"
    ),
    change=on_masses(moved),
)
