"""The ground is soft: a mat, a carpet, foam."""

from __future__ import annotations

import math
from dataclasses import replace

from ..tree import PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Give the ground a spring and a damper under every contact."""
    stiffness, damping = values["stiffness_n_m"], values["damping_n_s_m"]
    if math.isinf(stiffness):
        return robot
    ground = replace(robot.ground, stiffness_n_m=stiffness, damping_n_s_m=damping)
    return replace(robot, ground=ground)


EFFECT = Effect(
    name="ground_compliance",
    group=Group.BODY,
    scope=Scope.ROBOT,
    enters="contact",
    equation="1/k = 1/stiffness + 1/k of the foot; dampings add",
    source="springs in series, as the engine's contact has it",
    parameters=(
        Parameter(
            "stiffness_n_m",
            "N/m",
            200.0,
            1e6,
            typical=5000.0,
            off=math.inf,
            source="assumed: foam to linoleum under a tip",
        ),
        Parameter(
            "damping_n_s_m",
            "N s/m",
            0.0,
            500.0,
            typical=10.0,
            off=0.0,
            source="assumed",
        ),
    ),
    change=change,
)
