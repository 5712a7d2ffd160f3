"""What ``busemu diagnose`` prints: the verdict, its grounds, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .report import telling, words
from .result import DEAD, Cause, Diagnosis

COLOURS = {
    "consistent": "green",
    "explained": "green",
    "partly_explained": "yellow",
    "unexplained": "red",
}
PLACES = 3  #: of the mismatch that are named; the report has all


def show(diagnosis: Diagnosis, console: Console, written: Sequence[Path], model: Path) -> None:
    """Print a diagnosis; ``written`` are its files, ``model`` is the better model among them."""
    verdict = words.plain(diagnosis.verdict).upper()
    console.print(
        f"[bold {COLOURS[diagnosis.verdict]}]{verdict}[/]  {escape(telling.headline(diagnosis))}\n"
    )
    for caution in telling.cautions(diagnosis):
        console.print(f"[yellow]{escape(caution)}[/]\n", highlight=False)
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column()
    _rows(grid, "fit", [_fit(diagnosis)])
    _rows(grid, "where", telling.places(diagnosis)[:PLACES])
    for cause in diagnosis.causes:
        _rows(grid, "cause", _cause(cause))
    _rows(grid, "channels", [_channel(channel, diagnosis) for channel in diagnosis.channels])
    _rows(grid, "rejected", [": ".join(telling.rejection(r)) for r in diagnosis.rejected])
    _rows(grid, "left", [telling.remains(u) for u in diagnosis.unexplained])
    _rows(grid, "limits", diagnosis.limits)
    _rows(grid, "next", [line.replace("{model}", str(model)) for line in telling.advice(diagnosis)])
    _rows(grid, "files", [str(path) for path in written])
    console.print(grid, highlight=False)


def _rows(grid: Table, name: str, lines: Sequence[str]) -> None:
    for i, line in enumerate(lines):
        grid.add_row("" if i else name, escape(line))


def _fit(diagnosis: Diagnosis) -> str:
    fit = diagnosis.fit
    return (
        f"{words.degrees(fit.before)} before -> {words.degrees(fit.after)} after, floor "
        f"{words.degrees(fit.noise_floor)}, on {telling.judged_on(diagnosis)}"
    )


def _cause(cause: Cause) -> list[str]:
    how = "a wrong value" if cause.kind == "wrong_value" else "missing physics"
    lines = [
        f"{telling.named(cause)}: {words.meaning(cause.effect)}; {how}",
        f"  probability {words.percent(cause.probability)}, {telling.explains(cause)}, "
        f"held-out gain {words.nats(cause.held_out_gain_nats)}",
    ]
    for name, estimate in cause.parameters.items():
        if estimate.state == DEAD:
            lines.append(f"  {name}: {telling.UNSEEN}")
            continue
        lines.append(
            f"  {name} = {words.quantity(estimate.value, estimate.unit)}, 95 % "
            f"{telling.interval(estimate)}; {estimate.state}"
        )
    rivals = [
        f"{words.plain(r.effect)} ({words.percent(r.probability)})"
        for r in cause.indistinguishable_from
    ]
    if rivals:
        lines.append(f"  it could also be {words.joined(rivals, 'or')}")
    return lines


def _channel(channel: Mapping[str, Any], diagnosis: Diagnosis) -> str:
    name = words.PATHS.get(channel["channel"], channel["channel"])
    before, after = (telling.measured(channel, key) for key in ("rms_before", "rms_after"))
    return f"{name}: {before} -> {after}; {telling.channel_finding(channel, diagnosis)}"
