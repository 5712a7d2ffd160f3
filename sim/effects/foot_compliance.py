"""The tips of the feet are soft."""

from __future__ import annotations

import math
from dataclasses import replace

from ..tree import Leg
from .effect import Effect, Group, Parameter, Scope, Values, on_legs


def softened(leg: Leg, values: Values) -> Leg:
    """Give the tip a spring and a damper."""
    stiffness, damping = values["stiffness_n_m"], values["damping_n_s_m"]
    if math.isinf(stiffness):
        return leg
    return replace(leg, foot=replace(leg.foot, stiffness_n_m=stiffness, damping_n_s_m=damping))


EFFECT = Effect(
    name="foot_compliance",
    group=Group.BODY,
    scope=Scope.LEG,
    enters="contact",
    equation="F = stiffness x depth + damping x speed, along the normal",
    source="Kelvin and Voigt's spring beside a damper, as the engine's contact has it",
    parameters=(
        Parameter(
            "stiffness_n_m",
            "N/m",
            200.0,
            1e6,
            typical=3000.0,
            off=math.inf,
            source="rubber tips 0.5 to 20 kN/m, assumed: nobody published a measurement",
        ),
        Parameter(
            "damping_n_s_m",
            "N s/m",
            0.0,
            500.0,
            typical=5.0,
            off=0.0,
            source="assumed: a tenth of critical for a kilogram on a tip",
        ),
    ),
    change=on_legs(softened),
)
