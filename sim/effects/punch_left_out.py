"""A position law that adds only a part of the punch its register holds, or none of it."""

from __future__ import annotations

from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives, shared


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Leave a share of what is added until now out of the duty."""
    return replace(drive, punch_left_out=shared(drive.punch_left_out, values["share"]))


EFFECT = Effect(
    name="punch_left_out",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="duty = sign(error) ((1 - share) punch + gain (|error| - margin))",
    source="the law of the AX-12A, ROBOTIS e-manual; of servos with PID gains nobody documents it",
    parameters=(
        Parameter(
            "share",
            "(ratio)",
            0.0,
            1.0,
            typical=0.5,
            off=0.0,
            source="all of it is added, or none: the middle; assumed",
        ),
    ),
    change=on_drives(change),
)
