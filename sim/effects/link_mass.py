"""A link is heavier or lighter than the operator believes."""

from __future__ import annotations

from dataclasses import replace

from ..shapes import MassProperties
from .effect import Effect, Group, Parameter, Scope, Values, on_masses


def scaled(mass: MassProperties, values: Values) -> MassProperties:
    """Scale the mass and, with the shape kept, the inertia."""
    scale = values["scale"]
    xx, yy, zz, xy, xz, yz = (moment * scale for moment in mass.inertia_kg_m2)
    return replace(mass, mass_kg=mass.mass_kg * scale, inertia_kg_m2=(xx, yy, zz, xy, xz, yz))


EFFECT = Effect(
    name="link_mass",
    group=Group.BODY,
    scope=Scope.BODY,
    enters="body",
    equation="m = scale x m of the robot file, I = scale x I",
    source="density wrong, shape right",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.05,
            5.0,
            typical=1.1,
            off=1.0,
            source="assumed: links are known to 10 %, a screw or a cable is forgotten",
        ),
    ),
    change=on_masses(scaled),
    note=(
        "The scale is that of the body alone. A weight that is put on it (`[payload]`, "
        "`payload_kg` of a recording) stays as it is; an effect `payload` that stands before this "
        "one in the file is part of the body by then."
    ),
)
