"""What a diagnosis says, in sentences, for the terminal and for the page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from bench.diagnosis.joint.regimes import EVERYWHERE
from bench.diagnosis.result import Cause, Diagnosis, Estimate

from .words import (
    MOTIONS,
    UNITS,
    chance,
    degrees,
    in_few,
    joined,
    number,
    percent,
    phase,
    placed,
    plain,
    quantity,
    sentence,
)

#: a misfit in a register that is too small to matter: of full drive, and of a voltage register
#: whose step is 0.1 V; assumed
SMALL: Mapping[str, float] = MappingProxyType({"duty": 0.01, "voltage": 0.1})
REGISTERS = MappingProxyType({"duty": "load or duty", "voltage": "voltage"})
ALIKE = 1.01  #: times the misfit of positions that is no other: one fit ends here, the next there
HARDLY = 1.02  #: times the misfit of positions that is no worse, where another register is better
QUIET = 2.0  #: of a channel's rounding: noise below it says that the model holds there
BETTER = 0.8  #: of the misfit before: what is below it got better
SAME = 0.98  #: of the same: what is above it did not change
SUFFIXES = MappingProxyType({"s": "s", "kg": "kg", "hz": "Hz"})  #: of arguments, and their units
TELLS = 0.75  #: power below which an experiment hardly tells two causes apart
NO_MORE = ", which is little: of those that were tried none does better"
ALWAYS = "torque_enable"  #: a register that is on in every experiment
UNSEEN = "cannot be seen in these recordings"  #: of a parameter that is dead
LITTLE = 0.1  #: of what can be explained: a cause that explains less is a hint at most
MUCH = 15.0  #: nats that it gains, from which it is more: it does what tolerances do less likely
HINT = "a hint at most, not the cause of what is seen"
#: parameters that are a direction of an effect
DIRECTIONS = MappingProxyType(
    {"x_m": "x", "y_m": "y", "z_m": "z", "pitch_rad": "pitch", "roll_rad": "roll"}
)


def interval(estimate: Estimate) -> str:
    """A 95 % interval, in the unit of the value."""
    low, high = estimate.ci95
    unit = estimate.unit
    if unit == "rad":
        return f"{number(low)} to {number(high)} rad"
    if unit == "s" and abs(estimate.value) < 0.1:
        return f"{number(1e3 * low)} to {number(1e3 * high)} ms"
    return f"{number(low)} to {number(high)}" + ("" if unit == "(ratio)" else f" {unit}")


def named(cause: Cause) -> str:
    """A cause with its place, and its direction: ``backlash of arm``, ``com offset of trunk in y``.

    Two directions of one effect are two causes of a whole robot.
    """
    told = f"{plain(cause.effect)} of {in_few(cause.scope)}" if cause.scope else plain(cause.effect)
    along = [DIRECTIONS[name] for name in cause.parameters if name in DIRECTIONS]
    return f"{told} in {along[0]}" if len(along) == 1 else told


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
    joints = in_few(sorted({joint for m in diagnosis.mismatch for joint in m["joints"]}))
    at = f" at {joints}" if joints else ""
    if diagnosis.verdict == "consistent":
        return (
            "The recordings are consistent with the model: nothing of the catalogue is missing "
            "that these recordings could show."
        )
    if diagnosis.verdict == "unexplained":
        way = "in a way that repeats" if _repeats(diagnosis) else "by more than noise"
        return (
            f"The recordings differ from the model{at} {way}, and no effect of the catalogue "
            "explains it. No cause is named."
        )
    rest = "that repeats" if _repeats(diagnosis) else "larger than noise"
    told = f"The recordings differ from the model{at}."
    if worse(diagnosis):
        plain_names = joined(named(cause) for cause in diagnosis.causes)
        told += f" {sentence(plain_names)[:-1]} fits some of them and does not hold on the others."
        if diagnosis.verdict == "explained":
            return told
        return f"{told} Something {rest} is left, and no effect of the catalogue explains it."
    if diagnosis.verdict == "explained":
        return f"{told} What explains it: {names}."
    return (
        f"{told} Part of it: {names}. Something else {rest} is left, and no effect of the "
        "catalogue explains it."
    )


def _repeats(diagnosis: Diagnosis) -> bool:
    """Whether recordings agree about something that is left."""
    return any(float(u.get("share", 1.0)) > 0.0 for u in diagnosis.unexplained)


def _with_rivals(cause: Cause) -> str:
    how = "wrong value" if cause.kind == "wrong_value" else "missing"
    share = percent(max(0.0, cause.explained_share))
    of = f" of {cause.shown_by}" if cause.shown_by else ""
    told = f"{named(cause)} ({how}; explains {share}{of})"
    rivals = [plain(rival.effect) for rival in cause.indistinguishable_from]
    return f"{told}, or {joined(rivals, 'or')}: not told apart" if rivals else told


def explains(cause: Cause) -> str:
    """What a cause takes away of the misfit, of what a perfect model could."""
    if cause.explained_share < 0.0:
        return "makes the misfit on the recordings that judge worse"
    of = cause.shown_by or "what can be explained"
    return f"explains {percent(cause.explained_share)} of {of}"


def hypothesis(row: Mapping[str, Any]) -> str:
    """What was fitted, of a row of the ranking: the effect, its place, and what shows it."""
    told = f"{placed(row['effect'])} of {row['joint']}" if "joint" in row else placed(row["effect"])
    return f"{told}, by {row['shown_by']}" if "shown_by" in row else told


def beneath(row: Mapping[str, Any]) -> str:
    """What was in the fit beside it."""
    return joined(map(placed, row["with"])) or "nothing"


def worse(diagnosis: Diagnosis) -> bool:
    """Whether what is named makes the recordings that judge fit worse, where samples tell."""
    if by_shaking(diagnosis):
        return False
    bearable = HARDLY if elsewhere(diagnosis) else ALIKE
    return bool(diagnosis.causes) and diagnosis.fit.after > bearable * diagnosis.fit.before


def by_shaking(diagnosis: Diagnosis) -> bool:
    """Whether play was named by how much a robot's joints shake: samples tell nothing of it."""
    return bool(diagnosis.details.get("shaking", {}).get("named"))


def elsewhere(diagnosis: Diagnosis) -> list[str]:
    """Registers other than the position that what is named follows better."""
    return [
        REGISTERS[str(c["channel"])]
        for c in diagnosis.channels
        if c["channel"] in REGISTERS and c["rms_after"] <= BETTER * c["rms_before"]
    ]


def cautions(diagnosis: Diagnosis) -> list[str]:
    """Why the answer should not be trusted too far; mostly nothing."""
    fit, told = diagnosis.fit, []
    if worse(diagnosis):
        told.append(
            f"On {judged_on(diagnosis)}, the model with what is named misses by more than before "
            f"({degrees(fit.after)} against {degrees(fit.before)}): neither the name nor its "
            "numbers hold there."
        )
    elif by_shaking(diagnosis):
        told.append(
            "Play shows in how much joints shake from sample to sample, and what it explains is a "
            "share of that. When legs rattle is chance, so that the misfit, "
            f"{degrees(fit.before)} without what is named and {degrees(fit.after)} with it, "
            "neither shows play nor denies it."
        )
    elif diagnosis.causes and sum(c.explained_share for c in diagnosis.causes) < LITTLE:
        if registers := elsewhere(diagnosis):
            told.append(
                f"What is named shows in the {joined(registers)} register. The misfit of which it "
                "explains a share is that of positions, which hardly change."
            )
        else:
            gains = any(c.held_out_gain_nats >= MUCH for c in diagnosis.causes)
            hint = "tolerances do that too, less likely so far off" if gains else HINT
            told.append(f"What is named takes next to nothing of the misfit away: {hint}.")
    if unfinished(diagnosis):
        told.append(
            "The time was used up before the search was done: what is named may not be all, and "
            "what is left may have a name."
        )
    if on_leash(diagnosis):
        told.append(
            "The joint swings by itself, and replays were led along what was recorded to keep step "
            "with it: misfits are smaller than without that. Limits has both."
        )
    doubtful = [c for c in diagnosis.causes if c.probability < 0.5]
    if doubtful:
        told.append(f"Less likely than not: {joined(named(c) for c in doubtful)}.")
    if diagnosis.causes and not fit.held_out:
        told.append("No recording was held out: what is named was judged on what was fitted.")
    return told


def unfinished(diagnosis: Diagnosis) -> bool:
    """Whether the time was used up before the search was done, at any joint."""
    return _at_any_joint(diagnosis, "stopped")


def on_leash(diagnosis: Diagnosis) -> bool:
    """Whether replays were led along what was recorded, as a joint swings by itself."""
    return _at_any_joint(diagnosis, "leash_rad_s")


def _at_any_joint(diagnosis: Diagnosis, detail: str) -> bool:
    joints = diagnosis.details.get("joints", {}).values()
    return any(details.get(detail) for details in (diagnosis.details, *joints))


def places(diagnosis: Diagnosis) -> list[str]:
    """Where the mismatch lives, a sentence a part of the motion."""
    return [
        f"{in_few(m['joints'])} {phase(m['phase'])}: {percent(m['share'])} of the misfit"
        + (f" in {percent(m['time_share'])} of the time" if "time_share" in m else "")
        + f" ({chance(m['p_value'])})"
        for m in diagnosis.mismatch
    ]


def channel_finding(channel: Mapping[str, Any], diagnosis: Diagnosis) -> str:
    """What a channel's residual says of its part of the way.

    A register that is read at another instant than its value was made leaves many times its
    rounding where nothing is wrong. So more than rounding is a finding only where the verdict finds
    that something is left.
    """
    rounding, after, before = (channel[k] for k in ("rounding", "rms_after", "rms_before"))
    better = after <= BETTER * before
    clear = "explained" if better else "cleared"
    noise = channel.get("noise")
    if (after if noise is None else noise) <= QUIET * rounding:
        return f"{clear}: nothing is left but rounding and the uncertain instants of samples"
    if after <= SMALL.get(channel["channel"], 0.0):
        return f"{clear}: what is left is too little to matter"
    if not diagnosis.unexplained:
        if channel["channel"] == "position":
            return f"{clear}: what is left is no more than noise and what two simulations differ by"
        told = "better" if better else "about as before" if diagnosis.causes else "no fault is seen"
        return f"{told}: nothing {'else ' if better else ''}that was tried makes it much smaller"
    if better or after <= SAME * before:
        return f"{'' if better else 'a little '}better, but more than rounding is left"
    untouched = ", and what was named does not touch it" if diagnosis.causes else ""
    return f"no better: more than rounding is left{untouched}"


def rejection(rejected: Mapping[str, Any]) -> tuple[str, str]:
    """A rejected name and why."""
    why = rejected.get("because")
    if why is None:
        rest = {k: v for k, v in rejected.items() if k not in ("effect", "scope", "joint")}
        why = ", ".join(f"{plain(k)} {_told(v)}" for k, v in rest.items())
    where = f" of {rejected['joint']}" if "joint" in rejected else ""
    return plain(str(rejected["effect"])) + where, str(why)


def _told(value: Any) -> str:
    return number(value) if isinstance(value, float) else plain(str(value))


def _settings(arguments: Mapping[str, Any]) -> list[str]:
    """Arguments of an experiment, nested ones too; what is left as it is has nothing to tell."""
    told = []
    for name, value in arguments.items():
        if isinstance(value, Mapping):
            told += _settings(value)
        elif name == "payload_kg" and value == 0.0:
            told.append("no weight")
        elif name == "payload_at_m" and value is not None:
            told.append(f"payload {number(1e3 * value)} mm from the axis")
        elif value is None or value in (0.0, "", []) or name == ALWAYS:
            continue
        elif name.endswith("_rad") and isinstance(value, float):
            told.append(f"{plain(name.removesuffix('_rad'))} {number(math.degrees(value))}°")
        elif (unit := SUFFIXES.get(name.rpartition("_")[2])) and isinstance(value, float):
            told.append(f"{plain(name.rpartition('_')[0] or 'at')} {number(value)} {unit}")
        else:
            listed = isinstance(value, list | tuple)
            shown = " ".join(map(_told, value)) if listed else _told(value)
            told.append(f"{plain(name)} {shown}")
    return told


def remains(unexplained: Mapping[str, Any]) -> str:
    """What is left unexplained, and where."""
    where = joined(phase(name) for name in unexplained.get("where", ()))
    share, size = unexplained.get("share"), unexplained.get("predictable_rad")
    told = in_few(unexplained.get("joints", ())) or "somewhere"
    if "rms_v" in unexplained:
        volts = float(unexplained["rms_v"])
        return (
            f"{told}: the voltage register is {volts:.2g} V off, and nothing that was tried is it"
        )
    if share is not None and share <= 0.0:
        told += ": what is left is more than noise, and the recordings do not agree about it"
    elif size is not None:
        told += f": {degrees(size)} of what is left could be foretold"
        told += f", {percent(share)} of its square" if share is not None else ""
    if where == EVERYWHERE:
        told += "; everywhere in the motion"
    else:
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
        rest = {k: v for k, v in each.arguments.items() if v != each.experiment}
        how = ", ".join(_settings(rest))
        told.append(
            plain(each.experiment)
            + (f", {what}" if (what := MOTIONS.get(each.experiment)) else "")
            + (f" ({how})" if how else "")
            + f": tells {joined(plain(s) for s in each.separates)} apart"
            + f" with a chance of {percent(each.power)}"
            + (NO_MORE if each.power < TELLS else "")
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
    if any("rms_v" in each for each in diagnosis.unexplained):
        told.append(
            "measure the voltage at the servos, and put it into supply_v of [condition] or into "
            "[supply] of the robot file"
        )
    if any("rms_v" not in each for each in diagnosis.unexplained):
        told.append(
            "read What is left in report.html: where it lives and what it goes with says what kind "
            "of physics it is, or which number of the robot file is farther off than its tolerance"
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
    if worse(diagnosis):
        told.append(
            "do not use {model} for motions like those held out; record more of their kind (gain, "
            "load, speed), so that some can be fitted as well, and diagnose again"
        )
    elif diagnosis.causes:
        told.append("use the better model: busemu serve --robot {model}")
    elif diagnosis.verdict == "consistent":
        told.append(
            "go on with this model; faster, slower or more loaded motions may still show more"
        )
    return told


def measured(channel: Mapping[str, Any], key: str) -> str:
    """A value of a channel's row, in the unit people know it by."""
    return in_its_unit(float(channel[key]), channel["channel"])


def in_its_unit(value: float, kind: str) -> str:
    """A deviation of a channel, in the unit people know it by."""
    if kind == "duty":
        return f"{number(100.0 * value, 2)} %"
    unit = UNITS.get(kind, "")
    return degrees(value) if unit == "rad" else quantity(value, unit)
