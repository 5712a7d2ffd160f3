"""The drives of many servos at once, as arrays: position law, supply rail, DC motor.

Everything at the output shafts, in each servo's own frame, shape (servos,).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from busemu.plant import DriveCommand, OperatingMode
from busemu.tables import Robot

from .instant import TICK_S
from .legged import drive_of, said
from .parts import RAIL_F

Floats = NDArray[np.float64]
#: of the board's temperature: K/W and s; assumed
BOARD_K_W, BOARD_S = 12.0, 120.0
SAME = 0.01  #: share of a count that is no error: files round a count, and goals do not


@dataclass(frozen=True, slots=True)
class Electrics:
    """What may be true of drives and supply beyond the file; maps are by joint."""

    supply_v: float | None = None
    source_ohm: float | None = None
    droop_v_s: float = 0.0
    gain_factor: Mapping[str, float] | None = None
    duty_limit: Mapping[str, float] | None = None
    torque_factor: Mapping[str, float] | None = None
    friction_factor: Mapping[str, float] | None = None
    zero_rad: Mapping[str, float] | None = None
    sense_v: Mapping[str, float] | None = None  #: what voltage registers show too much
    ambient_c: float = 25.0

    def but(self, **changes: object) -> Electrics:
        """The same with some things changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


class Drives:
    """Servo drives on one rail; the state after the last tick is in the attributes."""

    def __init__(self, robot: Robot, joints: Sequence[str], electrics: Electrics) -> None:
        self.electrics = electrics
        self._mounts = [robot.by_joint[joint] for joint in joints]
        sheets = [drive_of(robot, mount.model) for mount in self._mounts]

        def each(key: str) -> Floats:
            return np.array([float(said(sheet, key)) for sheet in sheets])

        def by_joint(values: Mapping[str, float] | None, default: float) -> Floats:
            return np.array([(values or {}).get(joint, default) for joint in joints])

        rated, stall_a = each("rated_voltage_v"), each("stall_current_a")
        idle_a, idle_rad_s = each("no_load_current_a"), each("no_load_velocity_rad_s")
        factor = by_joint(electrics.torque_factor, 1.0)
        self.resistance_ohm = rated / stall_a
        constant = each("stall_torque_nm") / stall_a
        self.torque_nm_a = constant * factor
        self.back_emf = (rated - idle_a * self.resistance_ohm) / idle_rad_s * factor
        rub = by_joint(electrics.friction_factor, 1.0)
        self.coulomb_nm = each("coulomb_nm") * rub
        # what friction the no-load current speaks of beyond the Coulomb level
        rest_nm = constant * idle_a - each("coulomb_nm")
        self.viscous = np.maximum(rest_nm, 0.0) / idle_rad_s * rub
        self.gain_factor = by_joint(electrics.gain_factor, 1.0)
        self.weak = by_joint(electrics.duty_limit, 1.0)
        self.step_rad = each("sensor_step_rad")
        supply = robot.document["supply"]
        self.source_v = electrics.supply_v or float(said(supply, "voltage_v"))
        ohm = electrics.source_ohm
        self.source_ohm = float(said(supply, "resistance_ohm")) if ohm is None else ohm
        self.rail_v = self.source_v
        n = len(self._mounts)
        self.duty, self.current_a = np.zeros(n), np.zeros(n)
        self.temperature_c = np.full(n, electrics.ambient_c + 3.0)
        self._sum, self._error = np.zeros(n), np.zeros(n)
        self._orders = [DriveCommand() for _ in range(n)]
        self._at = np.full(n, np.nan)  # of the profile
        self._take()

    def order(self, index: int, command: DriveCommand) -> None:
        """Set what a drive shall do from the next tick on."""
        if command != self._orders[index]:
            if command.torque_enable and not self._orders[index].torque_enable:
                self._at[index] = np.nan
                self._sum[index] = 0.0
            self._orders[index] = command
            self._take()

    def _take(self) -> None:
        def each(name: str) -> Floats:
            return np.array([float(getattr(order, name)) for order in self._orders])

        limit = each("duty_limit")
        mode = [order.operating_mode for order in self._orders]
        self._place = np.array([m is OperatingMode.POSITION for m in mode])
        self.on = each("torque_enable").astype(bool) & (limit > 0.0)
        self._goal = each("goal_position_rad")
        self._speed = each("velocity_limit_rad_s")
        self._limit = np.minimum(limit, self.weak)
        self._gain = (each("gain_cw_per_rad"), each("gain_ccw_per_rad"))
        self._margin = (each("margin_cw_rad"), each("margin_ccw_rad"))
        self._punch = each("punch_duty")
        self._integral = each("integral_gain_per_rad_s")
        self._derivative = each("derivative_gain_s_per_rad")
        # in velocity mode the law follows a place that moves at the goal's velocity (assumed)
        spin = np.array([m is OperatingMode.VELOCITY for m in mode])
        self._spin_rad = np.where(spin, each("goal_velocity_rad_s") * TICK_S, np.nan)
        self._law = self._place | spin
        self._open = each("goal_duty")

    def tick(self, position_rad: Floats, rotor_rad_s: Floats, t_s: float) -> Floats:
        """One control period: the motors' torque without back-EMF [N m].

        ``position_rad``: the sensors'; ``rotor_rad_s``: rotors, at the output.
        """
        shown = np.round(position_rad / self.step_rad) * self.step_rad
        fresh = np.isnan(self._at)
        start = np.where(fresh, shown, self._at)
        step = self._speed * TICK_S
        limited = np.isfinite(step)
        way = np.where(limited, step, np.inf)
        placed = np.where(limited, start + np.clip(self._goal - start, -way, way), self._goal)
        led = np.where(self._place, placed, start + self._spin_rad)
        self._at = np.where(self.on & self._law, led, np.nan)
        error = np.where(self.on & self._law, self._at - shown, 0.0)
        ccw = error > 0.0
        beyond = np.abs(error) - np.where(ccw, self._margin[1], self._margin[0])
        gain = np.where(ccw, self._gain[1], self._gain[0]) * self.gain_factor
        law = np.where(
            beyond > SAME * self.step_rad, np.sign(error) * (self._punch + gain * beyond), 0.0
        )
        self._sum = np.clip(self._sum + self._integral * error * TICK_S, -1.0, 1.0)
        law = law + self._sum + self._derivative * (error - self._error) / TICK_S
        self._error = error
        wanted = np.where(self._law, law, self._open)
        self.duty = np.where(self.on, np.clip(wanted, -self._limit, self._limit), 0.0)
        self._rail(rotor_rad_s, t_s)
        driven_a = self.duty * self.rail_v / self.resistance_ohm
        emf_a = self.back_emf * rotor_rad_s / self.resistance_ohm
        self.current_a = np.where(self.on, driven_a - emf_a, 0.0)
        watts = self.resistance_ohm * self.current_a**2
        cool = self.electrics.ambient_c + 3.0 + BOARD_K_W * watts
        self.temperature_c += (cool - self.temperature_c) * TICK_S / BOARD_S
        torque: Floats = np.where(self.on, self.torque_nm_a * driven_a, 0.0)
        return torque

    def _rail(self, rotor_rad_s: Floats, t_s: float) -> None:
        """Implicit Euler of the rail's capacitor behind the source resistance."""
        source_v = self.source_v - self.electrics.droop_v_s * t_s
        if self.source_ohm <= 0.0:
            self.rail_v = source_v
            return
        share = TICK_S / RAIL_F
        duty = self.duty / self.resistance_ohm
        regained = float(np.sum(duty * self.back_emf * rotor_rad_s))
        drawn = float(np.sum(duty * self.duty))
        fed = self.rail_v + share * (source_v / self.source_ohm + regained)
        self.rail_v = fed / (1.0 + share * (1.0 / self.source_ohm + drawn))

    @property
    def damping_nm_s_rad(self) -> Floats:
        """Back-EMF and viscous friction at the rotors; an open bridge does not brake."""
        emf = self.torque_nm_a * self.back_emf / self.resistance_ohm
        damping: Floats = self.viscous + np.where(self.on, emf, 0.0)
        return damping
