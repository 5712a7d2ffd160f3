"""Oddities of resolution: steps coarser than the register's, values that are held."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..rules import READ
from .channel import Channel, Floats, at
from .oddity import Oddity, Weight

#: values needed to tell a common step
VALUES = 6
#: a register that is renewed every so many reads, or more, is held; assumed
HELD_READS = 3.0
#: registers that are measured at their own pace
PACED = ("present_load", "present_current", "current", "present_speed", "present_velocity")


def check(series: Channel) -> Iterator[Oddity]:
    """Coarse steps and held values of one series of reads."""
    if series.op != READ or "/" in series.name or series.register is None:
        return
    counts = series.counts()
    counts = counts[~np.isnan(counts)]
    yield from _coarse(series, counts)
    yield from _held(series, counts)


def _coarse(series: Channel, counts: Floats) -> Iterator[Oddity]:
    register = series.register
    values = np.unique(np.abs(counts)).astype(np.int64)
    if register is None or len(values) < VALUES:
        return
    step = int(np.gcd.reduce(np.diff(values)))
    if step < 2:
        return
    in_si = f"{step * register.si_scale:.4g} {register.si_unit}".rstrip()
    yield Oddity(
        "coarse_steps",
        Weight.NOTE,
        f"values come in steps of {step} counts ({in_si}), the register's step is 1",
        "the servo measures more coarsely than the register suggests: the noise floor is higher",
        f"reckon with a quantisation of {step} counts",
        series.servo_id,
        series.name,
        count=len(counts),
    )


def _held(series: Channel, counts: Floats) -> Iterator[Oddity]:
    """Runs of one value of nearly equal length while it changes: renewed at a pace of its own."""
    if series.name not in PACED or len(counts) < 60:
        return
    ends = np.flatnonzero(np.diff(counts) != 0.0)
    if len(ends) < 20:
        return
    runs = np.diff(ends).astype(float)
    low, middle, high = np.percentile(runs, [25.0, 50.0, 75.0])
    if middle < HELD_READS or high - low > 0.25 * middle:
        return
    yield at(
        series,
        ends,
        "held",
        Weight.WARNING,
        f"renewed every {middle * series.period_s * 1e3:.0f} ms only, read every "
        f"{series.period_s * 1e3:.1f} ms",
        "most reads repeat an old value: it lags, and the repeats are no information",
        "keep the first of each run, or model the register as held",
    )
