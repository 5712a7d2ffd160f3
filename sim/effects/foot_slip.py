"""A foot's friction is not what the operator believes."""

from __future__ import annotations

from dataclasses import replace

from ..tree import Leg
from .effect import Effect, Group, Parameter, Scope, Values, on_legs


def worn(leg: Leg, values: Values) -> Leg:
    """Scale the friction coefficient of the foot."""
    return replace(leg, foot=replace(leg.foot, friction=leg.foot.friction * values["scale"]))


EFFECT = Effect(
    name="foot_slip",
    group=Group.BODY,
    scope=Scope.LEG,
    enters="contact",
    equation="friction coefficient = scale x that of the robot file",
    source="Coulomb's friction of a contact",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.05,
            5.0,
            typical=0.5,
            off=1.0,
            source="coefficients of 0.4 to 1.0 are common, assumed",
        ),
    ),
    change=on_legs(worn),
)
