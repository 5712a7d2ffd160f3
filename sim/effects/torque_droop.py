"""The motor's torque falls behind its current as that grows; at stall it is as told."""

from __future__ import annotations

from dataclasses import replace

from ..drive.parameters import DriveParameters
from .effect import Effect, Group, Parameter, Scope, Values, on_drives


def change(drive: DriveParameters, values: Values) -> DriveParameters:
    """Bend torque over current, about the data sheet's stall current, where it stays."""
    stall_a = drive.data_sheet.stall_current_a
    before = drive.torque_droop_per_a * stall_a
    after = before + values["droop"]
    return replace(
        drive,
        torque_constant_nm_a=drive.torque_constant_nm_a * ((1.0 + after) / (1.0 + before)),
        torque_droop_per_a=drive.torque_droop_per_a + values["droop"] / stall_a,
    )


EFFECT = Effect(
    name="torque_droop",
    group=Group.ELECTRICAL,
    scope=Scope.JOINT,
    enters="drive",
    equation="torque = k i (1 + droop) / (1 + droop |i| / i_s), i_s the data sheet's stall current",
    source=(
        "stall torques at several voltages, ROBOTIS e-manual: current over torque is a line over "
        "current (XL330-M288: 2.64, 2.83, 2.90 A/(N m) at 1.11, 1.47, 1.74 A). MX-28, MX-64, XM540 "
        "and XL430 show none, those of AX-12A, XL-320 and the STS3215 of 12 V have one voltage"
    ),
    parameters=(
        Parameter(
            "droop",
            "(ratio)",
            0.0,
            2.0,
            typical=0.28,
            off=0.0,
            source=(
                "XL330-M288, a line through its three points; XC330: 0.01 to 1.04, XL330-M077: "
                "0.95, MX-106: 0.18"
            ),
        ),
    ),
    change=on_drives(change),
)
