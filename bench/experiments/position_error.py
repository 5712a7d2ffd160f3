"""The position error as a torque sensor: no servo here has another one.

At rest a servo's position law turns the error of its position into a duty, and the duty, by the
motor's constants, into the torque it can hold: ``torque = duty * stall torque``, a straight line
that ends at the stall torque (the thesis's figure 21). Gear friction can hold as much as
``friction_nm`` more or less, whichever way the joint came; the joint data does not tell which.

A moving motor has less: ``torque = stall torque * (duty - velocity / no-load velocity)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from busemu.plant import DriveCommand, ServoState, position_duty
from busemu.servo.memory import Memory
from busemu.servo.registers import behaviour
from busemu.tables import ControlTable, Robot, ServoMount
from sim.drive.parameters import DriveParameters, read_drive
from sim.entries import Section

from ..recording import Recording, RecordingError

Floats = NDArray[np.float64]

#: Registers that make the position law, of all families of models. An experiment reads them first,
#: so that its recording tells what they were.
LAW_REGISTERS = (
    "cw_compliance_margin",
    "ccw_compliance_margin",
    "cw_dead_zone",
    "ccw_dead_zone",
    "cw_compliance_slope",
    "ccw_compliance_slope",
    "punch",
    "p_gain",
    "i_gain",
    "d_gain",
    "max_torque",
    "position_p_gain",
    "position_i_gain",
    "position_d_gain",
    "pwm_limit",
)

#: A joint has turned back when it has gone so many counts the other way: one is noise. Assumed.
TURNED_COUNTS = 1.5


def position_law(
    table: ControlTable, registers: Mapping[str, int], firmware_version: int | None = None
) -> DriveCommand:
    """The position law of a servo with these raw registers, torque on, at the full torque limit.

    All other registers have their factory values.
    """
    memory = Memory(table, firmware_version)
    for name, raw in registers.items():
        memory[name] = raw
    rules = behaviour(memory)
    at_rest = ServoState(0.0, 0.0, 0.0, 0.0, 0.0, 12.0, 25.0)
    rules.power_on(at_rest, 0.0)  # the torque limit is then the one the EEPROM gives
    for name, raw in registers.items():
        memory[name] = raw
    memory["torque_enable"] = 1
    return rules.command()


def drive_of(robot: Robot, model: str) -> DriveParameters:
    """The drive of a servo model as the robot's file has it; :class:`sim.entries.PhysicsError`."""
    return read_drive(Section(robot.path, "", robot.document).section("drive").section(model))


@dataclass(frozen=True, slots=True)
class TorqueSensor:
    """Torque of one joint from its position error. Errors and torques in the joint's frame."""

    joint: str
    law: DriveCommand
    drive: DriveParameters
    direction: int
    count_rad: float  #: resolution of the position

    @classmethod
    def of(cls, robot: Robot, mount: ServoMount, registers: Mapping[str, int]) -> TorqueSensor:
        """The sensor of a joint whose servo has these raw ``registers``, else factory values."""
        table = robot.tables[mount.servo_id]
        return cls(
            mount.joint,
            position_law(table, registers),
            drive_of(robot, mount.model),
            mount.direction,
            table["present_position"].si_scale,
        )

    @classmethod
    def of_recording(cls, recording: Recording, robot: Robot, joint: str) -> TorqueSensor:
        """The sensor of a joint with the registers that a recording tells.

        The last that was read or written; else the metadata's; else the factory's.
        """
        mount = robot.by_joint.get(joint)
        if mount is None:
            raise RecordingError(recording.path, f"no joint {joint!r} on {robot.name}")
        servo = recording.metadata.get("servo", {}).get(str(mount.servo_id), {})
        registers = dict(servo.get("registers", {}))
        for name in LAW_REGISTERS:
            told = recording.series(mount.servo_id, name).value
            if len(told):
                registers[name] = int(told[-1])
        return cls.of(robot, mount, registers)

    @property
    def stall_nm(self) -> float:
        """Stall torque of the data sheet [N m]: the unit in which the thesis gives torques."""
        return self.drive.data_sheet.stall_torque_nm

    @property
    def friction_nm(self) -> float:
        """What friction can hold at rest [N m]."""
        return self.drive.friction.level_nm(0.0, 0.0, 0.0)

    @property
    def full_error_rad(self) -> float:
        """The smallest error that brings full duty [rad]: the end of the straight line."""
        spare = self.law.duty_limit - self.law.punch_duty
        return self.law.margin_ccw_rad + spare / self.law.gain_ccw_per_rad

    def stall_at_nm(self, voltage_v: float) -> float:
        """Stall torque at a voltage of the terminals [N m]."""
        return self.drive.stall_torque_nm(voltage_v)

    def slope_nm_rad(self, voltage_v: float) -> float:
        """Slope of torque against error where it is straight [N m/rad]."""
        return self.law.gain_ccw_per_rad * self.stall_at_nm(voltage_v)

    def duty(self, error_rad: Floats) -> Floats:
        """Duty, -1 to 1, at errors of the joint [rad]; same shape."""
        counts = np.rint(np.nan_to_num(self.direction * error_rad) / self.count_rad)
        values, inverse = np.unique(counts, return_inverse=True)
        duties = np.array(
            [
                position_duty(replace(self.law, goal_position_rad=n * self.count_rad), 0.0)
                for n in values.tolist()
            ]
        )
        duty: Floats = self.direction * duties[inverse].reshape(np.shape(error_rad))
        return np.where(np.isnan(error_rad), np.nan, duty)

    def torque_nm(
        self,
        error_rad: Floats,
        voltage_v: Floats | float,
        velocity_rad_s: Floats | float = 0.0,
    ) -> Floats:
        """Torque of the servo on the joint [N m] at errors [rad]: duty times stall torque.

        At rest unless a velocity is given. ``voltage_v``: at the servo's terminals.
        """
        stall_nm = self._stall_nm(voltage_v)
        torque: Floats = stall_nm * (self.duty(error_rad) - self._slip(velocity_rad_s, voltage_v))
        return torque

    def torque_past_friction_nm(
        self, error_rad: Floats, voltage_v: Floats | float, position_rad: Floats
    ) -> Floats:
        """Torque of the servo on a slow joint [N m], with friction against its last motion.

        All over time, shape (samples,). The motor gives duty times the stall torque and the
        friction it had to overcome at stall; of that, friction takes its part from a joint that
        the motor moves, and adds it to one that the load moves. Until the joint has moved, friction
        is left out; and where the motor gives nothing, as it holds whatever there is to hold.
        """
        motor_nm = self.duty(error_rad) * (self._stall_nm(voltage_v) + self.friction_nm)
        way = last_way(position_rad, TURNED_COUNTS * self.count_rad)
        torque: Floats = motor_nm - self.friction_nm * way * (motor_nm != 0.0)
        return torque

    def _slip(self, velocity_rad_s: Floats | float, voltage_v: Floats | float) -> Floats:
        """Velocity as a share of that without load."""
        sheet = self.drive.data_sheet
        no_load = sheet.no_load_velocity_rad_s * np.asarray(voltage_v) / sheet.voltage_v
        return np.asarray(velocity_rad_s / no_load)

    def _stall_nm(self, voltage_v: Floats | float) -> Floats:
        values, inverse = np.unique(np.asarray(voltage_v, dtype=float), return_inverse=True)
        stalls = np.array([self.stall_at_nm(v) for v in values.tolist()])
        return np.asarray(stalls[inverse].reshape(np.shape(voltage_v)))


def last_way(position_rad: Floats, turned_rad: float) -> NDArray[np.int8]:
    """Which way each sample's joint last moved: 1, -1, or 0 before it has moved at all.

    Shape (samples,), as ``position_rad``, in time. A change of way counts once it is
    ``turned_rad`` [rad] deep.
    """
    ways = np.zeros(len(position_rad), dtype=np.int8)
    way, extreme = 0, position_rad[0] if len(position_rad) else 0.0
    for i, position in enumerate(position_rad.tolist()):
        if way * (position - extreme) > 0.0:
            extreme = position
        elif abs(position - extreme) >= turned_rad:
            way, extreme = (1 if position > extreme else -1), position
        ways[i] = way
    return ways
