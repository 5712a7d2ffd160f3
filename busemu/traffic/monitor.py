"""A terminal view of a bus: what a tally knows, drawn with rich.

The same pieces make the live view, which fills the terminal, and the snapshot, one below another.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ..protocol import BROADCAST_ID
from .explain import Line, brief
from .explain.text import STYLES
from .tally import Packet, Tally

#: Lines of packets that are kept for the screen.
KEPT = 400
#: Bars of the timing.
BINS = 6
#: A live view narrower than this [columns] has its parts below one another.
WIDE = 120
BORDER = "bright_black"
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


class Monitor:
    """A tally, the last packets, and how they look; `servo_id` is whose registers are shown."""

    def __init__(self, tally: Tally, servo_id: int | None = None) -> None:
        self.tally = tally
        self.servo_id = servo_id
        self.lines: deque[Line] = deque(maxlen=KEPT)

    def add(self, packets: Iterable[Packet]) -> None:
        """Show more packets."""
        for packet in packets:
            at_s = packet.record.event.start_s - self.tally.header.clock_s
            self.lines.extend(brief(packet.explanation, f"{at_s:12.6f} "))

    def say(self, text: str) -> None:
        """Show a line of another kind among the packets."""
        self.lines.append(((text, "title"),))

    # -- pieces --------------------------------------------------------------------------------

    def head(self, now_s: float) -> Text:
        """Whose bus it is and how it goes, on one line."""
        tally, header = self.tally, self.tally.header
        if not tally.starts:
            return Text("waiting for a trace: busemu serve --robot NAME --trace FILE", "yellow")
        silent = sum(servo.silent for servo in tally.servos.values())
        refused = sum(servo.errors for servo in tally.servos.values())
        text = Text.assemble(
            (f"{header.robot}  ", "bold"),
            (f"{tally.rate('all', now_s):.0f} instructions/s", "bold cyan"),
            f"  {tally.instructions.total()} in {tally.now_s - header.clock_s:.0f} s  ",
        )
        for count, what in (
            (tally.bad, "bad"),
            (refused, "with error"),
            (silent, "unanswered"),
            (tally.dropped, "not in the trace"),
        ):
            text.append(f"{count} {what}  ", "bold red" if count else "green")
        text.append(f"Protocol {header.protocol}, {header.baud_rate} bit/s, {header.timing}")
        return text

    def instructions(self, now_s: float) -> Table:
        """Counts and rates by instruction."""
        table = _table("instruction", "a second", "all")
        for name, count in self.tally.instructions.most_common():
            table.add_row(name, f"{self.tally.rate(name, now_s):.1f}", str(count))
        return table

    def servos(self, now_s: float, limit: int = 254) -> Table:
        """Replies and errors by servo, `limit` lines at most; then those with trouble come first.

        Mute is a read that the servo did not answer.
        """
        table = _table("servo", "per s", "replies", "errors", "mute")
        servos = sorted(self.tally.servos.items())
        hidden = len(servos) - limit + 1 if len(servos) > limit else 0
        if hidden:
            servos.sort(key=lambda item: not (item[1].errors or item[1].silent))
        for servo_id, servo in servos[: len(servos) - hidden]:
            table.add_row(
                "fast" if servo_id == BROADCAST_ID else str(servo_id),
                f"{self.tally.rate(f'servo {servo_id}', now_s):.1f}",
                str(servo.replies),
                Text(str(servo.errors), "bold red" if servo.errors else ""),
                Text(str(servo.silent), "bold red" if servo.silent else ""),
            )
        if hidden:
            table.add_row(Text(f"+ {hidden}", BORDER))
        return table

    def faults(self) -> Table:
        """What was wrong with bad packets."""
        table = _table("wrong", "packets")
        for name, count in self.tally.faults.most_common():
            table.add_row(Text(name, "red"), str(count))
        return table

    def struck(self) -> Table:
        """Faults that were asked for, and how often they struck."""
        table = _table("fault", "struck")
        for name, count in self.tally.struck.most_common():
            table.add_row(Text(name, "yellow"), str(count))
        return table

    def shown_servo(self) -> int | None:
        """Whose registers are shown: as asked, else the first of which any is known."""
        if self.servo_id is not None:
            return self.servo_id
        return min(self.tally.registers, default=None)

    def registers(self) -> Table:
        """The registers of one servo as last seen on the wire: > written, < read."""
        table = _table("addr", "", "register", "value", "s ago", right=(0, 4))
        servo_id = self.shown_servo()
        known = self.tally.values(servo_id) if servo_id is not None else {}
        for address, latest in known.items():
            table.add_row(
                str(address),
                Text(">", "yellow") if latest.written else Text("<"),
                latest.value.name,
                latest.value.text,
                f"{self.tally.now_s - latest.at_s:.1f}",
            )
        return table

    def timing(self) -> RenderableType:
        """How long answers took, modelled and measured, side by side."""
        answers = self.tally.answers
        modelled = sorted(1e3 * answer.modelled_s for answer in answers)
        measured = sorted(
            1e3 * answer.measured_s for answer in answers if answer.measured_s is not None
        )
        if not modelled:
            return Text("no answers yet", "dim")
        low_ms, step_ms = _bins(modelled, measured)
        digits = 1 if step_ms >= 0.5 else 2 if step_ms >= 0.05 else 3
        table = _table("ms", "on the wire, modelled", "read to handed, measured", right=(0,))
        top = 1
        rows = []
        for index in range(BINS):
            start_ms = low_ms + index * step_ms
            last = index == BINS - 1
            counts = [
                sum(start_ms <= ms and (last or ms < start_ms + step_ms) for ms in values)
                for values in (modelled, measured)
            ]
            top = max(top, *counts)
            rows.append((f"{start_ms:.{digits}f}" + ("+" if last else " "), counts))
        for name, counts in rows:
            table.add_row(name, *(_bar(count, top, 14) for count in counts))
        table.add_row("", _quantiles(modelled), _quantiles(measured))
        return table

    # -- the whole -----------------------------------------------------------------------------

    def snapshot(self, now_s: float, packets: int) -> Group:
        """Everything, one below another, with the last so many lines of packets."""
        last = list(self.lines)[-packets:] if packets else []
        parts: list[RenderableType] = [_whole_line(self.head(now_s))]
        titled: list[tuple[str, RenderableType]] = [
            ("instructions", self.instructions(now_s)),
            ("servos", self.servos(now_s)),
        ]
        if self.tally.bad:
            titled.append(("bad packets", self.faults()))
        if self.tally.struck:
            titled.append(("faults that struck", self.struck()))
        titled += [
            (f"registers of servo {self.shown_servo()}", self.registers()),
            ("from instruction to answer", self.timing()),
            ("packets", Group(*(_whole_line(_text(line)) for line in last))),
        ]
        for title, part in titled:
            parts += [Text(), Text(title, "bold"), part]
        return Group(*parts)

    def screen(self, now_s: float, width: int, height: int) -> Layout:
        """Everything, for a terminal of so many columns and lines."""
        few = len(self.tally.instructions) + (len(self.tally.faults) + 1 if self.tally.bad else 0)
        few += len(self.tally.struck) + 1 if self.tally.struck else 0
        short, third = min(few + 3, height // 3), height // 3
        wide = width >= WIDE
        room = height - 1 - short
        rows = (min(len(self.tally.servos) + 3, room - room // 3) if wide else third) - 3
        counts: RenderableType = self.instructions(now_s)
        if self.tally.bad:
            counts = Group(counts, self.faults())
        if self.tally.struck:
            counts = Group(counts, self.struck())
        packets = Layout(_panel("packets", _Newest(self.lines)), ratio=1)
        instructions = _panel("instructions", counts)
        servos = _panel("servos", self.servos(now_s, rows))
        registers = _panel(f"registers of servo {self.shown_servo()}", self.registers())
        timing = Layout(_panel("from instruction to answer", self.timing()), size=BINS + 4)
        head = self.head(now_s)
        head.no_wrap, head.overflow = True, "ellipsis"
        body, below, whole = Layout(ratio=1), Layout(size=third), Layout()
        whole.split_column(Layout(head, size=1), body)
        if wide:
            left, right = Layout(ratio=3), Layout(ratio=2, minimum_size=54)
            left.split_column(*((packets, timing) if height >= 24 else (packets,)))
            right.split_column(
                Layout(instructions, size=short),
                Layout(servos, size=rows + 3),
                Layout(registers, ratio=1),
            )
            body.split_row(left, right)
        elif height >= 36:
            below.split_row(Layout(servos), Layout(registers, ratio=2))
            body.split_column(packets, timing, below)
        else:
            below.split_row(Layout(instructions), Layout(servos))
            body.split_column(packets, below)
        return whole


class _Newest:
    """The newest lines, as many as there is room for."""

    def __init__(self, lines: Iterable[Line]) -> None:
        self._lines = lines

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in list(self._lines)[-(options.height or options.max_height) :]:
            text = _text(line)
            text.no_wrap, text.overflow = True, "ellipsis"
            yield text


def _text(line: Line) -> Text:
    return Text.assemble(*((piece, STYLES[style]) for piece, style in line))


def _whole_line(text: Text) -> Text:
    """The same on one line, however long."""
    text.no_wrap, text.overflow = True, "ignore"
    return text


def _panel(title: str, inside: RenderableType) -> Panel:
    return Panel(inside, title=title, title_align="left", border_style=BORDER, padding=(0, 1))


def _table(*columns: str, right: tuple[int, ...] | None = None) -> Table:
    """A table without lines; all columns but the first are numbers, unless `right` names them."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bright_black")
    for index, column in enumerate(columns):
        number = index > 0 if right is None else index in right
        table.add_column(column, justify="right" if number else "left", no_wrap=True)
    return table


def _bins(modelled: list[float], measured: list[float]) -> tuple[float, float]:
    """Where the first bar begins and how wide each is, both [ms]; the last one is open."""
    low = min(modelled[0], *measured[:1])
    high = max(values[int(0.98 * (len(values) - 1))] for values in (modelled, measured) if values)
    raw = max((high - low) / (BINS - 1), 0.01)
    power = 10.0 ** len(str(int(raw))) / 10.0 if raw >= 1.0 else 1.0
    while power > raw:
        power /= 10.0
    step = next(power * factor for factor in _STEPS if power * factor >= raw * 0.999)
    return low // step * step, step


def _bar(count: int, top: int, width: int) -> Text:
    """A bar and its number."""
    eighths = round(8 * width * count / top)
    blocks = "█" * (eighths // 8) + ("", *"▏▎▍▌▋▊▉")[eighths % 8]
    return Text.assemble((f"{blocks:<{width}}", "cyan"), f" {count or '':>5}")


def _quantiles(values: list[float]) -> Text:
    if not values:
        return Text("not measured", "dim")
    middle, most = values[len(values) // 2], values[int(0.95 * (len(values) - 1))]
    return Text(f"median {middle:.2f}, 95 % below {most:.2f}", "bright_black")
