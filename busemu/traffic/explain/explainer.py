"""Packets in words, one after another, each in the light of those before it.

A status packet does not say what it is about: only the instruction before it tells which registers
its bytes are. In Protocol 1.0 it does not even say that it is a status packet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...protocol import (
    BROADCAST_ID,
    Instruction,
    crc16,
    unstuff,
    v1,
    v2,
)
from ...trace import WireEventKind
from .fields import check_field, error_words, head, on_wire
from .parameters import Field, instruction_name, layout_fits, tell
from .registers import Tables, Value, values
from .split import Stretch, split

#: The fault of a packet that met others.
COLLIDED = "collision: it met other bytes on the wire"
_GROUP = frozenset(
    {
        Instruction.SYNC_READ,
        Instruction.SYNC_WRITE,
        Instruction.BULK_READ,
        Instruction.BULK_WRITE,
        Instruction.FAST_SYNC_READ,
        Instruction.FAST_BULK_READ,
    }
)


@dataclass(frozen=True, slots=True)
class Explanation:
    """One packet, or a run of noise, in words.

    `kind` is instruction, status, noise, or fault: one that was asked for. `faults` say what is
    wrong with the packet itself; `notes` what is odd about what it asks or says. `error` is the
    error byte of a status packet.
    `values` are registers written by an instruction or read by a status packet. `due` are the IDs
    that have to answer a ping or a read.
    """

    data: bytes
    protocol: float | None
    kind: str
    summary: str
    fields: tuple[Field, ...]
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    servo_id: int | None = None
    instruction: int | None = None
    error: int | None = None
    values: tuple[Value, ...] = ()
    due: tuple[int, ...] = ()

    @property
    def bad(self) -> bool:
        """Whether no servo or host could take it as it is."""
        return bool(self.faults)


class Explainer:
    """Explains bytes of one bus; remembers the last instruction, whose answer comes next.

    Without a protocol each packet tells by its header. Without control tables, registers are
    addresses.
    """

    def __init__(self, protocol: float | None = None, tables: Tables | None = None) -> None:
        self.protocol = protocol
        self.tables = tables or Tables()
        self._asked: dict[int, tuple[int, int]] = {}
        self._order: list[int] = []
        self._due: dict[int, int] = {}  # bytes of data in the answer of each servo
        self._last: int | None = None  # the last instruction
        self._last_data = b""

    def explain(
        self, data: bytes, kind: WireEventKind | None = None, words: str = ""
    ) -> list[Explanation]:
        """Explain whatever `data` is, bytes in order; any bytes will do.

        `kind` tells who sent them, where that is known; else Protocol 1.0 packets are guessed.
        Of a fault that struck there are no bytes, but `words`.
        """
        if words:
            return [Explanation(b"", None, "fault", words, ())]
        found = [self._stretch(each, kind) for each in split(data, self.protocol)]
        if kind is WireEventKind.COLLISION:
            found = [replace(each, faults=(*each.faults, COLLIDED)) for each in found]
        return found

    def _stretch(self, stretch: Stretch, kind: WireEventKind | None) -> Explanation:
        if stretch.protocol is None:
            fields = (Field(stretch.data, "no packet", wrong=True),)
            return Explanation(stretch.data, None, "noise", "noise", fields, stretch.faults)
        if not stretch.whole:
            return _fragment(stretch)
        if self._is_status(stretch, kind):
            return self._status(stretch)
        return self._instruction(stretch, guessed=stretch.protocol == 1.0 and kind is None)

    def _is_status(self, stretch: Stretch, kind: WireEventKind | None) -> bool:
        data = stretch.data
        if stretch.protocol == 2.0:
            return data[7] == v2.STATUS
        if kind in (WireEventKind.STATUS, WireEventKind.INSTRUCTION):
            return kind is WireEventKind.STATUS
        if data == self._last_data:
            return False
        number, parameters = data[4], data[5:-1]
        if self._due.get(data[2]) == len(parameters):
            return True
        if instruction_name(number, 1.0) is None:
            return data[2] != BROADCAST_ID and number & 0x80 == 0
        return not parameters and not layout_fits(number, parameters, 1.0)

    # -- instruction packets -------------------------------------------------------------------

    def _instruction(self, stretch: Stretch, *, guessed: bool) -> Explanation:
        protocol, data = stretch.protocol or 0.0, stretch.data
        body_at = v1.BEFORE_BODY if protocol == 1.0 else v2.BEFORE_BODY
        check = 1 if protocol == 1.0 else 2
        wire = data[body_at:-check]
        body = wire if protocol == 1.0 else unstuff(wire)
        servo_id, number = data[2 if protocol == 1.0 else 4], body[0]
        name = instruction_name(number, protocol)
        told = tell(number, servo_id, body[1:], protocol, self.tables)
        what = Field(wire[:1], f"instruction: {name}" if name else "instruction: unknown", not name)
        parts = on_wire([what, *told.fields], wire)
        notes = list(told.notes)
        if number in _GROUP and servo_id != BROADCAST_ID:
            notes.append(f"{name} goes to ID 254, not {servo_id}: no servo does it")
        if guessed and len(body) == 1 and name and servo_id != BROADCAST_ID:
            notes.append(f"from a servo, it would say: {error_words(number, 1.0)}")
        self._asked = {each: (address, length) for each, address, length in told.asked}
        self._order = [each for each, _, _ in told.asked]
        self._due = {each: length for each, _, length in told.asked}
        if not self._due and servo_id != BROADCAST_ID:
            self._due = {servo_id: 0}
        self._last, self._last_data = number, data
        return Explanation(
            data,
            protocol,
            "instruction",
            _asking(name or f"instruction {number:02X}", number, servo_id, told.what),
            (*head(stretch), *parts, check_field(stretch)),
            (*stretch.faults, *told.faults),
            tuple(notes),
            servo_id,
            number,
            values=tuple(told.writes),
            due=self._answering(number, servo_id),
        )

    def _answering(self, number: int, servo_id: int) -> tuple[int, ...]:
        if number == Instruction.PING and servo_id != BROADCAST_ID:
            return (servo_id,)
        if number in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ):
            return (BROADCAST_ID,)
        return tuple(self._order)

    # -- status packets ------------------------------------------------------------------------

    def _status(self, stretch: Stretch) -> Explanation:
        protocol, data = stretch.protocol or 0.0, stretch.data
        servo_id = data[2 if protocol == 1.0 else 4]
        if protocol == 2.0 and servo_id == BROADCAST_ID:
            return self._fast_status(stretch)
        wire = data[4:-1] if protocol == 1.0 else data[7:-2]
        body = wire if protocol == 1.0 else unstuff(wire)
        fields, faults, found = [], list(stretch.faults), list[Value]()
        if protocol == 2.0:
            fields.append(Field(body[:1], "instruction: status"))
            body = body[1:]
        error, said = body[0] if body else None, body[1:]
        if error is None:
            faults.append("too short for a status packet: it has no error byte")
        else:
            fields.append(Field(body[:1], f"error: {error_words(error, protocol)}"))
        told = f"servo {servo_id}: " + ("ok" if not error else error_words(error, protocol))
        asked = self._asked.get(servo_id)
        if said and self._last == Instruction.PING:
            words = _identity(said, self.tables, servo_id)
            fields.append(Field(said, words))
            told += f", {words}"
        elif said and asked is not None and asked[1] == len(said):
            found = values(self.tables.of(servo_id), servo_id, asked[0], said)
            fields += [Field(value.data, str(value)) for value in found]
            text = ", ".join(map(str, found))
            told = f"servo {servo_id}: {text}" if not error else f"{told}, {text}"
        elif said:
            number = f" = {int.from_bytes(said, 'little')}" if len(said) in (1, 2, 4) else ""
            words = f"{len(said)} byte{'s' if len(said) > 1 else ''} of data{number}"
            if asked is not None:
                words += f", {asked[1]} were asked for"
            fields.append(Field(said, words))
            told += f", {words}"
        return Explanation(
            data,
            protocol,
            "status",
            told,
            (*head(stretch), *on_wire(fields, wire), check_field(stretch)),
            tuple(faults),
            servo_id=servo_id,
            error=error,
            values=tuple(found),
        )

    def _fast_status(self, stretch: Stretch) -> Explanation:
        """The joint reply to a fast read: blocks, each with a CRC over all that came before it."""
        data, faults = stretch.data, list(stretch.faults)
        sizes = [self._asked[each][1] for each in self._order if each in self._asked]
        fields, told, found = [Field(data[7:8], "instruction: status, of a fast read")], [], []
        if not sizes or len(data) - 10 + 2 != sum(4 + size for size in sizes):
            fields.append(Field(data[8:-2], "blocks: error, ID, data and CRC of each servo"))
            told.append(f"{len(data) - 10} bytes of blocks")
            sizes = []
        at = 8
        for turn, size in enumerate(sizes):
            error, servo_id, said = data[at], data[at + 1], data[at + 2 : at + 2 + size]
            end = at + 4 + size
            fields.append(Field(data[at : at + 1], f"error: {error_words(error, 2.0)}"))
            due = self._order[turn]
            fields.append(Field(data[at + 1 : at + 2], f"servo {servo_id}", servo_id != due))
            if servo_id != due:
                faults.append(f"block {turn + 1} is of servo {servo_id}, due is servo {due}")
            new = values(self.tables.of(servo_id), servo_id, self._asked[due][0], said)
            fields += [Field(value.data, str(value)) for value in new]
            found += new
            told.append(f"servo {servo_id} {', '.join(map(str, new))}")
            if turn < len(sizes) - 1:
                words = _block_crc(data[: end - 2], data[end - 2 : end], data[at : end - 2])
                fields.append(Field(data[end - 2 : end], words or "CRC so far: right", bool(words)))
                if words:
                    faults.append(f"block of servo {servo_id}: {words}")
            at = end
        return Explanation(
            data,
            2.0,
            "status",
            "; ".join(told),
            (*head(stretch), *fields, check_field(stretch)),
            tuple(faults),
            servo_id=BROADCAST_ID,
            error=data[8] if len(data) > 10 else None,
            values=tuple(found),
        )


def _asking(name: str, number: int, servo_id: int, what: str) -> str:
    if number in _GROUP or number == Instruction.USB2AX_SYNC_READ:
        return f"{name} {what}".rstrip()
    whom = "all servos" if servo_id == BROADCAST_ID else f"servo {servo_id}"
    return f"{name} {whom}" + (f": {what}" if what else "")


def _identity(said: bytes, tables: Tables, servo_id: int) -> str:
    if len(said) != 3:
        return f"{len(said)} bytes, a ping is answered with model and firmware"
    number, table = int.from_bytes(said[:2], "little"), tables.of(servo_id)
    model = f" ({table.model})" if table is not None and table.model_number == number else ""
    return f"model {number}{model}, firmware {said[2]}"


def _block_crc(before: bytes, check: bytes, block: bytes) -> str:
    """What is wrong with the CRC inside a fast reply, which covers all that is before it."""
    if crc16(before) == int.from_bytes(check, "little"):
        return ""
    text = f"CRC so far is {check.hex(' ').upper()}, the bytes give "
    text += crc16(before).to_bytes(2, "little").hex(" ").upper()
    if crc16(block) == int.from_bytes(check, "little"):
        text += ": it covers its block only, but has to go on from the header"
    return text


def _fragment(stretch: Stretch) -> Explanation:
    """A packet that cannot be read to its end."""
    data, protocol = stretch.data, stretch.protocol or 0.0
    body_at = v1.BEFORE_BODY if protocol == 1.0 else v2.BEFORE_BODY
    fields = head(stretch)
    at = 2 if protocol == 1.0 else 4
    servo_id = data[at] if len(data) > at else None
    summary = "the beginning of a packet"
    if len(data) > body_at:
        name = instruction_name(data[body_at], protocol)
        fields.append(Field(data[body_at : body_at + 1], f"instruction: {name or 'unknown'}"))
        summary += f": {name} servo {servo_id}" if name else ""
    if data[body_at + 1 :]:
        fields.append(Field(data[body_at + 1 :], "what there is of the rest", wrong=True))
    return Explanation(
        data, protocol, "fragment", summary, tuple(fields), stretch.faults, servo_id=servo_id
    )
