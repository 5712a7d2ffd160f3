"""What a timed bus leaves behind: a table to read, CSV, a picture, a fitted profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from busemu.timing import Profile

from .calibration import CLOCK_S, INTERRUPT, Fit
from .figures.style import save
from .figures.tables import aligned
from .figures.timing import TimingRow, timing_figure
from .files import write_csv, write_text
from .probes import Kind, Timing

Floats = NDArray[np.float64]
MS = 1e3
#: A typical spread beyond this share of the median is worth a warning. Assumed: on an idle machine
#: it is a few percent.
UNSTEADY = 0.25
COLUMNS = (
    "transaction", "kind", "servos", "data_bytes", "baud_rate", "return_delay_time", "repeats",
    "median_s", "p5_s", "p95_s", "modelled_s",
)  # fmt: skip


def timing_table(timings: Sequence[Timing], modelled_s: Floats | None, model: str) -> str:
    """The distributions as aligned text, [ms]; ``modelled_s`` has shape (timings,)."""
    several = len({timing.condition for timing in timings}) > 1
    columns = ["transaction", "median [ms]", "5 % - 95 % [ms]"]
    columns[1:1] = ["return delay"] if several else []
    columns += [] if modelled_s is None else [f"{model} [ms]", "differs by"]
    rows = []
    for index, timing in enumerate(timings):
        low, high = (value * MS for value in timing.span_s)
        row = [timing.probe.what, f"{timing.median_s * MS:.3f}", f"{low:.3f} - {high:.3f}"]
        row[1:1] = [timing.condition.return_delay] if several else []
        if modelled_s is not None:
            off = float(modelled_s[index]) / timing.median_s - 1.0 if timing.median_s else 0.0
            row += [f"{modelled_s[index] * MS:.3f}", f"{off * 100 + 0.0:+.1f} %"]
        rows.append(row)
    return aligned(columns, rows)


def write_report(
    folder: Path, robot: Robot, timings: Sequence[Timing], modelled_s: Floats | None
) -> list[Path]:
    """Write ``timing.csv``, ``times.csv`` (every single one) and ``timing.png`` into ``folder``.

    Raises ``OSError`` if it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    modelled = [None] * len(timings) if modelled_s is None else [float(s) for s in modelled_s]
    summary, single, picture = (folder / n for n in ("timing.csv", "times.csv", "timing.png"))
    summaries: list[list[object]] = [
        [
            *_key(timing),
            len(timing.times_s),
            *(f"{value:.9f}" for value in (timing.median_s, *timing.span_s)),
            "" if model_s is None else f"{model_s:.9f}",
        ]
        for timing, model_s in zip(timings, modelled, strict=True)
    ]
    singles: list[list[object]] = [
        [*_key(timing), repeat, f"{time_s:.9f}"]
        for timing in timings
        for repeat, time_s in enumerate(timing.times_s)
    ]
    write_csv(summary, COLUMNS, summaries)
    write_csv(single, (*COLUMNS[:6], "repeat", "time_s"), singles)
    several = len({timing.condition for timing in timings}) > 1
    rows = [
        TimingRow(
            timing.probe.what
            + (f" (return delay {timing.condition.return_delay})" if several else ""),
            timing.times_s,
            model_s,
        )
        for timing, model_s in zip(timings, modelled, strict=True)
    ]
    save(timing_figure(rows, title=f"{robot.name}: time a transaction takes"), picture)
    return [summary, single, picture]


def _key(timing: Timing) -> list[object]:
    probe, condition = timing.probe, timing.condition
    return [
        probe.what, probe.kind.name.lower(), probe.servos, probe.data_bytes,
        condition.baud_rate, condition.return_delay,
    ]  # fmt: skip


def cycle_lines(timings: Sequence[Timing]) -> list[str]:
    """The robot's control cycle, a line a condition."""
    return [
        f"return delay {timing.condition.return_delay}: {timing.probe.what}: "
        f"median {timing.median_s * MS:.2f} ms, at most {1.0 / timing.median_s:.0f} a second"
        for timing in timings
        if timing.probe.kind is Kind.CYCLE
    ]


def unsteady(timings: Sequence[Timing]) -> str | None:
    """A warning if the times of most transactions spread so far that a fit says little."""
    spreads = [(t.span_s[1] - t.span_s[0]) / max(t.median_s, CLOCK_S) for t in timings]
    typical = float(np.median(spreads))
    if typical <= UNSTEADY:
        return None
    return (
        f"warning: times spread by {typical * 100:.0f} % of their median (5 % - 95 %, typically): "
        "the host was busy; time it again with nothing else running before you trust a fit"
    )


def describe_fit(fit: Fit) -> list[str]:
    """What is known about a fit, a line a fact."""
    lines = ["determined by the data:"]
    lines += [f"  {part}" for part in fit.determined]
    if fit.sums:
        lines += ["determined only as sums (how they divide is not in the data):"]
        lines += [f"  {total}" for total in fit.sums]
    unseen = [part for part in fit.unseen if part != "latency_timer_s"]
    if fit.profile.latency_timer_s == 0.0:
        lines.append("no latency timer: without one the model fits better than with any")
    if unseen:
        lines.append(f"not in the data at all: {', '.join(unseen)}")
    lines.append(f"worst of what was fitted: {_worst(fit, held_back=False)}")
    lines.append(f"worst of what was held back: {_worst(fit, held_back=True)}")
    return lines


def _worst(fit: Fit, *, held_back: bool) -> str:
    worst = fit.worst(held_back=held_back)
    if worst is None:
        return "nothing"
    timing = fit.timings[worst]
    error = float(fit.errors[worst])
    return f"{error * 100:+z.1f} % ({error * timing.median_s * 1e6:+z.0f} us): {timing.probe.what}"


def write_profile(fit: Fit, path: Path) -> None:
    """Write the fitted profile as a file for ``--timing``. Raises ``OSError``."""
    default = Profile(name=path.stem)
    lines = [f"# {line}" for line in describe_fit(fit)]
    lines += [f'source = "{_escaped(fit.profile.source)}"']
    notes = _notes(fit)
    for field in fields(Profile):
        value = getattr(fit.profile, field.name)
        if field.name in ("name", "source") or value == getattr(default, field.name):
            continue
        shown = f"{value:.9g}" if isinstance(value, float) else f"{value}"
        note = notes.get(field.name, "")
        lines.append(f"{field.name} = {shown}" + (f"  # {note}" if note else ""))
    write_text(path, "\n".join(lines) + "\n")


def _notes(fit: Fit) -> dict[str, str]:
    """A remark on each key of the profile that needs one."""
    notes = {"chunk_bytes": "assumed: an FTDI adapter at full speed"}
    notes |= {part.terms[0][1]: "fitted" for part in fit.determined}
    for total in fit.sums:
        words = str(total).partition(" = ")[0]
        notes |= {part: f"fitted as {words}" for _, part in total.terms}
    notes |= dict.fromkeys(fit.unseen, "assumed: not in the data")
    if INTERRUPT in notes:
        notes["interrupt_busy_s"] = f"{notes.pop(INTERRUPT)}; only its mean wait counts"
        notes["interrupt_period_s"] = "assumed: the AX-12's"
    return notes


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')
