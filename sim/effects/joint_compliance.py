"""Compliance of gear and link: the rotor and the output shaft are joined by a spring."""

from __future__ import annotations

from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Put a spring in series with the gear, and a damper beside the gear's own."""
    compliance = values["compliance_rad_nm"]
    stiffness = drive.gear_stiffness_nm_rad
    if compliance > 0.0:
        stiffness = 1.0 / (1.0 / stiffness + compliance)
    damping = drive.gear_damping_nm_s_rad + values["damping_nm_s_rad"]
    return replace(drive, gear_stiffness_nm_rad=stiffness, gear_damping_nm_s_rad=damping)


EFFECT = Effect(
    name="joint_compliance",
    group=Group.GEAR,
    scope=Scope.JOINT,
    enters="drive",
    equation="torque = k twist + d twist rate, 1 / k = 1 / k of the base + compliance",
    source="two masses and a spring, Spong, ASME J. Dyn. Syst. 109 (1987)",
    parameters=(
        Parameter(
            "compliance_rad_nm",
            "rad/(N m)",
            0.0,
            2.0,
            typical=1.0 / 30.0,
            off=0.0,
            source="judgement: gears of small servos are 15 to 60 N m/rad; assumed",
        ),
        Parameter(
            "damping_nm_s_rad",
            "N m s/rad",
            0.0,
            0.5,
            typical=0.005,
            off=0.0,
            source="assumed: a tenth of critical for a light link",
        ),
    ),
    note=(
        "The spring lies before the angle sensor, which is on the output shaft: what gives way "
        "beyond it (a link, a horn) moves no sensor at rest, and no effect here is that."
    ),
    change=on_drives(change),
)
