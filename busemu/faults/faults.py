"""Faults at work: which strike what, when, and what the trace says of it.

A bus calls :meth:`Faults.instruction`, :meth:`Faults.begin` and :meth:`Faults.reply` as packets go
by. What befalls servos and the port comes by the bus's own events. Every fault has its own random
numbers, so that one more fault does not change what the others do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from ..plant import Plant, reading_of
from ..protocol import InstructionPacket
from ..servo import Servo
from ..tables import Robot
from ..timing import Profile, Uplink
from ..trace import WireEvent, WireEventKind
from .asked import Asked, asked_by
from .damage import Chance, Packet, damage
from .fault import Fault, FaultError, Kind
from .plight import Plights, Undo
from .uplink import FaultyUplink

#: So many faults are kept at most, those that are over included.
MOST_FAULTS = 256

#: Unbroken runs of bytes, each with its start [s].
Runs = list[tuple[float, bytes]]


class Line(Protocol):
    """What faults ask of the bus; instants are those of its clock [s]."""

    servos: tuple[Servo, ...]
    plant: Plant
    protocol: float
    plant_s: float
    profile: Profile
    faults: Faults | None
    uplink: Uplink
    on_wire: Callable[[WireEvent], None] | None

    def schedule(self, at_s: float, event: Callable[[float], object]) -> None: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class Standing:
    """How a fault stands: ``state`` is waiting, active or over."""

    number: int
    words: str
    state: str
    struck: int


@dataclass(slots=True)
class _Rule:
    number: int
    fault: Fault
    chance: Chance
    begin_s: float
    end_s: float
    struck: int = 0
    over: bool = False
    undo: list[Undo] = field(default_factory=list)

    def active(self, now_s: float) -> bool:
        return not self.over and self.begin_s <= now_s < self.end_s


class Faults:
    """The faults of one bus of ``robot``.

    ``draw`` makes the random numbers of the fault with a number (seeded; ``random.Random`` will
    do). ``plug`` takes the port away from its client (``False``) and gives it back (``True``); a
    port for which there is none cannot be unplugged. Where the plant says that a share of its
    samples is lost, so many replies with positions are, from the beginning.
    """

    def __init__(
        self,
        line: Line,
        robot: Robot,
        draw: Callable[[int], Chance],
        plug: Callable[[bool], object] | None = None,
    ) -> None:
        self.draw = draw
        self.silent = False  #: whether the servo whose turn it was has been silenced
        self.late_s = math.inf  #: from this instant on runs were put off [s]
        self._line = line
        self._robot = robot
        self._plug = plug
        self._rules: list[_Rule] = []
        self._given = 0
        self._asked = Asked()
        self._unplugs = 0
        by_id = {m.servo_id: s for m, s in zip(robot.servos, line.servos, strict=True)}
        self._plights = Plights(by_id)
        if share := reading_of(line.plant).lost_share:
            self.add(Fault(Kind.DROP, register="present_position", probability=share))

    # -- asking for faults ---------------------------------------------------------------------

    def add(self, fault: Fault) -> int:
        """Have a fault from now on; its number. Raises :class:`FaultError`."""
        if fault.kind is Kind.UNPLUG and self._plug is None:
            raise FaultError("unplug: this port cannot be unplugged by a fault; pull the plug")
        if len(self._rules) >= MOST_FAULTS:
            self._rules = [rule for rule in self._rules if not self._is_over(rule)]
        if len(self._rules) >= MOST_FAULTS:
            raise FaultError(f"there are {MOST_FAULTS} faults already: clear some first")
        self._given += 1
        line = self._line
        begin_s = line.plant_s + fault.after_s
        rule = _Rule(self._given, fault, self.draw(self._given), begin_s, begin_s + fault.for_s)
        self._rules.append(rule)
        if line.faults is None:
            line.faults = self
            line.uplink = self._uplink = FaultyUplink(line.profile, line.uplink)
        if not fault.strikes_packets:
            line.schedule(begin_s, lambda now_s: self._befall(rule, now_s))
        return rule.number

    def clear(self, which: int | Kind | None = None) -> int:
        """End faults: that of a number, those of a kind, or all. Returns how many there were."""
        chosen = [
            rule
            for rule in self._rules
            if which in (None, rule.number, rule.fault.kind) and not self._is_over(rule)
        ]
        for rule in chosen:
            self._end(rule, self._line.plant_s)
        if which is None:
            self._rules.clear()
        return len(chosen)

    def standing(self) -> list[Standing]:
        """How the faults stand, in the order of their numbers."""
        now_s = self._line.plant_s
        return [
            Standing(
                rule.number,
                str(rule.fault),
                "over" if self._is_over(rule) else "active" if rule.active(now_s) else "waiting",
                rule.struck,
            )
            for rule in self._rules
        ]

    def _is_over(self, rule: _Rule) -> bool:
        count = rule.fault.count
        spent = count is not None and rule.struck >= count
        return rule.over or spent or self._line.plant_s >= rule.end_s

    # -- what befalls servos and the port --------------------------------------------------------

    def _befall(self, rule: _Rule, now_s: float) -> None:
        if rule.over:
            return
        fault = rule.fault
        rule.struck += 1
        whom = f"servo {', '.join(map(str, fault.servos))}" if fault.servos else "all servos"
        self._tell(fault, _WORDS[fault.kind].format(whom, fault.new_id), now_s)
        if fault.kind is Kind.UNPLUG:
            rule.undo = [self._pull(now_s)]
        else:
            rule.undo = self._plights.begin(rule.number, fault, now_s)
        if fault.kind is Kind.OVERLOAD:
            rule.over = True
        elif rule.end_s < math.inf:
            self._line.schedule(rule.end_s, lambda now_s: self._end(rule, now_s))

    def _pull(self, now_s: float) -> Undo:
        assert self._plug is not None
        self._unplugs += 1
        if self._unplugs == 1:
            self._uplink.unplug()
            self._plug(False)

        def undo(now_s: float) -> None:
            assert self._plug is not None
            self._unplugs -= 1
            if not self._unplugs:
                self._uplink.replug()
                self._plug(True)

        return undo

    def _end(self, rule: _Rule, now_s: float) -> None:
        rule.over = True
        if rule.undo:
            for undo in rule.undo:
                undo(now_s)
            rule.undo = []
            self._tell(rule.fault, "over", now_s)

    # -- what strikes packets --------------------------------------------------------------------

    def instruction(self, packet: InstructionPacket, data: bytes, now_s: float) -> bytes:
        """What the servos hear of an instruction that goes by: the same, or something else."""
        asked = asked_by(packet, self._line.protocol)
        ids = tuple(asked.spans) or tuple(servo.servo_id for servo in self._line.servos)
        struck: Packet | None = None
        for rule in self._rules:
            if not rule.fault.on_instruction or self._hit(rule, ids, asked, now_s) is None:
                continue
            struck = struck or Packet(bytearray(data))
            what = damage(struck, rule.fault, rule.chance, 0, len(struck.data))
            self._struck(rule, f"instruction {asked.name}", what, now_s)
            if not struck.data:
                break
        return data if struck is None else struck.on_wire()

    def begin(self, packet: InstructionPacket | None) -> None:
        """Be told what the replies to come are about; ``None`` for a packet nobody could read."""
        self._asked = Asked() if packet is None else asked_by(packet, self._line.protocol)

    def reply(
        self, ids: Sequence[int], slices: Sequence[bytes], start_s: float, byte_s: float
    ) -> Runs:
        """What becomes of a reply: runs of bytes. Sets :attr:`silent` and :attr:`late_s`.

        One servo sends it, or, to a fast read, several in turn, each its slice.
        """
        self.late_s = math.inf
        self.silent = False
        packet = Packet(bytearray(b"".join(slices)))
        for rule in self._rules:
            if rule.fault.on_instruction or not rule.fault.strikes_packets:
                continue
            hit = self._hit(rule, ids, self._asked, start_s)
            if hit is None:
                continue
            turn = ids.index(hit)
            first = sum(map(len, slices[:turn]))
            what = damage(packet, rule.fault, rule.chance, first, first + len(slices[turn]))
            of = f" to {self._asked.name}" if self._asked.instruction else ""
            self._struck(rule, f"reply of servo {hit}{of}", what, start_s)
            if not packet.data:
                self.silent = True
                return []
        runs = packet.runs(start_s, byte_s)
        if packet.shift_s or packet.pauses:
            self.late_s = runs[0 if packet.shift_s else min(1, len(runs) - 1)][0]
            if len(runs) == 1 and not packet.shift_s:
                self.late_s = math.inf
        self._uplink.hold_s += packet.hold_s
        return runs

    def _hit(self, rule: _Rule, ids: Iterable[int], asked: Asked, now_s: float) -> int | None:
        """The first servo concerned that a fault strikes now, if it does."""
        fault = rule.fault
        if not rule.active(now_s) or (fault.count is not None and rule.struck >= fault.count):
            return None
        if fault.instruction is not None and fault.instruction != asked.instruction:
            return None
        for servo_id in ids:
            if fault.servos and servo_id not in fault.servos:
                continue
            if fault.register is None or self._touches(fault.register, servo_id, asked):
                struck = fault.probability >= 1.0 or rule.chance.random() < fault.probability
                return servo_id if struck else None
        return None

    def _touches(self, register: str, servo_id: int, asked: Asked) -> bool:
        address, length = asked.spans.get(servo_id, (0, 0))
        for servo in self._line.servos:
            if servo.servo_id == servo_id and register in servo.table:
                there = servo.table[register]
                return address < there.address + there.size and there.address < address + length
        return False

    def _struck(self, rule: _Rule, whom: str, what: str, now_s: float) -> None:
        rule.struck += 1
        self._tell(rule.fault, f"{whom}: {what}" if what else whom, now_s)

    def _tell(self, fault: Fault, words: str, now_s: float) -> None:
        if self._line.on_wire is not None:
            words = f"{fault.kind.value.replace('_', '-')}: {words}"
            self._line.on_wire(WireEvent(WireEventKind.FAULT, now_s, now_s, b"", words))


_WORDS = {
    Kind.DUPLICATE_ID: "{0} has taken ID {1}",
    Kind.DEAD: "{0} without power",
    Kind.BROWN_OUT: "{0} without power, for a moment",
    Kind.OVERLOAD: "{0} raises the alarm",
    Kind.OVERHEAT: "{0} too hot",
    Kind.ENCODER_STUCK: "{0} no longer sees its shaft move",
    Kind.UNPLUG: "the port is away",
}
