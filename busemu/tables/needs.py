"""What a servo needs of its table, so that a table that lacks it is refused when it is loaded.

A table without ``drive`` names registers only: good for looking at a bus, not for being a servo.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from .register import Register

#: How registers become a drive (``drive.law``), and the keys of ``drive`` that each needs.
LAWS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "compliance": (),
        "pid": ("p_gain_duty_per_rad", "i_gain_duty_per_rad_s", "d_gain_duty_s_per_rad"),
        "operating_modes": (
            "position_p_gain_duty_per_rad",
            "position_i_gain_duty_per_rad_s",
            "position_d_gain_duty_s_per_rad",
        ),
    }
)
_EVERY = (
    *("model_number", "firmware_version", "id", "baud_rate", "return_delay_time"),
    *("status_return_level", "temperature_limit", "min_voltage_limit", "max_voltage_limit"),
    *("shutdown", "torque_enable", "goal_position", "present_position", "present_temperature"),
    "moving",
)
_JOINT_WHEEL = (
    *("cw_angle_limit", "ccw_angle_limit", "max_torque", "torque_limit", "moving_speed"),
    *("present_speed", "present_load", "present_voltage", "punch"),
)
#: The registers that the rules of each law read or fill.
REGISTERS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "compliance": (
            *_JOINT_WHEEL,
            *("cw_compliance_margin", "ccw_compliance_margin"),
            *("cw_compliance_slope", "ccw_compliance_slope"),
        ),
        "pid": (*_JOINT_WHEEL, "p_gain", "i_gain", "d_gain"),
        "operating_modes": (
            *("operating_mode", "drive_mode", "homing_offset", "moving_threshold", "pwm_limit"),
            *("min_position_limit", "max_position_limit", "goal_pwm", "position_p_gain"),
            *("position_i_gain", "position_d_gain", "profile_velocity", "profile_acceleration"),
            *("realtime_tick", "moving_status", "present_pwm", "present_velocity"),
            *("velocity_trajectory", "position_trajectory", "present_input_voltage"),
        ),
    }
)
#: Goals that a value of ``operating_mode`` follows, if the model has it. Source: e-manual.
_GOALS = MappingProxyType({0: "goal_current", 1: "goal_velocity", 5: "goal_current"})
_LIMITS = MappingProxyType({"goal_current": "current_limit", "goal_velocity": "velocity_limit"})
#: A servo counts as far as this in a register, whatever its range. Source: e-manual.
COUNTS_TO: Mapping[str, int] = MappingProxyType({"realtime_tick": 32767})
_JOINT_WHEEL_COPIES = {"goal_position": "present_position", "torque_limit": "max_torque"}
#: Registers that a servo sets to what another one holds, by law.
COPIES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "compliance": _JOINT_WHEEL_COPIES,
        "pid": _JOINT_WHEEL_COPIES,
        "operating_modes": {"goal_pwm": "pwm_limit", **_LIMITS},
    }
)


def lacking(law: str, drive: Mapping[str, Any], registers: Mapping[str, Register]) -> list[str]:
    """The registers that a servo with this ``drive`` needs and does not have, sorted."""
    needed = {*_EVERY, *REGISTERS[law], *_optional(law, drive, registers)}
    return sorted(needed - set(registers))


def cramped(law: str, registers: Mapping[str, Register]) -> Iterator[str]:
    """What a servo of this law would put in registers that have too few bytes for it."""
    for name, top in COUNTS_TO.items():
        if name in registers and registers[name].raw_maximum < top:
            yield f"{name} has {registers[name].size} byte(s), and counts to {top}"
    for name, other in COPIES[law].items():
        if name in registers and registers[name].size < registers[other].size:
            yield f"{name} has fewer bytes than {other}, whose value it takes"


def _optional(
    law: str, drive: Mapping[str, Any], registers: Mapping[str, Register]
) -> Iterator[str]:
    """The registers that are needed because of others, or of what ``drive`` says."""
    if law != "operating_modes":
        if drive.get("turn_counts"):
            yield from ("multi_turn_offset", "resolution_divider")
        if "torque_ctrl_mode_enable" in registers:
            yield "goal_torque"
        return
    mode = registers.get("operating_mode")
    yield from (goal for value, goal in _GOALS.items() if mode is not None and mode.accepts(value))
    yield from (limit for goal, limit in _LIMITS.items() if goal in registers)
