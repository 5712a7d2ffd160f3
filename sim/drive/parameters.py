"""Parameters of a servo drive: from a data sheet's four numbers to the motor's constants.

A data sheet gives stall torque ``T`` and current ``I`` and no-load velocity ``w0`` and current
``i0`` at a voltage ``V``, all at the output shaft. The motor equation ``torque = k (duty V -
ke w) / R`` and the friction level then follow::

    R  = V / I                                 at stall there is no back-EMF
    k  = (T + friction at stall) / I           the data sheet's torque is what is left for the load
    ke = (V - R i0) / w0
    Kv = (k i0 (1 - Km) - Kc) / w0             at no load, current only pays for friction

``k < ke`` comes out for real servos: gear losses. Fitted constants may stand in the robot's file
instead; either way :meth:`DriveParameters.check` refuses constants that cannot reproduce the data
sheet, because a fit to too little data can be far off and still look good.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ..entries import Section
from . import fields, rotor
from .fields import Array

COPPER_RISE_PER_K = 0.0039  #: of a winding's resistance
DATA_SHEET_TOLERANCE = 0.25  #: assumed: spread of specimens and of fits worth believing


@dataclass(frozen=True, slots=True)
class DataSheet:
    """What the maker promises, at the output shaft."""

    voltage_v: float
    stall_torque_nm: float
    stall_current_a: float
    no_load_velocity_rad_s: float
    no_load_current_a: float


@dataclass(frozen=True, slots=True)
class Friction:
    """Friction level, model M6 of Duclusaud et al. (2025); zeros switch a term off.

    With ``s = exp(-|w / stribeck_velocity|^stribeck_exponent)``, motor torque ``tm``, external
    torque ``te``: ``Kc + Kv|w| + |Km tm - Ke te| + s (Kcs + |Kms tm - Kes te| + Q)``, where ``Q``
    is ``Keq te^2`` if ``|tm| > |te|`` else ``Kmq tm^2``, and only where the two oppose. ``te`` is
    what gravity, a cable or a hand do to the load, as in the paper; or a ``load_of_gear`` of it is
    what the gear passes on, with which the load's inertia comes. Behind a physics engine, which
    does not tell them apart, all of it is.
    """

    coulomb_nm: float = 0.0
    viscous_nm_s_rad: float = 0.0
    stribeck_nm: float = 0.0
    stribeck_velocity_rad_s: float = 0.1
    stribeck_exponent: float = 1.0
    load_motor: float = 0.0
    load_external: float = 0.0
    load_motor_stribeck: float = 0.0
    load_external_stribeck: float = 0.0
    quadratic_motor_per_nm: float = 0.0
    quadratic_external_per_nm: float = 0.0

    @property
    def of_load(self) -> bool:
        """Whether any of it grows with a torque."""
        return any(getattr(self, name) != 0.0 for name in _OF_LOAD)

    def level_nm(self, velocity_rad_s: float, motor_nm: float, external_nm: float) -> float:
        """The friction level [N m], as the compiled step has it."""
        params = np.zeros((fields.PARAMS, 1))
        for name, field in _FRICTION_FIELDS.items():
            params[field] = getattr(self, name)
        train = rotor.train(
            params, 0, 0.0, 0.0, rotor.falling(params, 0), rotor.is_raised(params, 0)
        )
        return float(rotor.friction_level(train, velocity_rad_s, motor_nm, external_nm))


_FRICTION_FIELDS = {
    "coulomb_nm": fields.COULOMB,
    "viscous_nm_s_rad": fields.VISCOUS,
    "stribeck_nm": fields.STRIBECK,
    "stribeck_velocity_rad_s": fields.STRIBECK_VELOCITY,
    "stribeck_exponent": fields.STRIBECK_EXPONENT,
    "load_motor": fields.LOAD_MOTOR,
    "load_external": fields.LOAD_EXTERNAL,
    "load_motor_stribeck": fields.LOAD_MOTOR_STRIBECK,
    "load_external_stribeck": fields.LOAD_EXTERNAL_STRIBECK,
    "quadratic_motor_per_nm": fields.QUADRATIC_MOTOR,
    "quadratic_external_per_nm": fields.QUADRATIC_EXTERNAL,
}


_OF_LOAD = tuple(name for name in _FRICTION_FIELDS if "motor" in name or "external" in name)


@dataclass(frozen=True, slots=True)
class DriveParameters:
    """Everything about one servo that its drive needs. All at the output shaft, SI.

    Below ``resistance_rise_per_k`` stands what a data sheet does not tell and the catalogue of
    effects switches on; the values here are off.
    """

    data_sheet: DataSheet
    resistance_ohm: float
    torque_constant_nm_a: float
    back_emf_v_s_rad: float
    rotor_inertia_kg_m2: float  #: times the gear ratio squared
    friction: Friction
    gear_stiffness_nm_rad: float
    gear_damping_nm_s_rad: float
    backlash_rad: float
    sensor_step_rad: float
    velocity_full_scale_rad_s: float
    velocity_gain_s_rad: float
    ambient_c: float
    heat_resistance_k_w: float
    heat_time_constant_s: float
    resistance_rise_per_k: float
    gain_scale: float = 1.0
    margin_more_rad: float = 0.0
    punch_more: float = 0.0
    punch_left_out: float = 0.0
    breakaway_rad: float = 0.0
    integral_more_per_rad_s: float = 0.0
    velocity_cap_rad_s: float = math.inf
    acceleration_cap_rad_s2: float = math.inf
    duty_cap: float = 1.0
    current_cap_a: float = math.inf
    torque_droop_per_a: float = 0.0
    load_of_gear: float = 0.0
    delay_s: float = 0.0
    zero_offset_rad: float = 0.0
    wave_rad: float = 0.0
    wave_periods: float = 1.0
    wave_phase_rad: float = 0.0
    cable_stiffness_nm_rad: float = 0.0
    cable_rest_rad: float = 0.0
    winding_heat_resistance_k_w: float = 0.0
    winding_heat_time_s: float = 1.0
    overload_duty: float = math.inf
    overload_time_s: float = 1.0

    def stall_torque_nm(self, voltage_v: float) -> float:
        """Largest torque the shaft can raise a load with at a voltage, cold."""
        motor = self._motor_nm(voltage_v)
        return _torque_left(self.friction.level_nm, motor)

    @property
    def lost_at_stall(self) -> float:
        """Share of the stalled motor's torque that friction takes, at the data sheet's voltage."""
        sheet = self.data_sheet
        return 1.0 - self.stall_torque_nm(sheet.voltage_v) / self._motor_nm(sheet.voltage_v)

    def no_load_velocity_rad_s(self, voltage_v: float) -> float:
        """Velocity without load at full duty and a voltage, cold."""

        def surplus(velocity: float) -> float:
            emf = self.back_emf_v_s_rad * velocity
            motor = self._motor_nm(voltage_v - emf)
            return motor - self.friction.level_nm(velocity, motor, 0.0)

        return _root(surplus, 0.0, voltage_v / self.back_emf_v_s_rad)

    def _motor_nm(self, across_v: float) -> float:
        """Torque of the cold motor at a voltage, less its back-EMF, across the winding."""
        current = across_v / self.resistance_ohm
        return self.torque_constant_nm_a * current / (1.0 + self.torque_droop_per_a * abs(current))

    def check(self) -> str | None:
        """What contradicts the data sheet, or ``None``."""
        sheet = self.data_sheet
        for what, unit, has, wanted in (
            ("stall torque", "N m", self.stall_torque_nm(sheet.voltage_v), sheet.stall_torque_nm),
            (
                "no-load velocity",
                "rad/s",
                self.no_load_velocity_rad_s(sheet.voltage_v),
                sheet.no_load_velocity_rad_s,
            ),
        ):
            if abs(has / wanted - 1.0) > DATA_SHEET_TOLERANCE:
                return (
                    f"constants give a {what} of {has:.3g} {unit} at {sheet.voltage_v:g} V, the "
                    f"data sheet {wanted:.3g} {unit}: more than {DATA_SHEET_TOLERANCE:.0%} apart"
                )
        return None

    def column(self) -> Array:
        """These parameters as one column of the kernel's parameter array."""
        column = np.zeros(fields.PARAMS)
        for name, field in _FIELDS.items():
            column[field] = getattr(self, name)
        for name, field in _FRICTION_FIELDS.items():
            column[field] = getattr(self.friction, name)
        return column


_FIELDS = {
    "resistance_ohm": fields.RESISTANCE,
    "torque_constant_nm_a": fields.TORQUE_CONSTANT,
    "back_emf_v_s_rad": fields.BACK_EMF,
    "rotor_inertia_kg_m2": fields.ROTOR_INERTIA,
    "gear_stiffness_nm_rad": fields.GEAR_STIFFNESS,
    "gear_damping_nm_s_rad": fields.GEAR_DAMPING,
    "backlash_rad": fields.BACKLASH,
    "sensor_step_rad": fields.SENSOR_STEP,
    "velocity_full_scale_rad_s": fields.VELOCITY_SCALE,
    "velocity_gain_s_rad": fields.VELOCITY_GAIN,
    "ambient_c": fields.AMBIENT,
    "heat_resistance_k_w": fields.HEAT_RESISTANCE,
    "heat_time_constant_s": fields.HEAT_TIME,
    "resistance_rise_per_k": fields.RESISTANCE_RISE,
    "gain_scale": fields.GAIN_SCALE,
    "margin_more_rad": fields.MARGIN_MORE,
    "punch_more": fields.PUNCH_MORE,
    "punch_left_out": fields.PUNCH_LEFT_OUT,
    "breakaway_rad": fields.BREAKAWAY,
    "integral_more_per_rad_s": fields.INTEGRAL_MORE,
    "velocity_cap_rad_s": fields.VELOCITY_CAP,
    "acceleration_cap_rad_s2": fields.ACCELERATION_CAP,
    "duty_cap": fields.DUTY_CAP,
    "current_cap_a": fields.CURRENT_CAP,
    "torque_droop_per_a": fields.TORQUE_DROOP,
    "load_of_gear": fields.LOAD_OF_GEAR,
    "delay_s": fields.DELAY,
    "zero_offset_rad": fields.ZERO_OFFSET,
    "wave_rad": fields.WAVE,
    "wave_periods": fields.WAVE_PERIODS,
    "wave_phase_rad": fields.WAVE_PHASE,
    "cable_stiffness_nm_rad": fields.CABLE_STIFFNESS,
    "cable_rest_rad": fields.CABLE_REST,
    "winding_heat_resistance_k_w": fields.WINDING_HEAT_RESISTANCE,
    "winding_heat_time_s": fields.WINDING_HEAT_TIME,
    "overload_duty": fields.OVERLOAD_DUTY,
    "overload_time_s": fields.OVERLOAD_TIME,
}


def pack(drives: Sequence[DriveParameters]) -> Array:
    """The kernel's parameter array of several servos: shape (PARAMS, servos)."""
    return np.ascontiguousarray(np.stack([drive.column() for drive in drives], axis=1))


_FRICTION = {  # key: unit, lowest, highest
    "coulomb_nm": ("N m", 0.0, 10.0),
    "viscous_nm_s_rad": ("N m s/rad", 0.0, 10.0),
    "stribeck_nm": ("N m", 0.0, 10.0),
    "stribeck_velocity_rad_s": ("rad/s", 1e-4, 100.0),
    "stribeck_exponent": ("(exponent)", 0.1, 10.0),
    "load_motor": ("(ratio)", 0.0, 0.9),
    "load_external": ("(ratio)", 0.0, 0.9),
    "load_motor_stribeck": ("(ratio)", 0.0, 0.9),
    "load_external_stribeck": ("(ratio)", 0.0, 0.9),
    "quadratic_motor_per_nm": ("1/(N m)", 0.0, 10.0),
    "quadratic_external_per_nm": ("1/(N m)", 0.0, 10.0),
}


_KEYS = (
    "rated_voltage_v", "stall_torque_nm", "stall_current_a", "no_load_velocity_rad_s",
    "no_load_current_a", "gear_ratio", "motor_inertia_kg_m2", "resistance_ohm",
    "torque_constant_nm_a", "back_emf_v_s_rad", "gear_stiffness_nm_rad", "gear_damping_nm_s_rad",
    "backlash_rad", "sensor_step_rad", "velocity_full_scale_rad_s", "velocity_gain_s_rad",
    "ambient_c", "heat_resistance_k_w", "heat_time_constant_s", "resistance_rise_per_k",
)  # fmt: skip


def read_drive(section: Section) -> DriveParameters:
    """The drive of one servo model from its section of a robot file.

    A gear without a stiffness is rigid: fine for rollouts of one joint, not for a physics engine. A
    winding without a heat resistance stays cold.

    Raises :class:`sim.entries.PhysicsError` for what is missing, out of bounds or contradicts the
    data sheet.
    """
    section.only(*_KEYS, *_FRICTION)
    sheet = DataSheet(
        voltage_v=section.number("rated_voltage_v", "V", 1.0, 50.0),
        stall_torque_nm=section.number("stall_torque_nm", "N m", 0.01, 100.0),
        stall_current_a=section.number("stall_current_a", "A", 0.01, 50.0),
        no_load_velocity_rad_s=section.number("no_load_velocity_rad_s", "rad/s", 0.1, 100.0),
        no_load_current_a=section.number("no_load_current_a", "A", 0.0, 10.0),
    )
    if sheet.no_load_current_a >= sheet.stall_current_a:
        raise section.fail(
            f"no_load_current_a = {sheet.no_load_current_a} A is not below "
            f"stall_current_a = {sheet.stall_current_a} A"
        )
    ratio = section.number("gear_ratio", "(ratio)", 1.0, 2000.0)
    inertia = section.number("motor_inertia_kg_m2", "kg m^2", 1e-10, 1e-3)
    resistance = section.number(
        "resistance_ohm", "ohm", 0.1, 1000.0, default=sheet.voltage_v / sheet.stall_current_a
    )
    friction = _friction(section)
    constant = section.number(
        "torque_constant_nm_a", "N m/A", 1e-3, 100.0, default=_torque_constant(sheet, friction)
    )
    if "viscous_nm_s_rad" not in section:
        spare = constant * sheet.no_load_current_a * (1.0 - friction.load_motor)
        viscous = (spare - friction.coulomb_nm) / sheet.no_load_velocity_rad_s
        if viscous < 0.0:
            raise section.fail(
                f"coulomb_nm = {friction.coulomb_nm} N m is more than the no-load current pays "
                f"for ({spare:.3g} N m): lower it, raise no_load_current_a, or give "
                "viscous_nm_s_rad"
            )
        friction = Friction(**(asdict(friction) | {"viscous_nm_s_rad": viscous}))
    emf = (sheet.voltage_v - resistance * sheet.no_load_current_a) / sheet.no_load_velocity_rad_s
    drive = DriveParameters(
        data_sheet=sheet,
        resistance_ohm=resistance,
        torque_constant_nm_a=constant,
        back_emf_v_s_rad=section.number("back_emf_v_s_rad", "V s/rad", 1e-3, 100.0, default=emf),
        rotor_inertia_kg_m2=inertia * ratio**2,
        friction=friction,
        gear_stiffness_nm_rad=section.number(
            "gear_stiffness_nm_rad", "N m/rad", 0.1, 1e5, default=math.inf
        ),
        gear_damping_nm_s_rad=section.number(
            "gear_damping_nm_s_rad", "N m s/rad", 0.0, 100.0, default=0.0
        ),
        backlash_rad=section.number("backlash_rad", "rad", 0.0, 0.2, default=0.0),
        sensor_step_rad=section.number("sensor_step_rad", "rad", 0.0, 0.1, default=0.0),
        velocity_full_scale_rad_s=section.number(
            "velocity_full_scale_rad_s", "rad/s", 0.1, 1000.0, default=sheet.no_load_velocity_rad_s
        ),
        velocity_gain_s_rad=section.number("velocity_gain_s_rad", "s/rad", 0.0, 100.0, default=0.0),
        ambient_c=section.number("ambient_c", "degC", -40.0, 80.0, default=25.0),
        heat_resistance_k_w=section.number("heat_resistance_k_w", "K/W", 0.0, 1000.0, default=0.0),
        heat_time_constant_s=section.number("heat_time_constant_s", "s", 0.1, 1e5, default=100.0),
        resistance_rise_per_k=section.number(
            "resistance_rise_per_k", "1/K", 0.0, 0.01, default=COPPER_RISE_PER_K
        ),
    )
    if problem := drive.check():
        raise section.fail(
            f"{problem}; change resistance_ohm, torque_constant_nm_a, back_emf_v_s_rad or the "
            "friction, or leave the first three away"
        )
    return drive


def _friction(section: Section) -> Friction:
    defaults = asdict(Friction())
    return Friction(
        **{
            key: section.number(key, unit, low, high, default=defaults[key])
            for key, (unit, low, high) in _FRICTION.items()
        }
    )


def _torque_constant(sheet: DataSheet, friction: Friction) -> float:
    def surplus(motor: float) -> float:
        wanted = sheet.stall_torque_nm
        return motor - wanted - friction.level_nm(0.0, motor, -wanted)

    return _root(surplus, 0.0, 100.0 * sheet.stall_torque_nm) / sheet.stall_current_a


def _torque_left(level: Callable[[float, float, float], float], motor: float) -> float:
    return _root(lambda load: motor - load - level(0.0, motor, -load), 0.0, motor)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a monotone function changes its sign, by bisection; an end when it does not."""
    rising = function(high) > 0.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not math.isfinite(middle) or middle in (low, high):
            break
        if (function(middle) > 0.0) == rising:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)
