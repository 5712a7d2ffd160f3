"""Dry friction that gives way a little before it slips."""

from __future__ import annotations

from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Let friction give way further."""
    return replace(drive, breakaway_rad=drive.breakaway_rad + values["breakaway_rad"])


EFFECT = Effect(
    name="presliding",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="friction = level (bent + d bent/dt 4 ms) / breakaway, at most the level",
    source="Dupont, Hayward, Armstrong and Altpeter, IEEE Trans. Autom. Control 47(5), 2002",
    parameters=(
        Parameter(
            "breakaway_rad",
            "rad",
            0.0,
            0.003,
            typical=0.0005,
            off=0.0,
            source="teeth and bearings give way by tenths of a mrad at the output; assumed",
        ),
    ),
    change=on_drives(change),
)
