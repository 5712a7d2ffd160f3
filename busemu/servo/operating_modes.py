"""Operating modes: the X series, and MX with Protocol 2.0 firmware.

The e-manual's words and rules throughout: ``operating_mode``, ``drive_mode``, ``homing_offset``,
limits, profile, ``bus_watchdog``, ``moving_status``. Positions are counts of the position register.
What the drive cannot be told by :class:`~busemu.plant.DriveCommand` has no effect on the motion:
the gains of velocity mode and of feedforward, and in velocity mode an acceleration that is given as
a time; nor is there the manual's control of jerk. A goal that changes on the way is gone to from
the speed there is; the trajectory registers begin anew from where they are. A current becomes the
duty that brings it at standstill (assumed).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Set
from types import MappingProxyType

from ..plant import DriveCommand, OperatingMode, ServoState
from ..tables import Register
from .joint_wheel import TICK_MODULO
from .memory import Memory
from .profile import Profile, by_time, by_velocity
from .status import Refusal

CURRENT, VELOCITY, POSITION, EXTENDED_POSITION, CURRENT_BASED_POSITION, PWM = 0, 1, 3, 4, 5, 16
POSITION_MODES = frozenset({POSITION, EXTENDED_POSITION, CURRENT_BASED_POSITION})
#: Bits of ``drive_mode``. Source: e-manual.
REVERSE, TIME_BASED, TORQUE_ON_BY_GOAL = 0x01, 0x04, 0x08
#: Bits of ``moving_status``; bits 4 and 5 hold the kind of profile. Source: e-manual.
IN_POSITION, PROFILE_ONGOING, FOLLOWING_ERROR, PROFILE_SHIFT = 0x01, 0x02, 0x08, 4
#: Goal and limit of each goal that has one. Source: e-manual.
LIMITS = {
    "goal_pwm": "pwm_limit",
    "goal_current": "current_limit",
    "goal_velocity": "velocity_limit",
}
GOALS = frozenset({*LIMITS, "goal_position"})
#: In position mode a homing offset beyond this many counts is ignored. Source: e-manual.
HOMING_LIMIT = 1024
#: Off the goal by at most so many counts, the servo is in position. Assumed.
IN_POSITION_COUNTS = 10
#: Off the trajectory by more than so many counts, it does not follow. Assumed.
FOLLOWING_COUNTS = 100
#: What a change of ``operating_mode`` sets back to the initial value. Source: e-manual.
RESET_BY_MODE = (
    "velocity_i_gain",
    "velocity_p_gain",
    "position_d_gain",
    "position_i_gain",
    "position_p_gain",
    "feedforward_2nd_gain",
    "feedforward_1st_gain",
    "profile_acceleration",
    "profile_velocity",
)


#: Registers that need the time or the trajectory, besides the state of the drive.
PLANNED = frozenset(
    {"realtime_tick", "position_trajectory", "velocity_trajectory", "moving", "moving_status"}
)


class OperatingModes:
    """Registers of a servo that has an ``operating_mode``."""

    reacts = frozenset({*GOALS, *LIMITS.values(), "operating_mode", "torque_enable"})

    def __init__(self, memory: Memory) -> None:
        table, drive = memory.table, memory.table.drive
        self._memory = memory
        self._step_rad = table["present_position"].si_scale
        self._zero = table["present_position"].zero
        self._turn_counts = round(2.0 * math.pi / self._step_rad)
        self._velocity_counts = table["profile_velocity"].si_scale / self._step_rad
        self._acceleration_counts = table["profile_acceleration"].si_scale / self._step_rad
        self._stall_current_a = float(drive.get("stall_current_a", math.inf))
        self._turn = 0
        self._power_s = 0.0
        self._profile = Profile(0.0, 0.0, 0.0)
        self.quick = self._sensors()
        self.shown = frozenset({*self.quick, *PLANNED})

    # -- what the settings mean ---------------------------------------------------------------

    @property
    def _mode(self) -> int:
        return self._memory["operating_mode"]

    @property
    def _direction(self) -> int:
        return -1 if self._memory["drive_mode"] & REVERSE else 1

    def _drive_mode(self, bit: int, since: str) -> bool:
        """Whether a bit of ``drive_mode`` is set that the firmware knows."""
        known = self._memory["firmware_version"] >= int(self._memory.table.drive.get(since, 0))
        return known and bool(self._memory["drive_mode"] & bit)

    def _offset(self) -> int:
        """What is added to the shaft's counts to make ``present_position``."""
        homing = self._memory.count("homing_offset")
        if self._mode == POSITION and abs(homing) > HOMING_LIMIT:
            homing = 0
        return homing - self._turn * self._turn_counts

    def _shaft_count(self, position_rad: float) -> int:
        return round(self._direction * position_rad / self._step_rad) + self._zero

    def _watchdog_error(self) -> bool:
        return self._watchdog() < 0

    def _watchdog(self) -> int:
        """``bus_watchdog``: 0, which is off, for a servo that has none."""
        return self._memory.count("bus_watchdog") if self._memory.has("bus_watchdog") else 0

    # -- down ---------------------------------------------------------------------------------

    def command(self) -> DriveCommand:
        """What the registers tell the drive, in SI."""
        memory, mode, sign = self._memory, self._mode, self._direction
        drive = memory.table.drive
        limit = abs(memory.si("pwm_limit" if mode == PWM else "goal_pwm"))
        if mode == CURRENT_BASED_POSITION:
            limit = min(limit, abs(self._current_duty()))
        proportional = memory["position_p_gain"] * float(drive["position_p_gain_duty_per_rad"])
        count = memory.count("goal_position") - self._offset()
        duty = memory.si("goal_pwm") if mode == PWM else 0.0
        if mode == CURRENT:
            duty = self._current_duty()
        kind = OperatingMode.VELOCITY if mode == VELOCITY else OperatingMode.PWM
        return DriveCommand(
            torque_enable=memory["torque_enable"] == 1,
            operating_mode=OperatingMode.POSITION if mode in POSITION_MODES else kind,
            goal_position_rad=sign * (count - self._zero) * self._step_rad,
            goal_velocity_rad_s=sign * memory.si("goal_velocity") if mode == VELOCITY else 0.0,
            goal_duty=sign * duty,
            velocity_limit_rad_s=self._profile.velocity * self._step_rad,
            acceleration_limit_rad_s2=self._acceleration_rad_s2(),
            duty_limit=min(1.0, limit),
            gain_cw_per_rad=proportional,
            gain_ccw_per_rad=proportional,
            integral_gain_per_rad_s=memory["position_i_gain"]
            * float(drive["position_i_gain_duty_per_rad_s"]),
            derivative_gain_s_per_rad=memory["position_d_gain"]
            * float(drive["position_d_gain_duty_s_per_rad"]),
        )

    def _acceleration_rad_s2(self) -> float:
        """Of the profile; in velocity mode of the register itself, in others there is none."""
        memory = self._memory
        if self._mode in POSITION_MODES:
            return self._profile.acceleration * self._step_rad
        timed = self._drive_mode(TIME_BASED, "time_profile_since")
        if self._mode != VELOCITY or timed or not memory["profile_acceleration"]:
            return math.inf
        return memory.si("profile_acceleration")

    def _current_duty(self) -> float:
        """The duty, -1 to 1, that stands for ``goal_current``."""
        return max(-1.0, min(1.0, self._memory.si("goal_current") / self._stall_current_a))

    def refuse(self, register: Register, raw: int) -> Refusal | None:
        """Goals beyond the limits that other registers set, and all of them in watchdog error."""
        if register.name not in GOALS:
            return None
        if self._watchdog_error():
            return Refusal.RANGE
        memory, count = self._memory, register.decode(raw)
        if register.name in LIMITS:
            return None if abs(count) <= memory[LIMITS[register.name]] else Refusal.LIMIT
        if self._mode != POSITION:
            return None
        low, high = memory["min_position_limit"], memory["max_position_limit"]
        return None if low <= count <= high else Refusal.LIMIT

    def written(self, names: Set[str], state: ServoState, now_s: float) -> None:
        """Draw the conclusions from registers that were just written."""
        memory = self._memory
        if "operating_mode" in names:
            self._change_mode(state, now_s)
        for goal, limit in LIMITS.items():
            if limit in names and memory.has(goal):
                bound = memory[limit]
                memory.put(goal, max(-bound, min(bound, memory.count(goal))))
        if names & GOALS and self._drive_mode(TORQUE_ON_BY_GOAL, "torque_on_by_goal_since"):
            memory["torque_enable"] = 1
        if "torque_enable" in names and memory["torque_enable"] and self._mode == POSITION:
            self._home(state)
        if names & {"goal_position", "torque_enable"}:
            self._plan(state, now_s)

    def _change_mode(self, state: ServoState, now_s: float) -> None:
        memory = self._memory
        memory.reset(memory.table[name] for name in RESET_BY_MODE if name in memory.table)
        if self._mode == POSITION:
            self._home(state)
        self._reset_goals(state, now_s)

    def _reset_goals(self, state: ServoState, now_s: float) -> None:
        """Goals as they are at power-on: rest where the mode follows them, else the limit."""
        memory = self._memory
        followed = {PWM: "goal_pwm", CURRENT: "goal_current", VELOCITY: "goal_velocity"}
        for goal, limit in LIMITS.items():
            if memory.has(goal):
                memory.put(goal, 0 if followed.get(self._mode) == goal else memory[limit])
        self._rest(state, now_s)

    def _rest(self, state: ServoState, now_s: float) -> None:
        """Make the goal position the present one."""
        memory = self._memory
        present = self._shaft_count(state.position_rad) + self._offset()
        memory.clip("goal_position", present)
        self._profile = Profile(present, present, now_s)

    def forget_turns(self, state: ServoState, now_s: float) -> None:
        """The present position becomes that within a single turn, and the goal with it."""
        self._home(state)
        self._rest(state, now_s)

    def _home(self, state: ServoState) -> None:
        """Forget the turns: the present position becomes that within a single turn."""
        self._turn = self._shaft_count(state.position_rad) // self._turn_counts

    def _plan(self, state: ServoState, now_s: float) -> None:
        """A new profile, from where the last one is, or from the present position."""
        memory, goal = self._memory, self._memory.count("goal_position")
        start: float = self._shaft_count(state.position_rad) + self._offset()
        if now_s < self._profile.end_s:
            start, _ = self._profile.at(now_s)
        velocity, acceleration = memory["profile_velocity"], memory["profile_acceleration"]
        if self._drive_mode(TIME_BASED, "time_profile_since"):
            self._profile = by_time(start, goal, now_s, velocity * 1e-3, acceleration * 1e-3)
        else:
            self._profile = by_velocity(
                start,
                goal,
                now_s,
                velocity * self._velocity_counts,
                acceleration * self._acceleration_counts,
            )

    # -- up -----------------------------------------------------------------------------------

    def power_on(self, state: ServoState, now_s: float) -> None:
        """RAM that comes from the servo itself; angles count from the turn it is in."""
        self._power_s = now_s
        self._home(state)
        self._reset_goals(state, now_s)
        self.show(state, now_s)

    def show(self, state: ServoState, now_s: float) -> None:
        """Put the drive's state into the registers that a read may bring."""
        memory, mode = self._memory, self._mode
        for show in self.quick.values():
            show(state)
        present = self._shaft_count(state.position_rad) + self._offset()
        memory["realtime_tick"] = int((now_s - self._power_s) * 1e3) % TICK_MODULO
        ongoing = False
        planned, velocity = float(present), 0.0
        if mode in POSITION_MODES and memory["torque_enable"]:
            planned, velocity = self._profile.at(now_s)
            ongoing = now_s < self._profile.end_s
            velocity *= self._step_rad
        elif mode == VELOCITY and memory["torque_enable"]:
            velocity = memory.si("goal_velocity")
        memory.clip("position_trajectory", round(planned))
        memory.show("velocity_trajectory", velocity)
        fast = abs(memory.count("present_velocity")) > memory["moving_threshold"]
        memory["moving"] = int(fast or ongoing)
        memory["moving_status"] = self._moving_status(present, planned, ongoing)

    def _sensors(self) -> Mapping[str, Callable[[ServoState], None]]:
        """How each register that needs the state only is filled from it."""
        memory = self._memory
        velocity, pwm = memory.gauge("present_velocity"), memory.gauge("present_pwm")
        voltage, heat = memory.gauge("present_input_voltage"), memory.gauge("present_temperature")

        def position(state: ServoState) -> None:
            memory.clip("present_position", self._shaft_count(state.position_rad) + self._offset())

        sensors: dict[str, Callable[[ServoState], None]] = {
            "present_position": position,
            "present_velocity": lambda state: velocity(self._direction * state.velocity_rad_s),
            "present_pwm": lambda state: pwm(self._direction * state.duty),
            "present_input_voltage": lambda state: voltage(state.voltage_v),
            "present_temperature": lambda state: heat(state.temperature_c),
        }
        if memory.has("present_current"):
            current = memory.gauge("present_current")
            sensors["present_current"] = lambda state: current(self._direction * state.current_a)
        if memory.has("present_load"):
            load = memory.gauge("present_load")
            sensors["present_load"] = lambda state: load(self._direction * state.duty)
        return MappingProxyType(sensors)

    def _moving_status(self, present: int, planned: float, ongoing: bool) -> int:
        if self._mode not in POSITION_MODES:
            return 0
        bits = self._profile.kind << PROFILE_SHIFT
        if ongoing:
            bits |= PROFILE_ONGOING
        if abs(present - planned) > FOLLOWING_COUNTS:
            bits |= FOLLOWING_ERROR
        if abs(present - self._memory.count("goal_position")) <= IN_POSITION_COUNTS:
            bits |= IN_POSITION
        return bits

    def idle(self, state: ServoState, now_s: float, silent_s: float) -> bool:
        """The watchdog: after too long without an instruction the servo stops."""
        memory = self._memory
        if self._watchdog() <= 0 or not memory["torque_enable"]:
            return False
        if silent_s <= memory.si("bus_watchdog"):
            return False
        memory.put("bus_watchdog", -1)
        memory["profile_acceleration"] = 0
        memory["profile_velocity"] = 0
        for mode, goal in (
            (PWM, "goal_pwm"),
            (CURRENT, "goal_current"),
            (VELOCITY, "goal_velocity"),
        ):
            if self._mode == mode:
                memory[goal] = 0
        self._rest(state, now_s)
        return True
