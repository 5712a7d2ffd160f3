"""All servos of a robot as one bank of drives: commands in, shaft torques out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from busemu.plant import DriveCommand, OperatingMode

from . import fields, firmware, kernel
from .fields import Array
from .parameters import DriveParameters, pack

MODES = {
    OperatingMode.POSITION: fields.MODE_POSITION,
    OperatingMode.VELOCITY: fields.MODE_VELOCITY,
    OperatingMode.PWM: fields.MODE_PWM,
}
Fields = slice | list[int]  #: of a command's column
EVERY = slice(None)


def command_column(command: DriveCommand) -> Array:
    """A command as one column of the kernel's command array."""
    column = [0.0] * fields.COMMANDS
    column[fields.ENABLED] = float(command.torque_enable)
    column[fields.MODE] = MODES[command.operating_mode]
    column[fields.GOAL_POSITION] = command.goal_position_rad
    column[fields.GOAL_VELOCITY] = command.goal_velocity_rad_s
    column[fields.GOAL_DUTY] = command.goal_duty
    column[fields.VELOCITY_LIMIT] = command.velocity_limit_rad_s
    column[fields.ACCELERATION_LIMIT] = command.acceleration_limit_rad_s2
    column[fields.DUTY_LIMIT] = min(1.0, max(0.0, command.duty_limit))
    column[fields.GAIN_CW] = command.gain_cw_per_rad
    column[fields.GAIN_CCW] = command.gain_ccw_per_rad
    column[fields.MARGIN_CW] = command.margin_cw_rad
    column[fields.MARGIN_CCW] = command.margin_ccw_rad
    column[fields.PUNCH] = command.punch_duty
    column[fields.INTEGRAL_GAIN] = command.integral_gain_per_rad_s
    column[fields.DERIVATIVE_GAIN] = command.derivative_gain_s_per_rad
    if any(map(math.isnan, column)):
        raise ValueError(f"a drive command must not hold NaN: {command}")
    return np.array(column)


class DriveBank:
    """The compiled drives of several servos on one supply, in the servos' own frames.

    ``step_s`` is the time one :meth:`step` covers, in ``substeps`` integration steps of the rotors;
    ``tick_s`` is the period of the firmware. The rotors start at rest at ``position_rad``, the
    gears without twist.
    """

    def __init__(
        self,
        drives: Sequence[DriveParameters],
        position_rad: Array,
        *,
        supply_voltage_v: float,
        supply_resistance_ohm: float,
        step_s: float,
        substeps: int,
        tick_s: float,
    ) -> None:
        count = len(drives)
        self.params = pack(drives)
        self.states = np.zeros((fields.STATES, count))
        self.commands = np.zeros((fields.COMMANDS, count))
        self.supplies = np.array([[supply_voltage_v], [supply_resistance_ohm]])
        self.commands[:] = command_column(DriveCommand()).reshape(-1, 1)
        self.states[fields.ROTOR_POSITION] = position_rad
        self.states[fields.VOLTAGE] = supply_voltage_v
        self.arrays = fields.Arrays(self.params, self.states, self.commands, self.supplies)
        self._step_s = step_s
        self._substeps = substeps
        self._tick_s = tick_s
        self._compile()

    @property
    def torque_nm(self) -> Array:
        """Mean torque of each output shaft on its load during the last step (a view)."""
        view: Array = self.states[fields.TORQUE]
        return view

    def command(self, index: int, column: Array, which: Fields = EVERY) -> None:
        """Give one servo a command, as made by :func:`command_column`, or some fields of it."""
        self.commands[which, index] = column[which]

    def tick(self, position_rad: Array, velocity_rad_s: Array) -> None:
        """Run every firmware once on the shafts' angles and velocities."""
        firmware.control(self.arrays, position_rad, velocity_rad_s, self._tick_s)

    def step(self, position_rad: Array, velocity_rad_s: Array) -> None:
        """Move the rotors by one step while the shafts move on from the given state."""
        kernel.drive(self.arrays, position_rad, velocity_rad_s, self._step_s, self._substeps)

    def move(self, mount: Array, joints: Array, shafts: Array, *, tick: bool) -> None:
        """Tick, if asked for, and step in one call, in the joints' frame: see ``kernel.move``."""
        tick_s = self._tick_s if tick else 0.0
        kernel.move(self.arrays, mount, joints, shafts, tick_s, self._step_s, self._substeps)

    def _compile(self) -> None:
        """Run the compiled code once on a copy, so that nothing is compiled while serving."""
        still = np.zeros(self.params.shape[1])
        copy = self.arrays._replace(states=self.states.copy())
        firmware.control(copy, still, still, self._tick_s)
        kernel.drive(copy, still, still, self._step_s, self._substeps)
        three = np.zeros((3, still.size))
        kernel.move(copy, three[:2], three, three, 0.0, self._step_s, self._substeps)
