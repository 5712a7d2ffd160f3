"""The seam between a servo on the bus and the joint it moves.

A *plant* is whatever turns drive commands into joint motion: a physics engine, or the ideal
first-order servo below, with which the bus runs without any engine. The bus knows a plant only
through four methods, in this order of events::

    advance(t)  ->  sample(id) / command(id, ...)  ->  advance(t2)  -> ...

Frames and units: every quantity is that of one servo's *output shaft*, in SI. ``position_rad`` is
0 at the centre of the servo's range and grows with the register value (counter-clockwise seen from
the horn). Time is in seconds since the plant was made, and never runs backwards.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from .tables import Robot, ServoMount

#: The supply of servos that are on nothing but a bus [V]: what most of them are made for.
SUPPLY_V = 12.0


class OperatingMode(enum.Enum):
    """What the servo's controller regulates (the e-manual's words)."""

    POSITION = "position"  #: "joint mode" in Protocol 1.0
    VELOCITY = "velocity"  #: "wheel mode" in Protocol 1.0
    PWM = "pwm"  #: duty follows ``goal_duty`` directly


# One of the next two is made for every write of a register and for every look at a servo. As in
# busemu.protocol.packets, mypy alone holds that they never change: frozen=True costs as much again.


@dataclass(slots=True, unsafe_hash=True)
class DriveCommand:
    """All that a servo's registers say to its drive, in SI.

    The position law that one set of numbers must be able to express is, for an error
    ``e = goal - position`` [rad] (AX-12A: compliance margin, slope and punch; XL-320: P, I, D)::

        |e| <= margin : duty = 0
        otherwise     : duty = sign(e) * (punch + gain * (|e| - margin)) + I-term + D-term

    clipped to ``+-duty_limit``. *cw* numbers hold where the goal lies clockwise of the position
    (``e < 0``), *ccw* where it lies counter-clockwise (``e > 0``).
    """

    torque_enable: Final[bool] = False
    operating_mode: Final[OperatingMode] = OperatingMode.POSITION
    goal_position_rad: Final[float] = 0.0
    goal_velocity_rad_s: Final[float] = 0.0  #: used in VELOCITY mode
    goal_duty: Final[float] = 0.0  #: -1 to 1, used in PWM mode
    velocity_limit_rad_s: Final[float] = math.inf  #: moving speed or profile velocity in POSITION
    #: goal acceleration or profile acceleration, in POSITION and VELOCITY
    acceleration_limit_rad_s2: Final[float] = math.inf
    duty_limit: Final[float] = 1.0  #: torque limit, 0 to 1
    gain_cw_per_rad: Final[float] = 0.0
    gain_ccw_per_rad: Final[float] = 0.0
    margin_cw_rad: Final[float] = 0.0
    margin_ccw_rad: Final[float] = 0.0
    punch_duty: Final[float] = 0.0
    integral_gain_per_rad_s: Final[float] = 0.0
    derivative_gain_s_per_rad: Final[float] = 0.0


@dataclass(slots=True, unsafe_hash=True)
class ServoState:
    """What can be known of one servo at the instant last advanced to."""

    position_rad: Final[float]
    velocity_rad_s: Final[float]
    duty: Final[float]  #: the controller's output, -1 to 1: what ``present_load`` is made from
    torque_nm: Final[float]  #: torque of the output shaft on its load
    current_a: Final[float]
    voltage_v: Final[float]  #: at the servo's terminals
    temperature_c: Final[float]


@dataclass(frozen=True, slots=True)
class Reading:
    """How a bus comes by what it reads, where that is not fresh, whole and at the believed instant.

    A plant may have one as its ``reading``. It sees to the first two by itself, in what it gives as
    a servo's state; adapter and line are the bus's.
    """

    skew_s: float = 0.0  #: the position shown is of an instant this much later than believed
    load_refresh_s: float = 0.0  #: the load register is made anew in this period, else held
    latency_timer_s: float = 0.0  #: more wait before a reply reaches the host
    lost_share: float = 0.0  #: of the samples are lost or garbage


def reading_of(plant: Plant) -> Reading:
    """How a plant is read; fresh, whole and in time where it says nothing of it."""
    found = getattr(plant, "reading", None)
    return found if isinstance(found, Reading) else Reading()


class Plant(Protocol):
    """Joint physics behind the bus.

    Contract: :meth:`advance` never goes back (``ValueError``); the result of a run depends only on
    the commands and the instants they were given at, not on how often it was advanced or sampled.
    A command acts from the first control tick of the servo after the instant last advanced to.
    Unknown servo ids raise ``KeyError``.
    """

    def advance(self, to_s: float) -> None:
        """Simulate up to ``to_s`` [s since the plant was made]."""

    def command(self, servo_id: int, command: DriveCommand) -> None:
        """Set what a drive shall do from now on."""

    def sample(self, servo_id: int) -> ServoState:
        """The state of one servo at exactly the instant last advanced to."""

    def observe(self) -> Mapping[str, float]:
        """What an outside observer sees now: namespaced names to SI values.

        For instance ``mocap/base_x_m``, ``contact/leg1_n``. Never known to a robot's program.
        """


@dataclass(slots=True)
class _Ideal:
    """A servo since its last command: where it was then, and where it has been seen since."""

    command: DriveCommand
    position_rad: float
    voltage_v: float
    velocity_rad_s: float = 0.0
    since_s: float = 0.0
    state: ServoState | None = None  #: at ``state_s``; at rest it holds for longer
    state_s: float = 0.0


class IdealPlant:
    """A first-order servo without load: the bus can be tried with no engine installed.

    Each enabled servo approaches its goal with the time constant ``lag_s``, never faster than its
    velocity limit; of a limit of acceleration it knows nothing. It has no inertia, no load and no
    temperature; duty is the position law's own. The motion since a command is known in closed form,
    so nothing is computed until a servo is looked at, and how often that is changes nothing.
    ``voltage_v`` [V] is the supply, of all servos or by ID.
    """

    def __init__(
        self,
        servo_ids: Iterable[int],
        *,
        lag_s: float = 0.03,
        no_load_velocity_rad_s: float = 6.0,
        voltage_v: float | Mapping[int, float] = SUPPLY_V,
    ) -> None:
        if not lag_s > 0.0:
            raise ValueError(f"lag_s must be positive, got {lag_s}")
        self._lag_s = lag_s
        self._no_load = no_load_velocity_rad_s
        self._now_s = 0.0
        self._servos = {
            i: _Ideal(
                DriveCommand(), 0.0, voltage_v[i] if isinstance(voltage_v, Mapping) else voltage_v
            )
            for i in servo_ids
        }

    def advance(self, to_s: float) -> None:
        """Let time go on to ``to_s``."""
        if not to_s >= self._now_s:
            raise ValueError(f"a plant cannot go back from {self._now_s} s to {to_s} s")
        self._now_s = to_s

    def _motion(self, servo: _Ideal) -> tuple[float, float]:
        """Position [rad] and velocity [rad/s] at the present instant."""
        command, step_s = servo.command, self._now_s - servo.since_s
        if step_s <= 0.0:
            return servo.position_rad, servo.velocity_rad_s
        if not command.torque_enable or command.duty_limit == 0.0:
            return servo.position_rad, 0.0
        limit = min(command.velocity_limit_rad_s, self._no_load * command.duty_limit)
        if command.operating_mode is OperatingMode.POSITION:
            goal = command.goal_position_rad
            position = _approach(servo.position_rad, goal, limit, self._lag_s, step_s)
            return position, max(-limit, min(limit, (goal - position) / self._lag_s))
        wanted = (
            command.goal_velocity_rad_s
            if command.operating_mode is OperatingMode.VELOCITY
            else command.goal_duty * self._no_load
        )
        velocity = max(-limit, min(limit, wanted))
        return servo.position_rad + velocity * step_s, velocity

    def command(self, servo_id: int, command: DriveCommand) -> None:
        """Set what a drive shall do from now on."""
        servo = self._servos[servo_id]
        servo.position_rad, servo.velocity_rad_s = self._motion(servo)
        servo.command, servo.since_s, servo.state = command, self._now_s, None

    def sample(self, servo_id: int) -> ServoState:
        """The state of one servo at the instant last advanced to."""
        servo, now_s = self._servos[servo_id], self._now_s
        state = servo.state
        if state is not None and servo.state_s == now_s:
            return state
        servo.state_s = now_s
        position, velocity = self._motion(servo)
        if state is None or (position, velocity) != (state.position_rad, state.velocity_rad_s):
            state = servo.state = ServoState(
                position_rad=position,
                velocity_rad_s=velocity,
                duty=position_duty(servo.command, position),
                torque_nm=0.0,
                current_a=0.0,
                voltage_v=servo.voltage_v,
                temperature_c=25.0,
            )
        return state

    def observe(self) -> Mapping[str, float]:
        """Nobody stands beside an ideal plant: always empty."""
        return {}


def ideal(robot: Robot) -> IdealPlant:
    """The ideal plant of a robot (the plant named ``ideal`` on the command line)."""
    supply = robot.document.get("supply", {}).get("voltage_v", {})
    given = supply.get("value")
    return IdealPlant(
        [mount.servo_id for mount in robot.servos],
        voltage_v={
            mount.servo_id: supply_v(robot, mount) if given is None else float(given)
            for mount in robot.servos
        },
    )


def supply_v(robot: Robot, mount: ServoMount) -> float:
    """What a servo is supplied with [V] where no robot file says it, so that it raises no alarm.

    That is :data:`SUPPLY_V` or, where this is outside the servo's limits, their middle (assumed).
    """
    table = robot.tables[mount.servo_id]
    limits = []
    for name in ("min_voltage_limit", "max_voltage_limit"):
        if name not in table or (table[name].initial is None and name not in mount.registers):
            return SUPPLY_V
        limits.append(table[name].to_si(mount.registers.get(name, table[name].initial or 0)))
    low, high = limits
    return SUPPLY_V if low <= SUPPLY_V <= high else 0.5 * (low + high)


def position_duty(command: DriveCommand, position_rad: float) -> float:
    """Duty of the proportional position law of :class:`DriveCommand` (no I, no D), -1 to 1."""
    if not command.torque_enable or command.operating_mode is not OperatingMode.POSITION:
        return 0.0
    error = command.goal_position_rad - position_rad
    ccw = error > 0.0
    beyond = abs(error) - (command.margin_ccw_rad if ccw else command.margin_cw_rad)
    if beyond <= 0.0:
        return 0.0
    gain = command.gain_ccw_per_rad if ccw else command.gain_cw_per_rad
    return math.copysign(min(command.punch_duty + gain * beyond, command.duty_limit), error)


def _approach(position: float, goal: float, limit: float, lag_s: float, step_s: float) -> float:
    """Exact solution of ``x' = clip((goal - x) / lag, +-limit)`` over one step."""
    error = goal - position
    if limit <= 0.0:
        return position
    knee = limit * lag_s  # beyond it the velocity limit acts
    if abs(error) > knee:
        at_limit_s = (abs(error) - knee) / limit
        if at_limit_s >= step_s:
            return position + math.copysign(limit * step_s, error)
        position += math.copysign(abs(error) - knee, error)
        step_s -= at_limit_s
        error = goal - position
    return goal - error * math.exp(-step_s / lag_s)
