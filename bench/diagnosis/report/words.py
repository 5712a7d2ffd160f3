"""A diagnosis in plain words, for the terminal and for the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from bench.diagnosis.result import Cause, Diagnosis, Estimate
from sim.effects import catalogue

#: what an effect is, for a reader who does not know its name; others are told by their equation
MEANINGS: Mapping[str, str] = MappingProxyType(
    {
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
        "stribeck_friction": "more friction at standstill than when moving",
        "supply_voltage": "a supply of another voltage",
        "thermal_derating": "a motor that weakens as it warms",
        "torque_constant": "a motor of another strength",
        "torque_limit": "a limit of the drive",
        "transport_delay": "commands that arrive late",
        "velocity_limit": "a limit of the speed",
        "viscous_friction": "friction growing with speed that is not as believed",
        "voltage_sag": "a supply that gives way under current",
        "zero_offset": "a zero of the angle that is not where believed",
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
UNITS: Mapping[str, str] = MappingProxyType({"position": "rad", "duty": "(ratio)", "voltage": "V"})

QUIET = 2.0  #: of a channel's rounding: noise below it says that the model holds there
BETTER = 0.8  #: of the misfit before: what is below it got better


def plain(name: str) -> str:
    """A name without its underscores."""
    return name.replace("_", " ")


def meaning(effect: str) -> str:
    """What an effect is, in a few words."""
    if effect in MEANINGS:
        return MEANINGS[effect]
    known = catalogue().get(effect)
    return known.equation if known is not None else plain(effect)


def phase(name: str) -> str:
    """When in a motion."""
    return PHASES.get(name, plain(name))


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
    return f"{value:.{digits}g}"


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit; small times in milliseconds, angles in degrees as well."""
    if value is None or not math.isfinite(value):
        return number(value)
    if unit == "rad":
        return f"{number(value)} rad ({number(math.degrees(value))}°)"
    if unit == "s" and abs(value) < 0.1:
        return f"{number(1e3 * value)} ms"
    return number(value) if unit == "(ratio)" else f"{number(value)} {unit}"


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
    """A share of one in per cent; a chance that is not quite certain is never called 100 %."""
    if share is None or not math.isfinite(share):
        return "none"
    if 0.0 < share < 0.005:
        return "< 1 %"
    return "> 99 %" if 0.995 <= share < 1.0 else f"{100.0 * share:.0f} %"


def chance(p: float) -> str:
    """A p-value."""
    return f"p = {number(p, 2)}" if p >= 1e-3 else "p < 0.001"


def nats(value: float) -> str:
    """A gain."""
    return f"{value:.0f} nats" if abs(value) >= 10.0 else f"{value:.1f} nats"


def interval(estimate: Estimate) -> str:
    """A 95 % interval, in the unit of the value."""
    low, high = estimate.ci95
    unit = estimate.unit
    if unit == "rad":
        return f"{number(low)} to {number(high)} rad"
    if unit == "s" and abs(estimate.value) < 0.1:
        return f"{number(1e3 * low)} to {number(1e3 * high)} ms"
    return f"{number(low)} to {number(high)}" + ("" if unit == "(ratio)" else f" {unit}")


def state(estimate: Estimate) -> str:
    """What the state of a parameter means."""
    kind = "trade-off" if estimate.state.startswith("trade-off") else estimate.state
    return STATES.get(kind, "")


def named(cause: Cause) -> str:
    """A cause with its place: ``backlash of arm``."""
    return f"{plain(cause.effect)} of {joined(cause.scope)}" if cause.scope else plain(cause.effect)


def judged_on(diagnosis: Diagnosis) -> str:
    """What the numbers before and after are taken from."""
    count = len(diagnosis.fit.recordings)
    recordings = f"{count} recording" + ("s" if count != 1 else "")
    if diagnosis.fit.held_out:
        return f"{recordings} not used to fit"
    return f"the same {recordings} the fit has seen"


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a sentence or two."""
    names = joined(_with_rivals(cause) for cause in diagnosis.causes)
    joints = joined(sorted({joint for m in diagnosis.mismatch for joint in m["joints"]}))
    at = f" at {joints}" if joints else ""
    if diagnosis.verdict == "consistent":
        return (
            "The recordings are consistent with the model: nothing of the catalogue is missing "
            "that these recordings could show."
        )
    if diagnosis.verdict == "unexplained":
        return (
            f"The recordings differ from the model{at} in a way that repeats, and no effect of "
            "the catalogue explains it. No cause is named."
        )
    told = f"The recordings differ from the model{at}."
    if diagnosis.verdict == "explained":
        return f"{told} What explains it: {names}."
    return (
        f"{told} Part of it: {names}. Something else that repeats is left, and no effect of the "
        "catalogue explains it."
    )


def _with_rivals(cause: Cause) -> str:
    how = "wrong value" if cause.kind == "wrong_value" else "missing"
    told = f"{named(cause)} ({how}; {percent(cause.explained_share)} of the misfit)"
    rivals = [plain(rival.effect) for rival in cause.indistinguishable_from]
    return f"{told}, or {joined(rivals, 'or')}: not told apart" if rivals else told


def places(diagnosis: Diagnosis) -> list[str]:
    """Where the mismatch lives, a sentence a part of the motion."""
    return [
        f"{joined(m['joints'])} {phase(m['phase'])}: {percent(m['share'])} of the misfit"
        + (f" in {percent(m['time_share'])} of the time" if "time_share" in m else "")
        + f" ({chance(m['p_value'])})"
        for m in diagnosis.mismatch
    ]


def channel_finding(channel: Mapping[str, Any]) -> str:
    """What a channel's residual says of its part of the way."""
    rounding, after, before = (channel[k] for k in ("rounding", "rms_after", "rms_before"))
    better = after <= BETTER * before
    noise = channel.get("noise")
    if (after if noise is None else noise) <= QUIET * rounding:
        left = "nothing is left but rounding and the uncertain instants of samples"
        return f"explained: {left}" if better else f"cleared: {left}"
    if better:
        return "better, but more than rounding is left"
    return "no better: more than rounding is left, and what was named does not touch it"


def rejection(rejected: Mapping[str, Any]) -> tuple[str, str]:
    """A rejected name and why."""
    why = rejected.get("why") or rejected.get("reason")
    if why is None:
        rest = {k: v for k, v in rejected.items() if k not in ("effect", "scope")}
        why = ", ".join(f"{plain(k)} {_told(v)}" for k, v in rest.items())
    return plain(str(rejected["effect"])), str(why)


def _told(value: Any) -> str:
    return number(value) if isinstance(value, float) else plain(str(value))


def remains(unexplained: Mapping[str, Any]) -> str:
    """What is left unexplained, and where."""
    where = joined(phase(name) for name in unexplained.get("where", ()))
    share, size = unexplained.get("share"), unexplained.get("predictable_rad")
    told = joined(unexplained.get("joints", ())) or "somewhere"
    if size is not None:
        told += f": {degrees(size)} of what is left could be foretold"
    if share is not None:
        told += f", {percent(share)} of its square"
    told += f"; most of it {where}" if where else ""
    terms = [
        f"{plain(str(name))} ({value:+.2f})"
        for name, value in dict(unexplained.get("terms", {})).items()
    ]
    return told + (f"; it goes with {joined(terms)}" if terms else "")


def experiments(diagnosis: Diagnosis) -> list[str]:
    """What to record next, and what for."""
    told = []
    for each in diagnosis.next_experiment:
        how = ", ".join(f"{plain(k)} {_told(v)}" for k, v in each.arguments.items())
        told.append(
            f"{each.experiment}"
            + (f" ({how})" if how else "")
            + f": tells {joined(plain(s) for s in each.separates)} apart"
            + f" with a chance of {percent(each.power)}"
        )
    return told


def advice(diagnosis: Diagnosis) -> list[str]:
    """What a person can do now, the most useful first."""
    told = [f"record {each}" for each in experiments(diagnosis)]
    rivals = sorted({r.effect for c in diagnosis.causes for r in c.indistinguishable_from})
    if rivals and not told:
        told.append(
            "record a motion in which the rivals differ (slower, faster, loaded, lifted, another "
            "gain), and diagnose again with all recordings"
        )
    if diagnosis.unexplained:
        told.append(
            "look at what is left in the report: where it lives says what kind of physics it is"
        )
    if not diagnosis.fit.held_out:
        told.append(
            "record more groups of motions (at least three), so that some can judge what the "
            "others fit"
        )
    far = any(e.state == "at bound" for c in diagnosis.causes for e in c.parameters.values())
    if far:
        told.append(
            "mistrust the cause whose parameter is at its bound; try --without it, and see what "
            "takes its place"
        )
    if diagnosis.causes:
        told.append("use the better model: busemu serve --robot {model}")
    elif diagnosis.verdict == "consistent":
        told.append(
            "go on with this model; faster, slower or more loaded motions may still show more"
        )
    return told


def measured(channel: Mapping[str, Any], key: str) -> str:
    """A value of a channel's row, in its unit."""
    unit = UNITS.get(channel["channel"], "")
    value = float(channel[key])
    return degrees(value) if unit == "rad" else quantity(value, unit)
