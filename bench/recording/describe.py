"""A recording in a few lines of text, for a person who asks what is in the file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import groupby

import numpy as np

from bench.figures.tables import aligned
from busemu.wording import amount

from .oddities import Oddities, SeriesCount, counted, oddities
from .recording import Recording

#: gaps listed one by one
GAPS_SHOWN = 5


def describe(recording: Recording) -> str:
    """Tell what a recording holds: rows, duration, servos, rates, lost replies, largest gaps."""
    odd = _odd(oddities(recording), counted(recording), recording)
    return "\n".join([facts(recording), "", *odd])


def facts(recording: Recording) -> str:
    """Tell what a recording holds, without a word of what is odd about it."""
    told = recording.metadata
    lines = [
        f"{recording.name}: {told.get('robot', 'unnamed robot')}, "
        f"source {told.get('source', 'not stated')}"
        + (f", group {told['group']}" if "group" in told else ""),
        f"{amount(len(recording), 'row')} in {recording.duration_s:.3f} s",
    ]
    if isinstance(condition := told.get("condition"), Mapping) and condition:
        lines.append("condition: " + ", ".join(f"{k} = {v}" for k, v in condition.items()))
    lines += [_servos(recording), "", _rates(counted(recording))]
    return "\n".join(lines)


def id_ranges(servo_ids: Iterable[int]) -> str:
    """Write ascending IDs as people do: ``1-6, 9``."""
    runs = groupby(enumerate(servo_ids), key=lambda pair: pair[1] - pair[0])
    ends = [[servo_id for _, servo_id in run] for _, run in runs]
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in ends)


def _servos(recording: Recording) -> str:
    models: dict[str, list[int]] = {}
    for servo_id in recording.servo_ids:
        model = recording.models.get(servo_id)
        models.setdefault("model not known" if model is None else model.model, []).append(servo_id)
    texts = [f"{id_ranges(ids)} ({model})" for model, ids in models.items()]
    return "servos: " + ("; ".join(texts) or "none")


def _rates(series: tuple[SeriesCount, ...]) -> str:
    rows = []
    for (register, op), same in groupby(series, key=lambda s: (s.register, s.op)):
        group = list(same)
        period_s = np.array([s.period_s for s in group])
        period_s = period_s[period_s > 0.0]
        rows.append(
            (
                register,
                "observed" if "/" in register else op,
                "" if "/" in register else id_ranges(s.servo_id for s in group),
                str(sum(s.rows for s in group)),
                f"{1.0 / np.median(period_s):.1f}" if period_s.size else "-",
                str(sum(s.lost for s in group)),
            )
        )
    return aligned(("register", "", "servos", "rows", "rate [Hz]", "lost"), rows)


def _odd(odd: Oddities, series: tuple[SeriesCount, ...], recording: Recording) -> list[str]:
    reads = sum(s.rows for s in series if s.op == "read" and "/" not in s.register)
    share = f" of {reads} ({odd.lost_replies / reads:.2%})" if reads else ""
    lines = [f"lost replies: {odd.lost_replies}{share}", f"gaps: {len(odd.gaps)}"]
    start_s = recording.t_s[0] if len(recording) else 0.0
    lines += [
        f"  {gap.length_s:.3f} s from {gap.t_start_s - start_s:.3f} s on, in {gap.series} series"
        for gap in odd.gaps[:GAPS_SHOWN]
    ]
    for count, what in (
        (odd.out_of_range, "values outside the range of their register's table"),
        (odd.read_only_written, "writes to read-only registers"),
        (odd.reply_before_instruction, "replies dated before their instruction"),
        (odd.unchecked, "rows of servos of unknown model: their registers were not checked"),
    ):
        if count:
            lines.append(f"note: {count} {what}")
    return lines
