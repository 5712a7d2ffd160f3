"""Servos of the hidden rigs: data sheets, and what their registers make of the position law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from busemu.tables import ControlTable, load_table


@dataclass(frozen=True, slots=True)
class Law:
    """The proportional position law: duty = punch + gain (|error| - margin), -1 to 1."""

    gain_per_rad: float
    margin_rad: float = 0.0
    punch: float = 0.0


@dataclass(frozen=True)
class Sheet:
    """A servo by its data sheet; everything at the output shaft."""

    model: str
    rated_voltage_v: float
    stall_torque_nm: float
    stall_current_a: float
    no_load_velocity_rad_s: float
    gear_ratio: float
    rotor_inertia_kg_m2: float  #: of the rotor itself, before the gear
    coulomb_nm: float
    viscous_nm_s_rad: float
    gear_stiffness_nm_rad: float  #: as the robot files of these servos have it; assumed there
    gear_damping_nm_s_rad: float
    gain_register: str
    gains: tuple[int, ...]  #: raw values an operator tries
    source: str
    registers: Mapping[str, int]  #: set by the operator at every start
    roles: Mapping[str, str]  #: position, velocity, duty, voltage, temperature -> register
    load_refresh_s: float = 0.0

    @cached_property
    def table(self) -> ControlTable:
        """The control table."""
        return load_table(self.model)

    @property
    def torque_constant_nm_a(self) -> float:
        """Torque of the output shaft for an ampere, gear losses included [N m/A]."""
        return self.stall_torque_nm / self.stall_current_a

    @property
    def resistance_ohm(self) -> float:
        """Winding and bridge [ohm]."""
        return self.rated_voltage_v / self.stall_current_a

    @property
    def no_load_current_a(self) -> float:
        """Current that overcomes the nominal friction at full speed without load [A]."""
        friction = self.coulomb_nm + self.viscous_nm_s_rad * self.no_load_velocity_rad_s
        return friction / self.torque_constant_nm_a

    @property
    def back_emf_v_s_rad(self) -> float:
        """Voltage for a radian a second of the output shaft [V s/rad]."""
        lost_v = self.no_load_current_a * self.resistance_ohm
        return (self.rated_voltage_v - lost_v) / self.no_load_velocity_rad_s

    @property
    def armature_kg_m2(self) -> float:
        """The rotor's inertia as the output shaft feels it [kg m^2]."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    @property
    def step_rad(self) -> float:
        """One count of the position register [rad]."""
        return self.table["present_position"].si_scale

    def setting(self, name: str, registers: Mapping[str, int]) -> int:
        """Raw value of a register: as written, else as the operator sets it, else the factory's."""
        for source in (registers, self.registers):
            if name in source:
                return source[name]
        return int(self.table[name].initial or 0)

    def law(self, registers: Mapping[str, int]) -> Law:
        """The position law that register values stand for (e-manual; see the control tables)."""
        drive = self.table.drive
        if drive["law"] == "operating_modes":
            gain = self.setting("position_p_gain", registers)
            return Law(gain * float(drive["position_p_gain_duty_per_rad"]))
        punch = self.setting("punch", registers) / 1023.0
        if drive["law"] == "pid":
            gain = self.setting("p_gain", registers)
            return Law(gain * float(drive["p_gain_duty_per_rad"]), 0.0, punch)
        slope = self.setting("cw_compliance_slope", registers)
        band = 2 ** min(max(int(math.log2(max(slope, 1))), 1), 7)
        margin = self.setting("cw_compliance_margin", registers) * self.step_rad
        return Law((1.0 - punch) / (band * self.step_rad), margin, punch)


_X_ROLES = {
    "position": "present_position",
    "velocity": "present_velocity",
    "duty": "present_pwm",
    "voltage": "present_input_voltage",
    "temperature": "present_temperature",
}
_AX_ROLES = {
    "position": "present_position",
    "velocity": "present_speed",
    "duty": "present_load",
    "voltage": "present_voltage",
    "temperature": "present_temperature",
}

#: the servos by the names of their control tables
SHEETS: Mapping[str, Sheet] = MappingProxyType(
    {
        sheet.model: sheet
        for sheet in (
            Sheet(
                model="XL330-M288",
                rated_voltage_v=5.0,
                stall_torque_nm=0.52,
                stall_current_a=1.47,
                no_load_velocity_rad_s=10.79,
                gear_ratio=288.4,
                rotor_inertia_kg_m2=1.6e-8,
                coulomb_nm=0.020,
                viscous_nm_s_rad=0.0020,
                gear_stiffness_nm_rad=12.0,
                gear_damping_nm_s_rad=0.0015,
                gain_register="position_p_gain",
                gains=(100, 200, 400, 800),
                source="e-manual, 103 rpm at 5 V; rotor and friction assumed, as published fits",
                registers=MappingProxyType({"position_p_gain": 400, "return_delay_time": 0}),
                roles=MappingProxyType(_X_ROLES),
            ),
            Sheet(
                model="AX-12A",
                rated_voltage_v=12.0,
                stall_torque_nm=1.5,
                stall_current_a=1.5,
                no_load_velocity_rad_s=6.178,
                gear_ratio=254.0,
                rotor_inertia_kg_m2=1.0e-7,
                coulomb_nm=0.06,
                viscous_nm_s_rad=0.008,
                gear_stiffness_nm_rad=50.0,
                gear_damping_nm_s_rad=0.015,
                gain_register="cw_compliance_slope",
                gains=(16, 32, 64, 128),
                source="thesis, servo table; rotor and friction assumed",
                registers=MappingProxyType({"return_delay_time": 0}),
                roles=MappingProxyType(_AX_ROLES),
                load_refresh_s=0.130,
            ),
            Sheet(
                model="XL-320",
                rated_voltage_v=7.4,
                stall_torque_nm=0.39,
                stall_current_a=1.1,
                no_load_velocity_rad_s=11.938,
                gear_ratio=238.0,
                rotor_inertia_kg_m2=2.0e-8,
                coulomb_nm=0.025,
                viscous_nm_s_rad=0.0015,
                gear_stiffness_nm_rad=12.0,
                gear_damping_nm_s_rad=0.0015,
                gain_register="p_gain",
                gains=(8, 16, 32, 64),
                source="thesis, servo table; Coulomb as published fits, rotor assumed",
                registers=MappingProxyType({"return_delay_time": 0, "punch": 0}),
                roles=MappingProxyType(_AX_ROLES),
                load_refresh_s=0.130,
            ),
            Sheet(
                model="MX-64",
                rated_voltage_v=12.0,
                stall_torque_nm=6.0,
                stall_current_a=4.1,
                no_load_velocity_rad_s=6.597,
                gear_ratio=200.0,
                rotor_inertia_kg_m2=3.0e-7,
                coulomb_nm=0.12,
                viscous_nm_s_rad=0.03,
                gear_stiffness_nm_rad=100.0,
                gear_damping_nm_s_rad=0.1,
                gain_register="p_gain",
                gains=(4, 8, 16, 32),
                source="e-manual, 63 rpm and 6.0 N m at 12 V; rotor and friction assumed",
                registers=MappingProxyType({"return_delay_time": 0, "punch": 0}),
                roles=MappingProxyType(_AX_ROLES),
            ),
        )
    }
)


def gain_registers(sheet: Sheet, raw: int) -> dict[str, int]:
    """The registers that set the gain to ``raw`` (both sides of a compliance slope)."""
    if sheet.gain_register == "cw_compliance_slope":
        return {"cw_compliance_slope": raw, "ccw_compliance_slope": raw}
    return {sheet.gain_register: raw}
