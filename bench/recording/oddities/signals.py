"""Oddities of signals: single bad samples, stuck and saturated registers, mixed units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from busemu.wording import amount

from ..recording import Recording
from ..rules import READ, WRITE
from .channel import Channel, Floats, at, channel
from .oddity import Oddity, Weight

#: a bad sample stands out by this many times the usual change from sample to sample; assumed
GLITCH_RATIO = 12.0
#: and by at least this many counts; assumed
GLITCH_COUNTS = 12.0
#: and, in registers that may leap, by this much more than 99 % of all samples do; assumed
BEYOND = 1.5
#: speeds, currents and voltages leap in earnest: a bad one is off by this share; assumed
LEAP = 0.2
#: and samples on both sides of it are no farther apart [s]: a push comes and goes in that; assumed
PUSH_S = 0.1
#: a register at its end for this share of the samples is saturated; assumed
SATURATED = 0.005
#: counts that a position must span to be a motion; assumed: three times a potentiometer's noise
MOTION_COUNTS = 20.0
#: share of a range that one value must fill to be a failed read logged as a constant
CONSTANT_SHARE = 0.5
#: registers that change while a joint moves
LIVELY = ("present_load", "present_pwm", "present_current", "current", "present_speed",
          "present_velocity")  # fmt: skip


def check(series: Channel) -> Iterator[Oddity]:
    """Bad samples, saturation and stuck channels of one series of reads."""
    if series.op != READ or "/" in series.name or len(series.raw) < 5:
        return
    counts = series.counts()
    there = ~np.isnan(counts)
    if not there.any():
        return
    yield from _glitches(series, counts)
    yield from _saturated(series, counts)
    yield from _wraps(series, counts)


def check_goals(recording: Recording) -> Iterator[Oddity]:
    """What shows only where registers of one servo are held against each other."""
    moved = False
    for servo_id in recording.servo_ids:
        goal = channel(recording, servo_id, "goal_position", WRITE)
        position = channel(recording, servo_id, "present_position", READ)
        goal_span, position_span = _span(goal), _span(position)
        moved |= max(goal_span, position_span) >= MOTION_COUNTS or goal is None
        if position is not None and position_span == 0.0 and goal_span >= MOTION_COUNTS:
            yield at(
                position,
                np.arange(len(position.raw)),
                "stuck",
                Weight.SERIOUS,
                f"the position stays at {position.raw[0]:.0f} while goals span {goal_span:.0f} "
                "counts",
                "torque off, a blocked joint, or a read that returns a constant",
                "check torque_enable and the cable; leave the servo out of any fit",
            )
        elif goal is not None and position is not None:
            yield from _disagreement(goal, position, goal_span, position_span)
        if position_span >= MOTION_COUNTS:
            yield from _stuck(recording, servo_id)
    if recording.servo_ids and not moved:
        yield Oddity(
            "no_motion",
            Weight.NOTE,
            f"no joint's goal or position spans {MOTION_COUNTS:.0f} counts",
            "friction, inertia and delay leave no trace in a log at rest",
            "use it for offsets and noise only",
        )


def _glitches(series: Channel, counts: Floats) -> Iterator[Oddity]:
    """Runs of one or two samples that stand out from both sides, which agree with each other."""
    places = glitches(series, counts)
    if not places.size:
        return
    values, times = np.unique(counts[places], return_counts=True)
    often = int(np.argmax(times))
    same = times[often] >= 3 and times[often] >= CONSTANT_SHARE * places.size
    what = f"{amount(places.size, 'sample')} out of line with those before and after"
    if same:
        what += (
            f", {times[often]} of them exactly {values[often]:.0f}: failed reads, logged as that"
        )
    else:
        worst = places[int(np.argmax(np.abs(counts[places] - np.nanmedian(counts))))]
        what += f"; the worst {counts[worst]:.0f} (raw {series.raw[worst]:.0f})"
    yield at(
        series,
        places,
        "glitches",
        Weight.WARNING,
        what,
        "nothing in a servo changes and comes back like that: least squares follow such samples",
        "leave them out, or use a loss that bears outliers",
    )


def glitches(series: Channel, counts: Floats) -> NDArray[np.intp]:
    """Find samples (from 0) that a joint cannot have shown; lost replies are passed over."""
    there = np.flatnonzero(~np.isnan(counts))
    x = counts[there]
    if len(x) < 7:
        return np.empty(0, dtype=np.intp)
    turn = _turn(series)
    usual = _wrapped(np.diff(x), turn)
    noise = 1.4826 * float(np.median(np.abs(usual - np.median(usual))))
    spread = float(np.percentile(np.abs(usual), 90.0))
    step = _step(x) if series.name in LIVELY else 1.0
    limit = max(GLITCH_COUNTS * step, GLITCH_RATIO * noise, 3.0 * spread)
    if turn is None:  # registers that may leap stay within what they usually span
        limit = max(limit, BEYOND * float(np.percentile(np.abs(x - np.median(x)), 99.0)))
    if series.register is not None and series.name in LIVELY:
        limit = max(limit, LEAP * (series.register.maximum - series.register.minimum))
    if "voltage" in series.name:
        limit = max(limit, LEAP * float(np.median(x)))
    bad = np.zeros(len(x), dtype=bool)
    for width in (1, 2):
        before, after = x[: -width - 1], x[width + 1 :]
        level = before + 0.5 * _wrapped(after - before, turn)
        agree = np.abs(_wrapped(after - before, turn))
        for step in range(width):
            off = np.abs(_wrapped(x[1 + step : len(x) - width + step] - level, turn))
            here = (off > limit) & (agree < 0.34 * off)
            if series.name in LIVELY:
                here &= series.t_s[there[width + 1 :]] - series.t_s[there[: -width - 1]] < PUSH_S
            if width == 2:
                other = x[2 - step : len(x) - 1 - step]
                here &= np.abs(_wrapped(other - level, turn)) > limit
            bad[np.flatnonzero(here) + 1 + step] = True
    return there[bad]


def _saturated(series: Channel, counts: Floats) -> Iterator[Oddity]:
    register = series.register
    if register is None or register.name not in LIVELY or register.maximum <= 0:
        return
    top = np.abs(counts) >= register.maximum
    if register.encoding == "unsigned" or top.mean() < SATURATED or register.maximum > 5000:
        return
    places = np.flatnonzero(top)
    yield at(
        series,
        places,
        "saturated",
        Weight.WARNING,
        f"at its end ({register.maximum}) in {places.size} of {len(counts)} samples "
        f"({top.mean():.1%})",
        "the controller asks for more than there is: gains and delays do not show there, the "
        "motor's limits do",
        "keep these samples for motor and supply, leave them out for gains",
    )


def _wraps(series: Channel, counts: Floats) -> Iterator[Oddity]:
    turn = _turn(series)
    if turn is None or series.name != "present_position":
        return
    steps = np.diff(counts)
    places = np.flatnonzero(np.abs(steps) > 0.5 * turn)
    bad = glitches(series, counts)
    places = places[~np.isin(places, bad) & ~np.isin(places + 1, bad)]
    if places.size:
        yield at(
            series,
            places,
            "wraps",
            Weight.NOTE,
            f"the position passes the end of its turn {amount(places.size, 'time')}",
            "differences across the end are a turn off",
            "unwrap before taking differences",
        )


def _stuck(recording: Recording, servo_id: int) -> Iterator[Oddity]:
    for name in LIVELY:
        series = channel(recording, servo_id, name, READ)
        if series is None or len(series.raw) < 30 or _span(series) > 0.0:
            continue
        yield at(
            series,
            np.arange(len(series.raw)),
            "stuck",
            Weight.WARNING,
            f"always {series.raw[0]:.0f} while the joint moves",
            "the register is not measured by this servo, or not read",
            "leave the channel out",
        )


def _disagreement(
    goal: Channel, position: Channel, goal_span: float, position_span: float
) -> Iterator[Oddity]:
    """Units and signs that differ between goals and positions."""
    if min(goal_span, position_span) < 3.0 or max(goal_span, position_span) < MOTION_COUNTS:
        return
    goals, positions = goal.counts(), position.counts()
    held = np.searchsorted(goal.t_s, position.t_s, side="right") - 1
    valid = (held >= 0) & ~np.isnan(positions)
    x, y = goals[np.maximum(held, 0)][valid], positions[valid]
    if len(x) < 30 or not np.ptp(x):
        return
    slope = float(np.polyfit(x - x.mean(), y - y.mean(), 1)[0])
    alike = abs(float(np.corrcoef(x, y)[0, 1])) if np.ptp(y) else 0.0
    if alike < 0.8:
        return
    for factor, what in (
        (-1.0, "positions run against the goals: a sign is exchanged"),
        (180.0 / np.pi, "positions are 57 times the goals: degrees taken for radians"),
        (np.pi / 180.0, "positions are a 57th of the goals: radians taken for degrees"),
    ):
        if abs(slope / factor - 1.0) < 0.3:
            yield at(
                position,
                np.flatnonzero(valid),
                "unit_mix_up",
                Weight.SERIOUS,
                what,
                "gains, delays and everything else follow this factor",
                "correct the unit or sign of one of the two columns",
            )


def _turn(series: Channel) -> float | None:
    """Counts of a turn, for the position of an encoder that has no ends."""
    register = series.register
    if register is None or series.name != "present_position" or register.unit != "deg":
        return None
    turn = round(360.0 / register.scale)
    return float(turn) if turn == 4096 else None


def _step(counts: Floats) -> float:
    """The step in which values come, in counts."""
    values = np.unique(np.abs(counts)).astype(np.int64)
    return float(max(1, np.gcd.reduce(np.diff(values)))) if len(values) > 1 else 1.0


def _wrapped(steps: Floats, turn: float | None) -> Floats:
    if turn is None:
        return steps
    found: Floats = steps - turn * np.round(steps / turn)
    return found


def _span(series: Channel | None) -> float:
    if series is None or np.isnan(series.raw).all():
        return 0.0
    return float(np.nanmax(series.counts()) - np.nanmin(series.counts()))
