"""What ``busemu inspect`` shows: tables at the terminal, pictures in a folder."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bench.figures.recording import interval_figure, motion_figure, power_figure
from bench.figures.style import save
from bench.recording import Oddity, Recording, Weight, oddities
from bench.recording.describe import facts, id_ranges

STYLES = {Weight.SERIOUS: "bold red", Weight.WARNING: "yellow", Weight.NOTE: "dim"}
WORDS = {Weight.SERIOUS: "serious", Weight.WARNING: "warning", Weight.NOTE: "note"}


def report(recording: Recording, console: Console) -> None:
    """Print what is in a recording and what is odd about it."""
    console.print(escape(facts(recording)), highlight=False, soft_wrap=True)
    console.print()
    found = oddities(recording).found
    if not found:
        console.print("nothing odd was found")
        return
    table = Table(box=None, pad_edge=False, show_lines=False, padding=(0, 2, 1, 0))
    table.add_column("")
    table.add_column("what is odd, and where", ratio=5)
    table.add_column("why it matters, and what to do", ratio=5)
    start_s = float(recording.t_s[0]) if len(recording) else 0.0
    for same in merged(found):
        first = same[0]
        table.add_row(
            f"[{STYLES[first.weight]}]{WORDS[first.weight]}[/]",
            f"{escape(first.what)}\n[dim]{escape(_where(same, start_s))}[/]",
            f"{escape(first.why)}\n[bold]{escape(first.advice)}[/]",
        )
    console.print(table)
    console.print()


def merged(found: Iterable[Oddity]) -> list[list[Oddity]]:
    """Oddities that say the same of several servos or registers, together; order is kept."""
    groups: dict[tuple[str, str], list[Oddity]] = {}
    for oddity in found:
        groups.setdefault((oddity.kind, oddity.what), []).append(oddity)
    return list(groups.values())


def _where(same: Sequence[Oddity], start_s: float) -> str:
    if len(same) == 1:
        return same[0].where(start_s)
    ids = sorted({oddity.servo_id for oddity in same if oddity.servo_id is not None})
    registers = sorted({oddity.register for oddity in same if oddity.register is not None})
    named = ", ".join(registers[:4]) + (", ..." if len(registers) > 4 else "")
    return f"servo {id_ranges(ids)}: {named}"


@dataclass(slots=True)
class Overview:
    """Many recordings, a line each, and what is odd about all of them together."""

    rows: list[tuple[str, str, str, str]] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)
    worst: tuple[tuple[int, int], Path] | None = None  #: how odd the oddest is, and its file

    def add(self, recording: Recording, path: Path) -> None:
        """Take a recording, and the file that it was in, into account."""
        found = oddities(recording).found
        kinds = list(dict.fromkeys((o.weight, o.kind) for o in found if o.weight > Weight.NOTE))
        self.kinds.update({o.kind for o in found})
        if found:
            heaviest = max(o.weight for o in found)
            odd = (int(heaviest), len(kinds))
            if self.worst is None or odd > self.worst[0]:
                self.worst = odd, path
        words = ", ".join(f"[{STYLES[weight]}]{kind}[/]" for weight, kind in kinds)
        self.rows.append(
            (escape(recording.name), str(len(recording)), f"{recording.duration_s:.2f}", words)
        )

    def show(self, console: Console) -> None:
        """Print the table."""
        table = Table(box=None, pad_edge=False)
        for name, right in (("recording", False), ("rows", True), ("s", True), ("odd", False)):
            table.add_column(name, justify="right" if right else "left")
        for row in self.rows:
            table.add_row(*row)
        console.print(table)
        told = ", ".join(f"{kind} in {count}" for kind, count in self.kinds.most_common())
        console.print(f"\n{len(self.rows)} recordings: {told or 'nothing odd'}", highlight=False)
        if self.worst is not None:
            told = (
                f"where, why it matters, and what to do: busemu inspect {quote(str(self.worst[1]))}"
            )
            console.print(told, highlight=False, markup=False, soft_wrap=True)


def write_pictures(recording: Recording, folder: Path) -> list[Path]:
    """Write ``NAME-motion.png``, ``-intervals.png`` and ``-measurements.png``; whole or not at all.

    Raises ``OSError``.
    """
    found = oddities(recording).found
    figures = {
        "motion": motion_figure(recording, found),
        "intervals": interval_figure(recording),
        "measurements": power_figure(recording),
    }
    written = []
    for what, figure in figures.items():
        if figure is None:
            continue
        place = folder / f"{recording.name.replace('/', '_')}-{what}.png"
        part = place.with_name(f".{place.stem}.{os.getpid()}.png")
        try:
            save(figure, part)
            part.replace(place)
        finally:
            part.unlink(missing_ok=True)
        written.append(place)
    return written
