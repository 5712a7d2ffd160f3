"""Faults that befall servos: without power, with a wrong ID, with a sensor that lies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

from ..plant import DriveCommand, OperatingMode, Plant, ServoState, position_duty
from ..servo import Servo
from ..servo.status import Alarm
from .fault import Fault, Kind

#: An overheated servo is so much above its temperature limit if nothing is said [K]. Assumed.
ABOVE_LIMIT_K = 5.0

#: Called with the instant [s], brings back what was before.
Undo = Callable[[float], None]


class LyingSensors:
    """The plant as a servo has it whose sensors lie; by the number of the fault that makes them.

    A position loop with a stuck encoder sees a constant error, so its duty is constant as well: the
    joint runs until something stops it.
    """

    def __init__(self, plant: Plant) -> None:
        self.true = plant
        self.stuck_rad: dict[int, float] = {}
        self.temperature_c: dict[int, float] = {}

    def advance(self, to_s: float) -> None:
        """Simulate up to ``to_s`` [s]."""
        self.true.advance(to_s)

    def command(self, servo_id: int, command: DriveCommand) -> None:
        """Set what the drive shall do, as far as it knows where it is."""
        position = command.operating_mode is OperatingMode.POSITION
        if self.stuck_rad and position and command.torque_enable:
            duty = position_duty(command, next(iter(self.stuck_rad.values())))
            command = replace(command, operating_mode=OperatingMode.PWM, goal_duty=duty)
        self.true.command(servo_id, command)

    def sample(self, servo_id: int) -> ServoState:
        """What the sensors say."""
        state = self.true.sample(servo_id)
        if self.stuck_rad:
            stuck_rad = next(iter(self.stuck_rad.values()))
            state = replace(state, position_rad=stuck_rad, velocity_rad_s=0.0)
        if self.temperature_c:
            state = replace(state, temperature_c=max(self.temperature_c.values()))
        return state

    def observe(self) -> Mapping[str, float]:
        """What an observer sees."""
        return self.true.observe()


class Plights:
    """The servos of a bus and what befalls them. Faults go by their numbers and may overlap."""

    def __init__(self, servos: Mapping[int, Servo]) -> None:
        self._servos = servos
        self._unpowered: Counter[int] = Counter()

    def begin(self, number: int, fault: Fault, now_s: float) -> list[Undo]:
        """Let a fault befall the servos it names, or all; how each is brought back."""
        chosen = fault.servos or tuple(self._servos)
        return [self._befall(number, fault, servo_id, now_s) for servo_id in chosen]

    def _befall(self, number: int, fault: Fault, servo_id: int, now_s: float) -> Undo:
        servo = self._servos[servo_id]
        if fault.kind in (Kind.DEAD, Kind.BROWN_OUT):
            return self._cut_power(servo_id, servo, now_s)
        if fault.kind is Kind.DUPLICATE_ID:
            return _rename(servo, fault.new_id)
        if fault.kind is Kind.OVERLOAD:
            servo.protection.raise_alarm(Alarm.OVERLOAD)
            return lambda now_s: None
        sensors = servo.plant
        if not isinstance(sensors, LyingSensors):
            sensors = LyingSensors(sensors)
        if fault.kind is Kind.OVERHEAT:
            limit_c = servo.memory.si("temperature_limit")
            wanted_c = fault.temperature_c
            sensors.temperature_c[number] = (
                limit_c + ABOVE_LIMIT_K if wanted_c is None else wanted_c
            )
        else:
            sensors.stuck_rad[number] = sensors.sample(servo_id).position_rad
            if servo.protection.knows(Alarm.ENCODER):
                servo.protection.raise_alarm(Alarm.ENCODER)
        servo.plant = sensors

        def undo(now_s: float) -> None:
            sensors.stuck_rad.pop(number, None)
            sensors.temperature_c.pop(number, None)
            lying = sensors.stuck_rad or sensors.temperature_c
            servo.plant = sensors if lying else sensors.true

        return undo

    def _cut_power(self, servo_id: int, servo: Servo, now_s: float) -> Undo:
        self._unpowered[servo_id] += 1
        servo.lose_power(now_s)

        def undo(now_s: float) -> None:
            self._unpowered[servo_id] -= 1
            if not self._unpowered[servo_id]:
                servo.regain_power(now_s)

        return undo


def _rename(servo: Servo, new_id: int) -> Undo:
    before = servo.servo_id
    servo.take_id(new_id)

    def undo(now_s: float) -> None:
        if servo.servo_id == new_id:  # nobody has mended it since
            servo.take_id(before)

    return undo
