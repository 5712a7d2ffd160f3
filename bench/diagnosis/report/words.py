"""Plain words for what a diagnosis speaks of: effects, parts of a motion, numbers with units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from sim.effects import catalogue

#: what an effect is, for a reader who does not know its name; others are told by their equation
MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "acceleration_limit": "a limit of how fast the speed changes",
        "back_emf": "a motor that turns faster or slower at no load than believed",
        "backlash": "play between the teeth of the gear",
        "cable_drag": "a cable that pulls on the joint",
        "com_offset": "a centre of mass that is elsewhere",
        "coulomb_friction": "dry friction that is not as believed",
        "current_limit": "a limit of the motor's current",
        "dead_zone": "a margin around the goal in which the controller does nothing",
        "directional_load_friction": "friction that differs between driving and being driven",
        "encoder_nonlinearity": "an angle sensor that is not straight",
        "foot_compliance": "feet that give way",
        "foot_slip": "feet that slip",
        "gain_error": "a controller's gain that is not as believed",
        "ground_compliance": "ground that gives way",
        "ground_tilt": "ground that is not level",
        "integral_action": "an integral part of the controller",
        "joint_compliance": "a gear or link that twists under load",
        "latency_timer": "an adapter that holds bytes back",
        "leg_geometry": "links of another length",
        "link_mass": "a link of another mass",
        "load_friction": "gear friction that grows with the torque it passes on",
        "load_refresh": "a load register that is seldom renewed",
        "lost_samples": "readings that went wrong",
        "overload_shutdown": "a servo that switches off under lasting load",
        "payload": "a weight nobody told of",
        "punch": "a least drive as soon as there is any error",
        "read_skew": "positions sampled at another time than believed",
        "rotor_inertia": "a rotor that is harder or easier to spin up than believed",
        "stall_torque": "a motor that is stronger or weaker at stall than believed",
        "stribeck_friction": "more friction at standstill than when moving",
        "supply_voltage": "a supply of another voltage",
        "thermal_derating": "a motor that weakens as it warms",
        "torque_constant": "a motor of another strength",
        "torque_droop": "a motor whose torque falls behind its current",
        "torque_limit": "a limit of the drive",
        "transport_delay": "commands that arrive late",
        "velocity_limit": "a limit of the speed",
        "viscous_friction": "friction growing with speed that is not as believed",
        "voltage_sag": "a supply that gives way under current",
        "zero_offset": "a zero of the angle that is not where believed",
    }
)

#: what is never exactly as believed, for a reader who does not know its name
TOLERANCES: Mapping[str, str] = MappingProxyType(
    {
        "torque_constant": "strength of the motor",
        "back_emf": "back-EMF beside it",
        "coulomb_level": "dry friction",
        "viscous_level": "friction growing with speed",
        "rotor_level": "inertia of the rotor",
        "link": "mass of the link",
        "centre": "centre of mass across the link",
        "payload": "weight that was put on",
        "load_inertia": "inertia of link and weight",
        "zero": "zero of the angle",
        "tilt": "tilt of the stand",
        "tilt_across": "tilt of the stand across",
        "sampling": "instants of samples",
        "supply": "voltage of the supply",
        "gain": "gain of the controller",
        "punch": "share of the punch left out",
        "presliding": "way before friction slips",
        "load_of_gear": "share of the gear's torque in friction of load",
        "stall_torque": "torque at stall, of what it was told",
        "gear_stiffness": "stiffness of the gear",
        "gear_damping": "damping of the gear",
    }
)

PHASES: Mapping[str, str] = MappingProxyType(
    {
        "at_rest": "at rest",
        "first_second": "in the first second",
        "high_load": "under high load",
        "high_speed": "at high speed",
        "late": "in the last quarter",
        "reversal": "after a reversal",
        "saturation": "at full drive",
        "stance": "in stance",
        "swing": "in swing",
        "touchdown": "at touchdown",
    }
)

#: what is to be recorded, in a few words
MOTIONS: Mapping[str, str] = MappingProxyType(
    {
        "chirp": "a sine that gets faster",
        "dither": "a small triangle to and fro around several places",
        "hold": "a smooth way to one place, and staying there",
        "lift_and_drop": "lifted smoothly, then the torque goes off and it falls",
        "sin_sin": "two sines, the second swelling",
        "sine_fast": "one fast sine",
        "slow_ramp": "from one end to the other and back at one slow speed",
        "steps": "steps of different heights, up and down",
    }
)

#: what is said of a parameter's value, and what that means
STATES: Mapping[str, str] = MappingProxyType(
    {
        "pinned": "the recordings determine it",
        "trade-off": "another number can take its place: only both together are determined",
        "flat": "the recordings hardly depend on it: its interval is wide",
        "at bound": "it went as far as it may: the real cause may be another one",
        "dead": "the recordings do not depend on it at all",
    }
)

#: parts of the way from a goal to a motion, by the kind of residual that judges them
PATHS: Mapping[str, str] = MappingProxyType(
    {"position": "motion", "duty": "controller", "voltage": "supply"}
)
UNITS: Mapping[str, str] = MappingProxyType(
    {"position": "rad", "duty": "(ratio)", "voltage": "V", "height": "m", "lean": "rad"}
)


def plain(name: str) -> str:
    """A name without its underscores."""
    return name.replace("_", " ")


def placed(name: str) -> str:
    """A name with its place, if that is not the whole robot: ``backlash of femur``."""
    effect, _, place = name.partition("@")
    kind, _, along = effect.partition(".")
    told = f"{plain(kind)} in {along}" if along else plain(kind)
    return told if place in {"", "all"} else f"{told} of {place}"


def meaning(effect: str) -> str:
    """What an effect is, in a few words."""
    if effect in MEANINGS:
        return MEANINGS[effect]
    known = catalogue().get(effect)
    return known.equation if known is not None else plain(effect)


def phase(name: str) -> str:
    """When in a motion."""
    return PHASES.get(name, plain(name))


#: a leg, or a joint of one; so many of them are told in few words
LEGGED, FEW = re.compile(r"(?P<leg>leg\d+)(?:\.(?P<part>\w+))?"), 4


def in_few(names: Iterable[str]) -> str:
    """Joints or legs in few words: ``femur and tibia of leg1 to leg6``; a few as they are."""
    every = list(names)
    told = [LEGGED.fullmatch(name) for name in every]
    if len(every) < FEW or not all(told):
        return joined(every)
    parts: dict[str, list[str]] = {}
    for match in told:
        assert match is not None
        parts.setdefault(match["leg"], []).append(match["part"] or "")
    alike: dict[str, list[str]] = {}
    for leg in sorted(parts, key=lambda leg: int(leg[3:])):
        alike.setdefault(joined(sorted(filter(None, parts[leg]))), []).append(leg)
    return joined(f"{own} of {_run(legs)}" if own else _run(legs) for own, legs in alike.items())


def _run(legs: Sequence[str]) -> str:
    """Legs in order, those that follow each other by the first and the last."""
    numbers = [int(leg[3:]) for leg in legs]
    if len(legs) > 2 and numbers[-1] - numbers[0] == len(legs) - 1:
        return f"{legs[0]} to {legs[-1]}"
    return joined(legs)


def joined(parts: Iterable[str], last: str = "and") -> str:
    """``a, b and c``."""
    words = list(parts)
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def number(value: float | None, digits: int = 3) -> str:
    """A number to so many digits; ``none`` where there is none."""
    if value is None or math.isnan(value):
        return "none"
    if math.isinf(value):
        return "infinite"
    return f"{float(f'{value:.{digits}g}'):g}"


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit; small times in milliseconds, angles in degrees as well."""
    if value is None or not math.isfinite(value):
        return number(value)
    if unit == "rad":
        return f"{number(value)} rad ({number(math.degrees(value))}°)"
    if unit == "s" and abs(value) < 0.1:
        return f"{number(1e3 * value)} ms"
    return number(value) if unit == "(ratio)" else f"{number(value)} {unit}"


def difference(value: float, unit: str) -> str:
    """How far a number is from what was believed; of ratios in per cent, of logarithms a factor."""
    if unit in ("(ratio)", "(share)"):
        return f"{100.0 * value:+.1f} %"
    if unit == "(logarithm)":
        return f"times {number(math.exp(value))}"
    return quantity(value, unit)


def degrees(value_rad: float) -> str:
    """An angle in degrees, to a thousandth below one."""
    value = math.degrees(value_rad)
    if not math.isfinite(value):
        return "none"
    return f"{value:.3f}°" if abs(value) < 1.0 else f"{value:.2f}°"


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def percent(share: float | None) -> str:
    """A share of one in per cent; none is called all of it, for nothing is certain."""
    if share is None or not math.isfinite(share):
        return "none"
    if 0.0 < share < 0.005:
        return "< 1 %"
    return "> 99 %" if share >= 0.995 else f"{100.0 * share:.0f} %"


def chance(p: float) -> str:
    """A p-value."""
    return f"p = {number(p, 2)}" if p >= 1e-3 else "p < 0.001"


def nats(value: float) -> str:
    """A gain."""
    return f"{value:.0f} nats" if abs(value) >= 10.0 else f"{value:.1f} nats"
