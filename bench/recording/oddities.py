"""What a recording may have and is accepted with, but has to be counted and shown."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .columns import numbers, servo_ids, texts
from .recording import Recording
from .rules import READ, WRITE

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
    """Counts of what was accepted, in rows; ``gaps`` longest first."""

    lost_replies: int  #: reads of a servo without an answer
    gaps: tuple[Gap, ...]
    out_of_range: int  #: values in the register's bytes, but outside the range its table gives
    read_only_written: int  #: writes to a register that only the servo changes
    reply_before_instruction: int  #: ``t_reply_s`` earlier than ``t_s``: two clocks, or a bad log
    unchecked: int  #: accesses of servos whose model is not known


def counted(recording: Recording) -> tuple[SeriesCount, ...]:
    """Count every series of a recording; sorted by register, operation, servo."""
    table = recording.table
    order, spans = _grouped(recording)
    times, raw = numbers(table, "t_s")[order], numbers(table, "raw")[order]
    servo, (op, ops) = servo_ids(table)[order], texts(table, "op")
    register, registers = texts(table, "register")
    found = []
    for start, end in spans:
        row = order[start]
        gaps = np.diff(times[start:end])
        found.append(
            SeriesCount(
                servo_id=int(servo[start]),
                register=registers[int(register[row])],
                op=ops[int(op[row])],
                rows=int(end - start),
                lost=int(np.isnan(raw[start:end]).sum()),
                period_s=float(np.median(gaps)) if gaps.size else float("nan"),
            )
        )
    return tuple(sorted(found, key=lambda s: (s.register, s.op, s.servo_id)))


def oddities(recording: Recording) -> Oddities:
    """Count what a recording was accepted with."""
    table = recording.table
    raw, servo = numbers(table, "raw"), servo_ids(table)
    (op, ops), (register, registers) = texts(table, "op"), texts(table, "register")
    bus = recording.on_bus
    read, write = (np.isin(op, [i for i, o in enumerate(ops) if o == o_]) for o_ in (READ, WRITE))
    outside = read_only = 0
    unchecked = bus.copy()
    for servo_id, model in recording.models.items():
        mine = bus & (servo == servo_id)
        unchecked &= ~mine
        for code, name in enumerate(registers):
            if name not in model or not (rows := mine & (register == code)).any():
                continue
            if not model[name].writable:
                read_only += int((rows & write).sum())
            values, counts = np.unique(raw[rows & ~np.isnan(raw)], return_counts=True)
            described = model[name]
            for value, count in zip(values, counts, strict=True):
                if not described.minimum <= described.decode(int(value)) <= described.maximum:
                    outside += int(count)
    return Oddities(
        lost_replies=int((np.isnan(raw) & read & bus).sum()),
        gaps=gaps(recording),
        out_of_range=outside,
        read_only_written=read_only,
        reply_before_instruction=int((numbers(table, "t_reply_s") < recording.t_s).sum()),
        unchecked=int(unchecked.sum()),
    )


def gaps(recording: Recording) -> tuple[Gap, ...]:
    """Find gaps: intervals over three times the median of their own series; longest first.

    Series of fewer than ten intervals have no rate and no gaps. A lost reply is no gap: the access
    was made.
    """
    order, spans = _grouped(recording)
    times = recording.t_s[order]
    found: list[NDArray[np.float64]] = []
    for start, end in spans:
        mine = times[start:end]
        intervals = np.diff(mine)
        if intervals.size >= SERIES_INTERVALS and (period := np.median(intervals)) > 0.0:
            wide = np.flatnonzero(intervals > GAP_RATIO * period)
            found.append(np.column_stack([mine[wide], mine[wide + 1]]))
    if not found:
        return ()
    silences, counts = np.unique(np.concatenate(found), axis=0, return_counts=True)
    every = [Gap(float(a), float(b), int(n)) for (a, b), n in zip(silences, counts, strict=True)]
    return tuple(sorted(every, key=lambda gap: -gap.length_s))


def _grouped(recording: Recording) -> tuple[NDArray[np.intp], list[tuple[int, int]]]:
    """Order the rows by series, then by time; also give where every series starts and ends."""
    table = recording.table
    (op, ops), (register, registers) = texts(table, "op"), texts(table, "register")
    key = servo_ids(table).astype(np.int64) * len(registers) + register
    key = key * len(ops) + op
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1)).tolist()
    return order, list(pairwise([*starts, len(order)]))
