"""What `busemu decode` does: find out what its input is, explain it, print it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from itertools import chain
from pathlib import Path

from rich.console import Console
from rich.text import Text

from ..wording import amount
from .explain import Explainer, Explanation, Line, Tables, brief, long
from .explain.text import STYLES
from .follow import read_lines, read_trace
from .hextext import HexError, bytes_of_input, bytes_of_text
from .traceline import START, Dropped, Entry, Header, Record, is_trace

#: What stands above the packets of a trace; the columns are those of `_lead`.
COLUMNS = "time of day       pause ms  late ms"


class Shown:
    """Prints lines, in colours on a terminal; counts packets."""

    def __init__(self, only_bad: bool) -> None:
        self.packets = self.bad = 0
        self._only_bad = only_bad
        self._console = Console(highlight=False) if sys.stdout.isatty() else None

    def packet(self, explanation: Explanation, lines: Iterable[Line]) -> None:
        """Show a packet, or a fault that struck, if it is to be shown."""
        fault = explanation.kind == "fault"
        self.packets += not fault
        self.bad += explanation.bad
        if explanation.bad or fault or not self._only_bad:
            self.lines(lines)

    def lines(self, lines: Iterable[Line]) -> None:
        """Show lines that are no packet."""
        for line in lines:
            if self._console is None:
                sys.stdout.write("".join(piece for piece, _ in line).rstrip() + "\n")
            else:
                text = Text.assemble(*((piece, STYLES[style]) for piece, style in line))
                self._console.print(text, soft_wrap=True)


def decode_trace(
    entries: Iterable[Entry | None],
    tables_of: Callable[[Header], Tables],
    shown: Shown,
    short: bool,
) -> None:
    """Explain the entries of a trace, packet by packet, each with its times.

    `tables_of` gives the control tables of the robot that a header names; `short` is one line a
    packet.
    """
    header, explainer, before_s = Header(), Explainer(), None
    dropped = damaged = 0
    for entry in entries:
        if isinstance(entry, Header):
            if entry != header:
                header, before_s = entry, None
                explainer = Explainer(header.protocol, tables_of(header))
                shown.lines([((_title(header), "title"),), ((COLUMNS, "note"),)])
        elif isinstance(entry, Record):
            lead = _lead(entry, header, before_s)
            before_s = entry.event.end_s
            event = entry.event
            for explanation in explainer.explain(event.data, event.kind, event.words):
                lines = brief(explanation, lead)
                if not short:
                    lines = iter([((lead, "note"),), *long(explanation)])
                shown.packet(explanation, lines)
        elif isinstance(entry, Dropped):
            dropped += entry.count
        else:
            damaged += 1
    end = f"{amount(shown.packets, 'packet')}, {shown.bad} bad"
    end += f", {dropped} not in the trace: the server was too busy" if dropped else ""
    end += f", {amount(damaged, 'damaged line')} passed over" if damaged else ""
    shown.lines([((end, "title"),)])


def _title(header: Header) -> str:
    day = datetime.fromtimestamp(header.wall_s).isoformat(" ", "seconds")
    return (
        f"{header.robot}, Protocol {header.protocol}, {header.baud_rate} bit/s, timing "
        f"{header.timing}; the server began on {day}"
    )


def _lead(record: Record, header: Header, before_s: float | None) -> str:
    """Time of day, pause since the packet before, measured after modelled time [ms]."""
    event = record.event
    at = datetime.fromtimestamp(header.wall_s + event.start_s - header.clock_s)
    pause = "" if before_s is None else f"{(event.start_s - before_s) * 1e3:+.3f}"
    late_s = None
    if record.read_s is not None:
        late_s = record.read_s - event.start_s
    elif record.handed_s is not None:
        late_s = record.handed_s - event.end_s
    late = "" if late_s is None else f"{late_s * 1e3:+.3f}"
    return f"{at:%H:%M:%S.%f} {pause:>10} {late:>8} "


def sources(words: list[str]) -> Iterator[bytes | Iterator[Entry | None]]:
    """What the arguments mean: bytes, or the entries of a trace.

    They are bytes in hex or files; none, or `-`, is standard input. Raises :class:`HexError`,
    :class:`TraceError` and OSError.
    """
    if not words or words == ["-"]:
        data = sys.stdin.buffer.read()
        yield read_lines(data.splitlines(keepends=True)) if is_trace(data) else _content(data, "-")
    elif any(word and Path(word).exists() for word in words):
        paths = [Path(word) for word in words]
        if all(map(_is_trace, paths)):
            yield chain.from_iterable(map(read_trace, paths))
            return
        for path in paths:
            yield _content(path.read_bytes(), str(path))
    else:
        try:
            data = bytes_of_text(" ".join(words))
        except HexError as error:
            if len(words) > 1:
                raise
            raise HexError(f"{error}; and there is no file of that name") from None
        yield _content(data, "arguments")


def _is_trace(path: Path) -> bool:
    with path.open("rb") as file:
        return is_trace(file.read(len(START)))


def _content(data: bytes, name: str) -> bytes:
    if not data:
        raise HexError(f"{'standard input' if name == '-' else name}: empty, nothing to decode")
    return data if name == "arguments" else bytes_of_input(data)
