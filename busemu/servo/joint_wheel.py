"""Joint mode and wheel mode: AX, MX with Protocol 1.0, XL-320; multi-turn and torque mode of MX.

Where the table's ``drive`` gives ``turn_counts``, positions are absolute within a turn, and both
angle limits at their maximum mean multi-turn mode, with its offset and resolution divider.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Set
from types import MappingProxyType

from ..plant import DriveCommand, OperatingMode, ServoState
from ..tables import Register
from ..tables.needs import COUNTS_TO
from .memory import Memory
from .status import Refusal

#: A joint faster than this counts as moving [rad/s]. Assumed.
MOVING_VELOCITY_RAD_S = 0.05
#: ``realtime_tick`` counts milliseconds and starts over after its maximum. Source: e-manual.
TICK_MODULO = COUNTS_TO["realtime_tick"] + 1
#: A write to these makes a servo with an absolute encoder take its turn anew. Assumed.
HOMING = frozenset({"torque_enable", "cw_angle_limit", "ccw_angle_limit"})
#: Ticks come at sums of a period, which rounding leaves a little before or after their due time.
TICK_ROUNDING_S = 1e-6


class JointWheel:
    """Registers of a servo whose mode follows from its angle limits or its ``control_mode``."""

    def __init__(self, memory: Memory) -> None:
        drive = memory.table.drive
        self._memory = memory
        self._turn_counts = int(drive.get("turn_counts", 0))
        self._turn = 0
        self.reacts = HOMING if self._turn_counts else frozenset[str]()
        self._wheel_is_pwm = drive.get("wheel_mode") == "pwm"
        self._stall_current_a = float(drive.get("stall_current_a", math.inf))
        self._load_refresh_s = float(drive.get("load_refresh_s", 0.0))
        self._load_sign = float(drive.get("load_sign", 1.0))
        self._acceleration_needs_speed = bool(drive.get("acceleration_needs_speed", False))
        self._load_due_s = 0.0
        self._power_s = 0.0
        self.quick = self._sensors()
        self.shown = frozenset({*self.quick, "realtime_tick"})

    # -- modes -------------------------------------------------------------------------------

    def operating_mode(self) -> OperatingMode:
        """Joint mode or wheel mode, as the model says it (``control_mode``, or both limits 0)."""
        memory = self._memory
        if memory.has("torque_ctrl_mode_enable") and memory["torque_ctrl_mode_enable"]:
            return OperatingMode.PWM
        if memory.has("control_mode"):
            wheel = memory["control_mode"] == 1
        else:
            wheel = memory["cw_angle_limit"] == 0 and memory["ccw_angle_limit"] == 0
        if not wheel:
            return OperatingMode.POSITION
        return OperatingMode.PWM if self._wheel_is_pwm else OperatingMode.VELOCITY

    def _multi_turn(self) -> bool:
        if not self._turn_counts:
            return False
        top = self._turn_counts - 1
        return self._memory["cw_angle_limit"] == top and self._memory["ccw_angle_limit"] == top

    def _direction(self, mode: OperatingMode) -> int:
        """-1 for a servo mounted in reverse (``drive_mode`` bit 0; not in wheel mode)."""
        reverse = self._memory.has("drive_mode") and self._memory["drive_mode"] & 1
        return -1 if reverse and mode is OperatingMode.POSITION else 1

    # -- down --------------------------------------------------------------------------------

    def command(self) -> DriveCommand:
        """What the registers tell the drive, in SI."""
        memory = self._memory
        speed = memory.si("moving_speed")
        mode = self.operating_mode()
        gains = self._compliance() if memory.table.drive["law"] == "compliance" else self._pid()
        return DriveCommand(
            torque_enable=memory["torque_enable"] == 1,
            operating_mode=mode,
            goal_position_rad=self._goal_rad(mode),
            goal_velocity_rad_s=speed,
            goal_duty=self._goal_duty() if mode is OperatingMode.PWM else 0.0,
            velocity_limit_rad_s=abs(speed) if speed else math.inf,
            acceleration_limit_rad_s2=self._acceleration_rad_s2(speed, mode),
            duty_limit=min(1.0, memory.si("torque_limit")),
            punch_duty=memory.si("punch"),
            **gains,
        )

    def _acceleration_rad_s2(self, speed_rad_s: float, mode: OperatingMode) -> float:
        """``goal_acceleration``; none at 0, nor where an MX has no speed to reach (e-manual)."""
        memory = self._memory
        if not memory.has("goal_acceleration") or not memory["goal_acceleration"]:
            return math.inf
        needed = mode is OperatingMode.POSITION and self._acceleration_needs_speed
        return math.inf if needed and not speed_rad_s else memory.si("goal_acceleration")

    def _goal_rad(self, mode: OperatingMode) -> float:
        memory = self._memory
        register = memory.table["goal_position"]
        count = register.decode(memory["goal_position"])
        if self._multi_turn():
            count = (count - memory.count("multi_turn_offset")) * memory["resolution_divider"]
        else:
            count += self._turn * self._turn_counts
        return self._direction(mode) * (count - register.zero) * register.si_scale

    def _goal_duty(self) -> float:
        """Share of full duty: ``moving_speed`` of a wheel, or the torque that is asked for.

        A torque, given as a current, is turned into the duty that brings this current at
        standstill (assumed: back EMF is left out).
        """
        memory = self._memory
        if memory.has("torque_ctrl_mode_enable") and memory["torque_ctrl_mode_enable"]:
            return max(-1.0, min(1.0, memory.si("goal_torque") / self._stall_current_a))
        return memory.count("moving_speed") / memory.table["moving_speed"].maximum

    def _compliance(self) -> dict[str, float]:
        memory = self._memory
        rest = 1.0 - memory.si("punch")
        return {
            "margin_cw_rad": memory.si("cw_compliance_margin"),
            "margin_ccw_rad": memory.si("ccw_compliance_margin"),
            "gain_cw_per_rad": rest / self._band_rad("cw_compliance_slope"),
            "gain_ccw_per_rad": rest / self._band_rad("ccw_compliance_slope"),
        }

    def _band_rad(self, slope: str) -> float:
        return slope_step(self._memory[slope]) * self._memory.table[slope].si_scale

    def _pid(self) -> dict[str, float]:
        memory, drive = self._memory, self._memory.table.drive
        proportional = memory["p_gain"] * float(drive["p_gain_duty_per_rad"])
        return {
            **self._dead_zone(),
            "gain_cw_per_rad": proportional,
            "gain_ccw_per_rad": proportional,
            "integral_gain_per_rad_s": memory["i_gain"] * float(drive["i_gain_duty_per_rad_s"]),
            "derivative_gain_s_per_rad": memory["d_gain"] * float(drive["d_gain_duty_s_per_rad"]),
        }

    def _dead_zone(self) -> dict[str, float]:
        """That of a Feetech servo, either way; a Dynamixel with PID gains has none."""
        return {
            f"margin_{way}_rad": self._memory.si(f"{way}_dead_zone")
            for way in ("cw", "ccw")
            if self._memory.has(f"{way}_dead_zone")
        }

    def refuse(self, register: Register, raw: int) -> Refusal | None:
        """Goals outside the angle limits; in wheel and multi-turn mode there are none."""
        if register.name != "goal_position" or self._multi_turn():
            return None
        if self.operating_mode() is not OperatingMode.POSITION:
            return None
        low, high = self._memory.count("cw_angle_limit"), self._memory.count("ccw_angle_limit")
        return None if low <= register.decode(raw) <= high else Refusal.LIMIT

    # -- up ----------------------------------------------------------------------------------

    def power_on(self, state: ServoState, now_s: float) -> None:
        """RAM that comes from the servo itself: the goal is where it stands."""
        self._power_s = now_s
        self._home(state)
        self.show(state, now_s)
        self._memory["goal_position"] = self._memory["present_position"]
        self._memory["torque_limit"] = self._memory["max_torque"]

    def written(self, names: Set[str], state: ServoState, now_s: float) -> None:
        """After a change of mode or of torque, angles count from the turn the servo is in."""
        if names & HOMING:
            self._home(state)

    def forget_turns(self, state: ServoState, now_s: float) -> None:
        """Have the present position be within one turn; the goal is where the servo stands."""
        self._home(state)
        self.show(state, now_s)
        self._memory["goal_position"] = self._memory["present_position"]

    def show(self, state: ServoState, now_s: float) -> None:
        """Put the drive's state into the ``present_*`` registers (all but ``present_load``)."""
        memory = self._memory
        for show in self.quick.values():
            show(state)
        if memory.has("realtime_tick"):
            memory["realtime_tick"] = int((now_s - self._power_s) * 1e3) % TICK_MODULO

    def _sensors(self) -> Mapping[str, Callable[[ServoState], None]]:
        """How each register that needs the state only is filled from it."""
        memory = self._memory
        position, speed = memory.gauge("present_position"), memory.gauge("present_speed")
        voltage, heat = memory.gauge("present_voltage"), memory.gauge("present_temperature")

        def moving(state: ServoState) -> None:
            memory["moving"] = int(abs(state.velocity_rad_s) > MOVING_VELOCITY_RAD_S)

        sensors: dict[str, Callable[[ServoState], None]] = {
            "present_position": lambda state: position(state.position_rad),
            "present_speed": lambda state: speed(state.velocity_rad_s),
            "present_voltage": lambda state: voltage(state.voltage_v),
            "present_temperature": lambda state: heat(state.temperature_c),
            "moving": moving,
        }
        if self._turn_counts:
            sensors["present_position"] = lambda state: self._show_position(state.position_rad)
        if memory.has("current"):
            current = memory.gauge("current")
            sensors["current"] = lambda state: current(state.current_a)
        return MappingProxyType(sensors)

    def _home(self, state: ServoState) -> None:
        if self._turn_counts:
            self._turn = self._shaft_count(state.position_rad) // self._turn_counts

    def _shaft_count(self, position_rad: float) -> int:
        """Counts of the shaft, turns and all, at an angle [rad]."""
        register = self._memory.table["present_position"]
        angle_rad = self._direction(self.operating_mode()) * position_rad
        return round(angle_rad / register.si_scale) + register.zero

    def _show_position(self, position_rad: float) -> None:
        """The position of a servo with an absolute encoder, which knows turns."""
        memory = self._memory
        count = self._shaft_count(position_rad)
        if self._multi_turn():
            count = round(count / memory["resolution_divider"])
            count += memory.count("multi_turn_offset")
        else:
            count %= self._turn_counts
        memory.clip("present_position", count)

    def idle(self, state: ServoState, now_s: float, silent_s: float) -> bool:
        """Renew ``present_load``, made from the controller's output, at the model's own pace."""
        if now_s >= self._load_due_s - TICK_ROUNDING_S:
            self._memory.show("present_load", self._load_sign * state.duty)
            self._load_due_s = now_s + self._load_refresh_s
        return False


def slope_step(raw: int) -> int:
    """The band [counts] that a compliance slope acts as: 2 to 128, in seven steps of two.

    Source: e-manual, AX-12A, "CW/CCW Compliance Slope".
    """
    return 1 << max(1, min(7, raw.bit_length() - 1))
