"""Oddities of time: gaps, clocks that jump, uneven sampling, logs that are too short."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from busemu.wording import amount

from ..recording import Recording
from ..rules import READ
from .channel import Channel, channel, channels
from .counting import SERIES_INTERVALS, Gap, gaps
from .oddity import Oddity, Weight, first_rows

#: shortest log that tells how a joint moves [s]; assumed: a few settling times of a servo
SHORT_S = 0.5
#: samples of one register below which nothing can be estimated; assumed
FEW_SAMPLES = 30
#: sampling is uneven if the middle nine tenths of the intervals spread by this share of the median
UNEVEN = 0.5
#: a gap this many periods long may be a jump of the clock
JUMP_PERIODS = 20.0
#: a joint that moves at least this many counts a sample shows whether time has passed
MOVING_COUNTS = 2.0


def check(recording: Recording) -> Iterator[Oddity]:
    """All that is odd about a recording's times. Writes may pause, reads may not."""
    if not len(recording):
        yield Oddity(
            "empty",
            Weight.SERIOUS,
            "no rows at all",
            "there is nothing to look at",
            "record again; did the program reach the bus?",
        )
        return
    yield from _short(recording)
    silences = _apart(gaps(recording, READ))
    jumps = list(_jumps(recording, silences))
    yield from jumps
    starts = [jump.t_start_s for jump in jumps]
    left = [gap for gap in silences if gap.t_start_s not in starts]
    if left:
        longest = left[0]
        yield Oddity(
            "gaps",
            Weight.WARNING,
            f"{amount(len(left), 'gap')}; the longest {longest.length_s:.3f} s, in "
            f"{longest.series} series",
            "a filter or a derivative across a gap invents motion",
            "split there, or leave the span out; look for what kept the host busy",
            t_start_s=longest.t_start_s,
            t_end_s=longest.t_end_s,
            count=len(left),
        )
    yield from _uneven(recording)


def _apart(silences: tuple[Gap, ...]) -> tuple[Gap, ...]:
    """Gaps that overlap as one: the longest, with all their series; longest first."""
    found: list[Gap] = []
    for gap in silences:
        for place, other in enumerate(found):
            if gap.t_start_s < other.t_end_s and other.t_start_s < gap.t_end_s:
                found[place] = other._replace(series=other.series + gap.series)
                break
        else:
            found.append(gap)
    return tuple(found)


def _short(recording: Recording) -> Iterator[Oddity]:
    most = max(
        (len(rows) for (_, _, op), rows in recording.by_series.items() if op == READ), default=0
    )
    if recording.duration_s < SHORT_S or most < FEW_SAMPLES:
        yield Oddity(
            "too_short",
            Weight.WARNING,
            f"{recording.duration_s:.3f} s with at most {most} samples of a register",
            "less than a few settling times: parameters cannot be told from chance",
            "record some seconds of motion",
        )


def _jumps(recording: Recording, silences: tuple[Gap, ...]) -> Iterator[Oddity]:
    """Gaps across which a moving joint moved as if no time had passed."""
    told: set[Gap] = set()
    for series in channels(recording):
        if series.op != READ or series.name != "present_position" or not silences:
            continue
        counts, period_s = series.counts(), series.period_s
        for gap in silences:
            if gap.length_s < JUMP_PERIODS * period_s or gap in told:
                continue
            middle_s = 0.5 * (gap.t_start_s + gap.t_end_s)
            i = int(np.searchsorted(series.t_s, middle_s)) - 1
            if i < 4 or i + 5 >= len(counts):
                continue
            if series.t_s[i + 1] - series.t_s[i] < 0.5 * gap.length_s:
                continue  # other registers paused, the joint was read on
            before, after = np.diff(counts[i - 4 : i + 1]), np.diff(counts[i + 1 : i + 6])
            speed = float(np.mean([np.median(before), np.median(after)]))
            steady = abs(np.median(before) - np.median(after)) < 0.5 * abs(speed)
            moved = float(counts[i + 1] - counts[i])
            if steady and abs(speed) >= MOVING_COUNTS and abs(moved - speed) < 2.0 * abs(speed):
                told.add(gap)
                yield Oddity(
                    "clock_jump",
                    Weight.SERIOUS,
                    f"the clock jumps by {gap.length_s:.3f} s: the joint goes on as if no time had "
                    "passed",
                    "rates, delays and everything after the jump are wrong",
                    "take the jump out of t_s, or split there; log a monotonic clock",
                    series.servo_id,
                    series.name,
                    gap.t_start_s,
                    gap.t_end_s,
                    first_rows(series.rows[i : i + 2]),
                    1,
                )


def _uneven(recording: Recording) -> Iterator[Oddity]:
    """Jitter and repeated times, told once for all servos of a register."""
    seen: set[tuple[str, str]] = set()
    for servo_id, name, op in sorted(recording.by_series):
        if op != READ or (name, op) in seen:
            continue
        seen.add((name, op))
        series = channel(recording, servo_id, name, op)
        if series is None or len(series.t_s) <= SERIES_INTERVALS:
            continue
        yield from _uneven_series(series)


def _uneven_series(series: Channel) -> Iterator[Oddity]:
    intervals = np.diff(series.t_s)
    low, middle, high = np.percentile(intervals, [5.0, 50.0, 95.0])
    repeated = np.flatnonzero(intervals == 0.0)
    if repeated.size > 0.01 * len(intervals):
        yield Oddity(
            "repeated_times",
            Weight.WARNING,
            f"{amount(repeated.size, 'sample')} that carry the time of the one before",
            "the clock is coarser than the sampling: velocities made of it are infinite or zero",
            "log a finer clock; here, spread the samples evenly within a tick",
            series.servo_id,
            series.name,
            float(series.t_s[repeated[0]]),
            rows=first_rows(series.rows[repeated + 1]),
            count=repeated.size,
        )
    elif middle > 0.0 and (high - low) > UNEVEN * middle:
        yield Oddity(
            "uneven_sampling",
            Weight.NOTE,
            f"intervals from {low * 1e3:.2f} to {high * 1e3:.2f} ms (5 and 95 %), median "
            f"{middle * 1e3:.2f} ms",
            "samples are not equally far apart: no plain Fourier transform, no fixed-step filter",
            "use each sample's own time",
            series.servo_id,
            series.name,
            count=len(intervals),
        )
