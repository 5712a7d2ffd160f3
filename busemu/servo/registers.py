"""How a servo's registers and its drive see each other, in both directions.

Down: the RAM area says what the drive shall do (:func:`drive_command`). Up: the state of the drive
becomes the ``present_*`` registers (:func:`show_state`).
"""

from __future__ import annotations

import math

from ..plant import DriveCommand, OperatingMode, ServoState
from .memory import Memory

#: A joint faster than this counts as moving [rad/s]. Assumed.
MOVING_VELOCITY_RAD_S = 0.05


def operating_mode(memory: Memory) -> OperatingMode:
    """Joint mode or wheel mode, as the model says it (``control_mode``, or both limits 0)."""
    table = memory.table
    if "control_mode" in table:
        return OperatingMode.VELOCITY if memory["control_mode"] == 1 else OperatingMode.POSITION
    if memory["cw_angle_limit"] == 0 and memory["ccw_angle_limit"] == 0:
        return OperatingMode.VELOCITY
    return OperatingMode.POSITION


def drive_command(memory: Memory) -> DriveCommand:
    """What the registers tell the drive, in SI."""
    speed = memory.si("moving_speed")
    mode = operating_mode(memory)
    gains = _compliance(memory) if memory.table.drive["law"] == "compliance" else _pid(memory)
    return DriveCommand(
        torque_enable=memory["torque_enable"] == 1,
        operating_mode=mode,
        goal_position_rad=memory.si("goal_position"),
        goal_velocity_rad_s=speed,
        velocity_limit_rad_s=abs(speed) if speed else math.inf,
        duty_limit=min(1.0, memory.si("torque_limit")),
        punch_duty=memory.si("punch"),
        **gains,
    )


def _compliance(memory: Memory) -> dict[str, float]:
    gains: dict[str, float] = {}
    punch = memory.si("punch")
    for side in ("cw", "ccw"):
        slope = memory.table[f"{side}_compliance_slope"]
        band_rad = slope_step(memory[slope.name]) * slope.si_scale
        gains[f"margin_{side}_rad"] = memory.si(f"{side}_compliance_margin")
        gains[f"gain_{side}_per_rad"] = (1.0 - punch) / band_rad
    return gains


def slope_step(raw: int) -> int:
    """The band [counts] that a compliance slope acts as: 2 to 128, in seven steps of two.

    Source: e-manual, AX-12A, "CW/CCW Compliance Slope".
    """
    return 1 << max(1, min(7, raw.bit_length() - 1))


def _pid(memory: Memory) -> dict[str, float]:
    drive = memory.table.drive
    proportional = memory["p_gain"] * float(drive["p_gain_duty_per_rad"])
    return {
        "gain_cw_per_rad": proportional,
        "gain_ccw_per_rad": proportional,
        "integral_gain_per_rad_s": memory["i_gain"] * float(drive["i_gain_duty_per_rad_s"]),
        "derivative_gain_s_per_rad": memory["d_gain"] * float(drive["d_gain_duty_s_per_rad"]),
    }


def show_state(memory: Memory, state: ServoState) -> None:
    """Put the drive's state into the ``present_*`` registers (all but ``present_load``).

    A sensor that is beyond its range reads its end.
    """
    _show(memory, "present_position", state.position_rad)
    _show(memory, "present_speed", state.velocity_rad_s)
    _show(memory, "present_voltage", state.voltage_v)
    _show(memory, "present_temperature", state.temperature_c)
    memory["moving"] = int(abs(state.velocity_rad_s) > MOVING_VELOCITY_RAD_S)


def show_load(memory: Memory, state: ServoState) -> None:
    """Put the controller's output into ``present_load``: it is made from the position error."""
    _show(memory, "present_load", state.duty)


def _show(memory: Memory, name: str, value: float) -> None:
    register = memory.table[name]
    count = round(value / register.si_scale) + register.zero
    memory[name] = register.encode(max(register.minimum, min(register.maximum, count)))
