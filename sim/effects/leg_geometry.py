"""A leg is longer or shorter, or mounted at another angle, than the file says."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from ..hexapod import tip_shape
from ..tree import SEGMENTS, Leg, PhysicalRobot
from .effect import Effect, Group, Parameter, Scope, Values


def change(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
    """Move joints and tips along the links; masses stay where they are on their links."""
    more = {segment: values[f"{segment}_m"] for segment in SEGMENTS}
    if not any(values.values()):
        return robot
    legs = []
    for leg in robot.legs:
        if leg.name not in where:
            legs.append(leg)
            continue
        lengths = {segment: leg.lengths_m[segment] + more[segment] for segment in SEGMENTS}
        changed = replace(
            leg, yaw_rad=leg.yaw_rad + values["yaw_rad"], lengths_m=MappingProxyType(lengths)
        )
        legs.append(changed)
        robot = _relimbed(robot, changed)
    return replace(robot, legs=tuple(legs))


def _relimbed(robot: PhysicalRobot, leg: Leg) -> PhysicalRobot:
    coxa, femur, tibia = (robot.body(f"{leg.name}.{segment}") for segment in SEGMENTS)
    shapes = (*tibia.shapes[:-1], tip_shape(leg.foot, leg.lengths_m["tibia"]))
    return robot.with_bodies(
        replace(coxa, yaw_rad=leg.yaw_rad),
        replace(femur, at_m=(leg.lengths_m["coxa"], 0.0, 0.0)),
        replace(tibia, at_m=(leg.lengths_m["femur"], 0.0, 0.0), shapes=shapes),
    )


EFFECT = Effect(
    name="leg_geometry",
    group=Group.BODY,
    scope=Scope.LEG,
    enters="body",
    equation="length = length of the robot file + difference, by link",
    source="kinematic calibration; masses keep their places on the links",
    parameters=(
        *(
            Parameter(
                f"{segment}_m",
                "m",
                -0.015,
                0.015,
                typical=0.002,
                off=0.0,
                source="assumed: a hole off by a millimetre or two, a worn tip",
            )
            for segment in SEGMENTS
        ),
        Parameter(
            "yaw_rad",
            "rad",
            -0.2,
            0.2,
            typical=0.0,
            off=0.0,
            source="assumed: a bracket screwed on askew",
        ),
    ),
    change=change,
)
