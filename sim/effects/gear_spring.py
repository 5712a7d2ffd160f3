"""The gear's own spring and damper are not as the robot file says: nobody measures them."""

from __future__ import annotations

from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Scale stiffness and damping; a rigid gear stays rigid."""
    return replace(
        drive,
        gear_stiffness_nm_rad=drive.gear_stiffness_nm_rad * values["stiffness_scale"],
        gear_damping_nm_s_rad=drive.gear_damping_nm_s_rad * values["damping_scale"],
    )


EFFECT = Effect(
    name="gear_spring",
    group=Group.GEAR,
    scope=Scope.JOINT,
    enters="drive",
    equation="torque = stiffness_scale k twist + damping_scale d twist rate",
    source="two masses and a spring, Spong, ASME J. Dyn. Syst. 109 (1987)",
    parameters=(
        Parameter(
            "stiffness_scale",
            "(ratio)",
            0.05,
            20.0,
            typical=2.0,
            off=1.0,
            source="no data sheet tells a gear's stiffness; assumed",
        ),
        Parameter(
            "damping_scale",
            "(ratio)",
            0.05,
            20.0,
            typical=2.0,
            off=1.0,
            source="no data sheet tells a gear's damping; assumed",
        ),
    ),
    change=on_drives(change),
)
