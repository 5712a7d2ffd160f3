"""What a recording may have and is accepted with, but has to be counted and shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Register

from ..columns import numbers
from ..recording import Recording
from ..rules import WRITE
from .oddity import Oddity

#: a series has a rate if it has this many intervals; fewer tell no gap from a pause
SERIES_INTERVALS = 10
#: an interval this many times the series' median is a gap
GAP_RATIO = 3.0


class Gap(NamedTuple):
    """A time in which accesses that came at a regular rate did not come.

    ``series`` counts how many (servo, register, operation) were silent from ``t_start_s`` to
    ``t_end_s``, the host's times of the access before and the one after.
    """

    t_start_s: float
    t_end_s: float
    series: int

    @property
    def length_s(self) -> float:
        """How long it lasted [s]."""
        return self.t_end_s - self.t_start_s


@dataclass(frozen=True, slots=True)
class SeriesCount:
    """One register of one servo, read or written: how often, and how many replies were lost."""

    servo_id: int
    register: str
    op: str
    rows: int
    lost: int
    period_s: float  #: median time between accesses [s]; NaN for a single one


@dataclass(frozen=True, slots=True)
class Oddities:
    """Counts of what was accepted, in rows; ``gaps`` longest first, ``found`` gravest first."""

    lost_replies: int  #: reads of a servo without an answer
    gaps: tuple[Gap, ...]
    out_of_range: int  #: values in the register's bytes, but outside the range its table gives
    read_only_written: int  #: writes to a register that only the servo changes
    reply_before_instruction: int  #: ``t_reply_s`` earlier than ``t_s``: two clocks, or a bad log
    unchecked: int  #: accesses of servos whose model is not known
    found: tuple[Oddity, ...] = ()  #: each with its place, why it matters and what to do


def counted(recording: Recording) -> tuple[SeriesCount, ...]:
    """Count every series of a recording; sorted by register, operation, servo."""
    times, raw = recording.t_s, numbers(recording.table, "raw")
    found = []
    for (servo_id, register, op), rows in recording.by_series.items():
        intervals = np.diff(times[rows])
        found.append(
            SeriesCount(
                servo_id=servo_id,
                register=register,
                op=op,
                rows=len(rows),
                lost=int(np.isnan(raw[rows]).sum()),
                period_s=float(np.median(intervals)) if intervals.size else float("nan"),
            )
        )
    return tuple(sorted(found, key=lambda s: (s.register, s.op, s.servo_id)))


def count_accesses(recording: Recording) -> Oddities:
    """Count what a recording was accepted with; ``found`` stays empty."""
    raw = numbers(recording.table, "raw")
    lost = outside = read_only = unchecked = 0
    for (servo_id, name, op), rows in recording.by_series.items():
        if "/" in name:
            continue
        values = raw[rows]
        there = ~np.isnan(values)
        lost += int((~there).sum())
        model = recording.models.get(servo_id)
        if model is None:
            unchecked += len(rows)
            continue
        outside += _out_of_range(values[there], model[name])
        if op == WRITE and not model[name].writable:
            read_only += len(rows)
    return Oddities(
        lost_replies=lost,
        gaps=gaps(recording),
        out_of_range=outside,
        read_only_written=read_only,
        reply_before_instruction=int((numbers(recording.table, "t_reply_s") < recording.t_s).sum()),
        unchecked=unchecked,
    )


def gaps(recording: Recording, op: str | None = None) -> tuple[Gap, ...]:
    """Find gaps: intervals over three times the median of their own series; longest first.

    Series of fewer than ten intervals have no rate and no gaps. A lost reply is no gap: the access
    was made. ``op``: look at reads or at writes only.
    """
    times = recording.t_s
    found: list[NDArray[np.float64]] = []
    for (_, _, access), rows in recording.by_series.items():
        if op not in (None, access):
            continue
        mine = times[rows]
        intervals = np.diff(mine)
        if intervals.size >= SERIES_INTERVALS and (period := np.median(intervals)) > 0.0:
            wide = np.flatnonzero(intervals > GAP_RATIO * period)
            found.append(np.column_stack([mine[wide], mine[wide + 1]]))
    if not found:
        return ()
    silences, counts = np.unique(np.concatenate(found), axis=0, return_counts=True)
    every = [Gap(float(a), float(b), int(n)) for (a, b), n in zip(silences, counts, strict=True)]
    return tuple(sorted(every, key=lambda gap: -gap.length_s))


def _out_of_range(raw: NDArray[np.float64], register: Register) -> int:
    """Count values that the table does not allow, though the bytes could hold them."""
    values, counts = np.unique(raw, return_counts=True)
    return sum(
        int(count)
        for value, count in zip(values, counts, strict=True)
        if not register.minimum <= register.decode(int(value)) <= register.maximum
    )
