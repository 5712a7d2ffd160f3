"""The lines of a trace: what went over the wire, as a file that another program can follow.

The first line tells whose trace it is, every other is a run of bytes on the wire (JSON)::

    {"format":"busemu-trace/1","robot":"marvin","protocol":2.0,"clock_s":5.1,"wall_s":1.7e9}
    {"kind":"instruction","start_s":5.2000,"end_s":5.2001,"read_s":5.1999,"hex":"FF FF FD 00 .."}
    {"kind":"status","start_s":5.2008,"end_s":5.2009,"handed_s":5.2012,"hex":"FF FF FD 00 .."}
    {"kind":"fault","start_s":5.3,"end_s":5.3,"words":"drop: servo 3 does not answer ..","hex":""}

All times are seconds on the clock of the bus. `start_s` and `end_s` are the model's: first start
bit and last stop bit. `read_s` is when the host's bytes were really taken from the port, `handed_s`
when the reply was really put there. `wall_s` is the time of day (since 1970) at `clock_s`. A server
that starts again on the same file writes another first line and goes on.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from ..trace import WireEvent, WireEventKind

FORMAT = "busemu-trace/1"
START = b'{"format":"busemu-trace/'


class TraceError(ValueError):
    """A trace file that cannot be used: says why and what to do."""


@dataclass(frozen=True, slots=True)
class Header:
    """Whose trace it is; `wall_s` is the time of day [s since 1970] at `clock_s` [s].

    `file` is what the robot was loaded from, on the machine that wrote the trace.
    """

    robot: str = ""
    protocol: float = 2.0
    baud_rate: int = 0
    timing: str = ""
    clock_s: float = 0.0
    wall_s: float = 0.0
    file: str = ""

    def line(self) -> str:
        """The header as a line of the file, with its line break."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        return json.dumps({"format": FORMAT, **fields}, separators=(",", ":")) + "\n"


@dataclass(frozen=True, slots=True)
class Record:
    """A run of bytes on the wire with the model's times, and with measured ones [s] if known."""

    event: WireEvent
    read_s: float | None = None
    handed_s: float | None = None

    def line(self) -> str:
        """The record as a line of the file, with its line break."""
        event = self.event
        measured = f'"read_s":{self.read_s:.7f},' if self.read_s is not None else ""
        if self.handed_s is not None:
            measured += f'"handed_s":{self.handed_s:.7f},'
        if event.words:
            measured += f'"words":{json.dumps(event.words)},'
        return (
            f'{{"kind":"{event.kind.value}","start_s":{event.start_s:.7f},'
            f'"end_s":{event.end_s:.7f},{measured}"hex":"{event.data.hex(" ").upper()}"}}\n'
        )


@dataclass(frozen=True, slots=True)
class Dropped:
    """So many runs of bytes are missing here: the writer could not keep up."""

    count: int

    def line(self) -> str:
        """The gap as a line of the file, with its line break."""
        return f'{{"dropped":{self.count}}}\n'


Entry = Header | Record | Dropped


def parse_line(line: str) -> Entry | None:
    """What a line of a trace says; None for one that is damaged or of another format."""
    try:
        fields = json.loads(line)
        if "hex" in fields:
            event = WireEvent(
                WireEventKind(fields["kind"]),
                float(fields["start_s"]),
                float(fields["end_s"]),
                bytes.fromhex(fields["hex"]),
                str(fields.get("words", "")),
            )
            return Record(event, _seconds(fields, "read_s"), _seconds(fields, "handed_s"))
        if "dropped" in fields:
            return Dropped(int(fields["dropped"]))
        if fields["format"] != FORMAT:
            return None
        return Header(
            str(fields["robot"]),
            float(fields["protocol"]),
            int(fields["baud_rate"]),
            str(fields["timing"]),
            float(fields["clock_s"]),
            float(fields["wall_s"]),
            str(fields.get("file", "")),
        )
    except (ValueError, KeyError, TypeError):
        return None


def _seconds(fields: dict[str, object], name: str) -> float | None:
    value = fields.get(name)
    return None if value is None else float(str(value))


def is_trace(start: bytes) -> bool:
    """Whether a file that begins with these bytes is a trace."""
    return start.startswith(START)
