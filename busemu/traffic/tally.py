"""What a trace adds up to: counts and rates, errors, last values of registers, times of answers."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from ..trace import WireEventKind
from .explain import COLLIDED, Explainer, Explanation, Tables, Value, instruction_name
from .traceline import Dropped, Entry, Header, Record

_NUMBER = re.compile(r" [0-9A-F]{1,3}$")
#: Rates are over the last whole seconds of this number.
RATE_WINDOW_S = 5
#: So many answers are kept for the timing.
ANSWERS = 5000


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet of the trace in words, at its instant on the wire [s]."""

    record: Record
    explanation: Explanation


@dataclass(frozen=True, slots=True)
class Latest:
    """What a register was last seen to be, at an instant [s]: as written, or as read."""

    value: Value
    at_s: float
    written: bool


@dataclass(frozen=True, slots=True)
class Answer:
    """From the first bit of an instruction to the last of its last reply [s].

    `modelled_s` is on the wire; `measured_s` from the host's bytes being read to the reply being
    handed over, or None where the trace does not tell.
    """

    modelled_s: float
    measured_s: float | None


@dataclass(slots=True)
class ServoTally:
    """What became of one servo: `errors` are refusals and alerts, `silent` reads without answer."""

    replies: int = 0
    errors: int = 0
    silent: int = 0


@dataclass(slots=True)
class _Asked:
    """The instruction that is being answered."""

    record: Record
    due: set[int]
    last: Record | None = None


@dataclass(slots=True)
class _Rates:
    """Counts by second of the bus's clock, as long as they matter."""

    seconds: deque[tuple[int, Counter[str]]] = field(
        default_factory=lambda: deque(maxlen=RATE_WINDOW_S + 1)
    )

    def count(self, name: str, at_s: float) -> None:
        second = int(at_s // 1.0)
        if not self.seconds or self.seconds[-1][0] < second:
            self.seconds.append((second, Counter()))
        self.seconds[-1][1][name] += 1

    def of(self, name: str, now_s: float) -> float:
        """Events a second, over the whole seconds before `now_s` that the trace covers."""
        now = int(now_s // 1.0)
        if not self.seconds:
            return 0.0
        first = max(self.seconds[0][0], now - RATE_WINDOW_S)
        total = sum(counter[name] for second, counter in self.seconds if first <= second < now)
        return total / max(1, now - first)


class Tally:
    """Adds up the entries of a trace, in order; a server that starts again begins a new account.

    `tables_of` finds the control tables of the robot that a header names.
    """

    def __init__(self, tables_of: Callable[[Header], Tables]) -> None:
        self._tables_of = tables_of
        self.header = Header()
        self.starts = 0  #: how often a server has begun to write
        self._begin(Header())

    def _begin(self, header: Header) -> None:
        self.header = header
        tables = self._tables_of(header)
        self._explainer = Explainer(header.protocol if self.starts else None, tables)
        self._rates = _Rates()
        self._asked: _Asked | None = None
        self.now_s = header.clock_s  #: end of the last packet [s]
        self.instructions: Counter[str] = Counter()
        self.servos: dict[int, ServoTally] = {}
        self.faults: Counter[str] = Counter()  #: what was wrong with bad packets
        self.struck: Counter[str] = Counter()  #: faults that were asked for, by kind
        self.registers: dict[int, dict[int, Latest]] = {}
        self.answers: deque[Answer] = deque(maxlen=ANSWERS)
        self.dropped = 0

    def take(self, entry: Entry) -> list[Packet]:
        """Add an entry; the packets in it."""
        if isinstance(entry, Header):
            if entry != self.header:
                self.starts += 1
                self._begin(entry)
            return []
        if isinstance(entry, Dropped):
            self.dropped += entry.count
            self._asked = None
            return []
        event = entry.event
        self.now_s = max(self.now_s, event.end_s)
        found = self._explainer.explain(event.data, event.kind, event.words)
        for explanation in found:
            self._add(entry, explanation)
        return [Packet(entry, explanation) for explanation in found]

    def rate(self, name: str, now_s: float) -> float:
        """Packets a second of an instruction (`"sync_read"`), or of `"servo 7"`, or `"all"`."""
        return self._rates.of(name, now_s)

    @property
    def bad(self) -> int:
        """Packets that were bad, noise and collisions included."""
        return self.faults.total()

    def values(self, servo_id: int) -> Mapping[int, Latest]:
        """The registers of a servo by address, as last seen."""
        return dict(sorted(self.registers.get(servo_id, {}).items()))

    def _add(self, record: Record, explanation: Explanation) -> None:
        at_s = record.event.start_s
        if explanation.kind == "fault":
            kind, _, what = explanation.summary.partition(": ")
            self.struck[kind] += what != "over"
        if explanation.bad:
            self.faults[_kind_of_fault(explanation)] += 1
        if explanation.kind == "instruction":
            name = instruction_name(explanation.instruction or 0, explanation.protocol or 0.0)
            self.instructions[name or "unknown"] += 1
            self._rates.count(name or "unknown", at_s)
            self._rates.count("all", at_s)
            self._close()
            if record.event.kind is WireEventKind.INSTRUCTION:
                self._asked = _Asked(record, set(explanation.due))
        elif explanation.kind == "status" and explanation.servo_id is not None:
            self._reply(record, explanation, explanation.servo_id)
        if not explanation.bad:
            for value in explanation.values:
                self.registers.setdefault(value.servo_id, {})[value.address] = Latest(
                    value, at_s, explanation.kind == "instruction"
                )

    def _reply(self, record: Record, explanation: Explanation, servo_id: int) -> None:
        servo = self.servos.setdefault(servo_id, ServoTally())
        servo.replies += 1
        servo.errors += bool(explanation.error)
        self._rates.count(f"servo {servo_id}", record.event.start_s)
        if self._asked is not None:
            self._asked.last = record
            self._asked.due.discard(servo_id)

    def _close(self) -> None:
        """The host speaks again: the answer to what it asked before is over."""
        asked, self._asked = self._asked, None
        if asked is None:
            return
        for servo_id in asked.due:
            self.servos.setdefault(servo_id, ServoTally()).silent += 1
        if asked.last is not None:
            first, last = asked.record, asked.last
            measured = None
            if first.read_s is not None and last.handed_s is not None:
                measured = last.handed_s - first.read_s
            self.answers.append(Answer(last.event.end_s - first.event.start_s, measured))


def _kind_of_fault(explanation: Explanation) -> str:
    """The faults of one kind under one name: without the numbers that tell them apart."""
    if explanation.kind == "noise" and explanation.faults[-1] != COLLIDED:
        return "noise"
    if explanation.kind == "fragment":
        return "cut off or without end"
    start = explanation.faults[-1].partition(":")[0]
    name, is_, _ = start.partition(" is ")
    return f"wrong {_NUMBER.sub('', name)}" if is_ else _NUMBER.sub("", start)
