"""The one table that translates a key's parameters into those of the catalogue."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from bench.blind.rigs import RIGS
from bench.blind.scenes import SCENES
from bench.blind.servos import Sheet

Values = Mapping[str, float]
Translate = Callable[[Values, Values, Sheet | None], float]


@dataclass(frozen=True, slots=True)
class Truth:
    """A true value of a catalogue's parameter; ``off`` is where the effect is not there."""

    value: float
    off: float


def _is(name: str) -> Translate:
    return lambda value, off, sheet: value[name]


def _negative(name: str) -> Translate:
    return lambda value, off, sheet: -value[name]


def _wrapped(name: str) -> Translate:
    return lambda value, off, sheet: math.remainder(value[name], 2.0 * math.pi)


def _over_off(name: str) -> Translate:
    return lambda value, off, sheet: value[name] / off[name]


def _beyond_off(name: str) -> Translate:
    return lambda value, off, sheet: value[name] - off[name]


def _more_compliant(name: str) -> Translate:
    return lambda value, off, sheet: 1.0 / value[name] - 1.0 / off[name]


def _of_rotor(name: str) -> Translate:
    def translate(value: Values, off: Values, sheet: Sheet | None) -> float:
        assert sheet is not None, "a rotor's inertia is hidden on rigs only"
        return 1.0 + value[name] / sheet.armature_kg_m2

    return translate


#: by effect: the catalogue's parameters, the one that says how large it is first
TABLE: Mapping[str, Mapping[str, Translate]] = MappingProxyType(
    {
        "backlash": {"width_rad": _is("width_rad")},
        "cable_drag": {
            "stiffness_nm_rad": _is("stiffness_nm_rad"),
            "rest_rad": _is("rest_rad"),
        },
        "com_offset": {"x_m": _is("x_m")},
        "coulomb_friction": {"more_nm": _is("torque_nm")},
        "dead_zone": {"margin_rad": _is("margin_rad")},
        "directional_load_friction": {
            "driving": _is("motor_coefficient"),
            "backdriving": _is("external_coefficient"),
        },
        "encoder_nonlinearity": {
            "amplitude_rad": _is("amplitude_rad"),
            "periods": _is("harmonic"),
            "phase_rad": _wrapped("phase_rad"),
        },
        "gain_error": {"scale": _is("factor")},
        "integral_action": {"gain_per_rad_s": _is("gain_per_rad_s")},
        "joint_compliance": {"compliance_rad_nm": _more_compliant("stiffness_nm_rad")},
        "link_mass": {"scale": _is("factor")},
        "load_friction": {"ratio": _is("coefficient")},
        "load_refresh": {"period_s": _is("period_s")},
        "lost_samples": {"share": _is("rate")},
        "overload_shutdown": {"duty": _is("duty"), "time_s": _is("overload_s")},
        "payload": {"mass_kg": _is("mass_kg")},
        "punch": {"duty": _is("duty")},
        # the generator tells the age of what is shown, the catalogue how late a sample is taken
        "read_skew": {"skew_s": _negative("skew_s")},
        "rotor_inertia": {"scale": _of_rotor("inertia_kg_m2")},
        "stribeck_friction": {
            "stribeck_nm": _is("torque_nm"),
            "velocity_rad_s": _is("velocity_rad_s"),
        },
        "supply_voltage": {"scale": _over_off("voltage_v")},
        "thermal_derating": {
            "heat_resistance_k_w": _is("heat_resistance_k_w"),
            "time_s": _is("time_constant_s"),
        },
        "torque_limit": {"duty": _is("duty_limit")},
        "transport_delay": {"delay_s": _is("delay_s")},
        "velocity_limit": {"limit_rad_s": _is("limit_rad_s")},
        "viscous_friction": {"more_nm_s_rad": _is("coefficient_nm_s_rad")},
        "voltage_sag": {"resistance_ohm": _is("resistance_ohm")},
        # shown = true angle - angle in the key, angle + offset in the catalogue
        "zero_offset": {"offset_rad": _negative("angle_rad")},
    }
)
#: the same of whole robots, whose files already have some of it
ROBOT_TABLE: Mapping[str, Mapping[str, Translate]] = MappingProxyType(
    {
        **{name: TABLE[name] for name in ("backlash", "gain_error", "link_mass", "payload")},
        **{name: TABLE[name] for name in ("supply_voltage", "torque_limit")},
        "com_offset": {"y_m": _is("y_m")},
        "foot_compliance": {"stiffness_n_m": _is("stiffness_n_m")},
        "foot_slip": {"scale": _over_off("friction")},
        "ground_compliance": {"stiffness_n_m": _is("stiffness_n_m")},
        "ground_tilt": {"pitch_rad": _is("pitch_rad"), "roll_rad": _is("roll_rad")},
        "joint_compliance": {"compliance_rad_nm": _more_compliant("stiffness_nm_rad")},
        "voltage_sag": {"resistance_ohm": _beyond_off("resistance_ohm")},
    }
)
#: off values that are not 0
OFF: Mapping[str, float] = MappingProxyType(
    {
        "foot_compliance": math.inf,
        "foot_slip": 1.0,
        "gain_error": 1.0,
        "ground_compliance": math.inf,
        "link_mass": 1.0,
        "overload_shutdown": math.inf,
        "rotor_inertia": 1.0,
        "supply_voltage": 1.0,
        "torque_limit": 1.0,
        "velocity_limit": math.inf,
    }
)


def true_parameters(hidden: Mapping[str, Any], rig: str) -> dict[str, Truth]:
    """An effect's true parameters by the catalogue's names; ``hidden`` is an entry of a key.

    Empty for what is in no catalogue.
    """
    told = hidden["parameters"]
    value = {name: _number(q["value"]) for name, q in told.items()}
    off = {name: _number(q["off"]) for name, q in told.items()}
    names = _table(rig).get(hidden["effect"], {})
    sheet = None if rig in SCENES else RIGS[rig].sheet
    found = {}
    for index, (name, translate) in enumerate(names.items()):
        if all(map(math.isfinite, value.values())):
            where_off = OFF.get(hidden["effect"], 0.0) if index == 0 else math.nan
            found[name] = Truth(translate(value, off, sheet), where_off)
    return found


def main_parameter(effect: str, rig: str) -> str:
    """The catalogue's name of what says how large an effect is; empty where it has none."""
    return next(iter(_table(rig).get(effect, {})), "")


def error_of(true: Truth, estimate: float) -> float:
    """Error of an estimate as a share of how far the truth is from off; of itself for a limit."""
    size = abs(true.value) if math.isinf(true.off) else abs(true.value - true.off)
    return abs(estimate - true.value) / size


def _table(rig: str) -> Mapping[str, Mapping[str, Translate]]:
    return ROBOT_TABLE if rig in SCENES else TABLE


def _number(value: float | None) -> float:
    return math.inf if value is None else float(value)
