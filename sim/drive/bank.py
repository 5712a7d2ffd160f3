"""All servos of a robot as one bank of drives: commands in, shaft torques out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from busemu.plant import DriveCommand, OperatingMode

from . import kernel
from .kernel import Array
from .parameters import DriveParameters, pack

MODES = {
    OperatingMode.POSITION: kernel.MODE_POSITION,
    OperatingMode.VELOCITY: kernel.MODE_VELOCITY,
    OperatingMode.PWM: kernel.MODE_PWM,
}
Fields = slice | list[int]  #: of a command's column
EVERY = slice(None)


def command_column(command: DriveCommand) -> Array:
    """A command as one column of the kernel's command array."""
    column = [0.0] * kernel.COMMANDS
    column[kernel.ENABLED] = float(command.torque_enable)
    column[kernel.MODE] = MODES[command.operating_mode]
    column[kernel.GOAL_POSITION] = command.goal_position_rad
    column[kernel.GOAL_VELOCITY] = command.goal_velocity_rad_s
    column[kernel.GOAL_DUTY] = command.goal_duty
    column[kernel.VELOCITY_LIMIT] = command.velocity_limit_rad_s
    column[kernel.ACCELERATION_LIMIT] = command.acceleration_limit_rad_s2
    column[kernel.DUTY_LIMIT] = min(1.0, max(0.0, command.duty_limit))
    column[kernel.GAIN_CW] = command.gain_cw_per_rad
    column[kernel.GAIN_CCW] = command.gain_ccw_per_rad
    column[kernel.MARGIN_CW] = command.margin_cw_rad
    column[kernel.MARGIN_CCW] = command.margin_ccw_rad
    column[kernel.PUNCH] = command.punch_duty
    column[kernel.INTEGRAL_GAIN] = command.integral_gain_per_rad_s
    column[kernel.DERIVATIVE_GAIN] = command.derivative_gain_s_per_rad
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
        self.states = np.zeros((kernel.STATES, count))
        self.commands = np.zeros((kernel.COMMANDS, count))
        self.supplies = np.array([[supply_voltage_v], [supply_resistance_ohm]])
        self.commands[:] = command_column(DriveCommand()).reshape(-1, 1)
        self.states[kernel.ROTOR_POSITION] = position_rad
        self.states[kernel.VOLTAGE] = supply_voltage_v
        self._arrays = kernel.Arrays(self.params, self.states, self.commands, self.supplies)
        self._step_s = step_s
        self._substeps = substeps
        self._tick_s = tick_s
        self._compile()

    @property
    def torque_nm(self) -> Array:
        """Mean torque of each output shaft on its load during the last step (a view)."""
        view: Array = self.states[kernel.TORQUE]
        return view

    def command(self, index: int, column: Array, fields: Fields = EVERY) -> None:
        """Give one servo a command, as made by :func:`command_column`, or some fields of it."""
        self.commands[fields, index] = column[fields]

    def tick(self, position_rad: Array, velocity_rad_s: Array) -> None:
        """Run every firmware once on the shafts' angles and velocities."""
        kernel.control(self._arrays, position_rad, velocity_rad_s, self._tick_s)

    def step(self, position_rad: Array, velocity_rad_s: Array) -> None:
        """Move the rotors by one step while the shafts move on from the given state."""
        kernel.drive(self._arrays, position_rad, velocity_rad_s, self._step_s, self._substeps)

    def move(self, mount: Array, joints: Array, shafts: Array, *, tick: bool) -> None:
        """Tick, if asked for, and step in one call, in the joints' frame: see ``kernel.move``."""
        tick_s = self._tick_s if tick else 0.0
        kernel.move(self._arrays, mount, joints, shafts, tick_s, self._step_s, self._substeps)

    def _compile(self) -> None:
        """Run the compiled code once on a copy, so that nothing is compiled while serving."""
        still = np.zeros(self.params.shape[1])
        copy = self._arrays._replace(states=self.states.copy())
        kernel.control(copy, still, still, self._tick_s)
        kernel.drive(copy, still, still, self._step_s, self._substeps)
        three = np.zeros((3, still.size))
        kernel.move(copy, three[:2], three, three, 0.0, self._step_s, self._substeps)
