"""Load friction that knows what the gear passes on, inertia and all, not gravity's torque alone."""

from __future__ import annotations

from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives, shared


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Let what the gear passes on stand for a share of what came from outside until now."""
    return replace(drive, load_of_gear=shared(drive.load_of_gear, values["share"]))


EFFECT = Effect(
    name="load_of_gear",
    group=Group.FRICTION,
    scope=Scope.JOINT,
    enters="drive",
    equation="external torque of friction = (1 - share) (gravity + cable) - share gear torque",
    source="gravity's and a cable's in Duclusaud et al. (2025), who swing a pendulum; teeth and "
    "bearings know only what they pass on; assumed",
    parameters=(
        Parameter(
            "share",
            "(ratio)",
            0.0,
            1.0,
            typical=0.5,
            off=0.0,
            source="all of it, or none: the middle; assumed",
        ),
    ),
    note=(
        "Without any load friction it does nothing, and behind a physics engine it is always 1. A "
        "diagnosis fits it as a tolerance beside load friction."
    ),
    change=on_drives(change),
)
