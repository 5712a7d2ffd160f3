"""The parameters of each instruction: how many there must be, and what each says.

Layouts: e-manual dxl/protocol1 and dxl/protocol2, section Instruction Details. Addresses and
lengths are one byte wide in Protocol 1.0 and two in 2.0, low byte first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

from ...protocol import BROADCAST_ID, Instruction
from .registers import Tables, Value, span, values


@dataclass(frozen=True, slots=True)
class Field:
    """Bytes of a packet that belong together, and what they say; `wrong` where they are bad."""

    data: bytes
    words: str
    wrong: bool = False


@dataclass(slots=True)
class Told:
    """What the parameters of an instruction say.

    `what` goes behind the instruction's name. `asked` are the (servo ID, address, length) of a
    read in the order of replies. `writes` are the register values written. `faults` make the packet
    bad; `notes` do not, but a servo will not do what it says.
    """

    fields: list[Field] = field(default_factory=list)
    what: str = ""
    asked: list[tuple[int, int, int]] = field(default_factory=list)
    writes: list[Value] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, data: bytes, words: str) -> None:
        """Append a field."""
        if data:
            self.fields.append(Field(data, words))


def instruction_name(number: int, protocol: float) -> str | None:
    """The e-manual's name of an instruction of a protocol; None where it has none of the number."""
    known = number in _LAYOUTS and (_LAYOUTS[Instruction(number)][0 if protocol == 1.0 else 1])
    return Instruction(number).name.lower() if known else None


def layout_fits(number: int, parameters: bytes, protocol: float) -> bool:
    """Whether an instruction exists in a protocol and can have these parameters."""
    return instruction_name(number, protocol) is not None and not (
        tell(number, 1, parameters, protocol, Tables()).faults
    )


def tell(number: int, servo_id: int, parameters: bytes, protocol: float, tables: Tables) -> Told:
    """What the parameters (as meant, without stuffing) of an instruction packet say."""
    told = Told()
    if instruction_name(number, protocol) is None:
        other = 2.0 if protocol == 1.0 else 1.0
        elsewhere = instruction_name(number, other)
        hint = f"; it is {elsewhere} in Protocol {other}" if elsewhere else ""
        told.faults.append(f"instruction {number:02X} is unknown in Protocol {protocol}{hint}")
        told.add(parameters, "parameters")
        return told
    width = 1 if protocol == 1.0 else 2
    _LAYOUTS[Instruction(number)][2](told, servo_id, parameters, width, tables)
    return told


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _fault(told: Told, parameters: bytes, at: int, needs: str) -> None:
    """Note that the parameters do not divide up; what is left of them from `at` is one field."""
    count = len(parameters)
    if at <= count < _least(needs):
        words = "too short for its instruction"
    elif "or more" in needs:
        words = "parameters do not divide up"
    else:
        words = "too long for its instruction"
    told.faults.append(f"{words}: {needs}, {count} {'is' if count == 1 else 'are'} there")
    if parameters[at:]:
        told.fields.append(Field(parameters[at:], "parameters", wrong=True))


def _least(needs: str) -> int:
    return next((int(word) for word in needs.split() if word.isdecimal()), 0)


def _nothing(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    if parameters:
        _fault(told, parameters, 0, "it takes 0 parameters")


def _factory_reset(
    told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables
) -> None:
    if width == 1:
        _nothing(told, servo_id, parameters, width, tables)
        return
    if len(parameters) != 1:
        _fault(told, parameters, 0, "it takes 1 parameter")
        return
    kept = {0xFF: "everything", 0x01: "all but the ID", 0x02: "all but ID and baud rate"}
    told.what = kept.get(parameters[0], f"mode {parameters[0]:02X}")
    told.add(parameters, told.what)


def _clear(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    _keyed(told, parameters, b"\x44\x58\x4c\x22", {1: "turns of the present position", 2: "error"})


def _backup(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    _keyed(told, parameters, b"CTRL", {1: "store the control table", 2: "restore it"})


def _keyed(told: Told, parameters: bytes, key: bytes, modes: dict[int, str]) -> None:
    if len(parameters) != 5:
        _fault(told, parameters, 0, "it takes 5 parameters")
        return
    told.what = modes.get(parameters[0], f"mode {parameters[0]:02X}")
    told.add(parameters[:1], told.what)
    right = parameters[1:] == key
    words = "key, as the e-manual gives it"
    if not right:
        words = f"key, should be {key.hex(' ').upper()}"
        told.faults.append(f"the key is {parameters[1:].hex(' ').upper()}, {words[5:]}")
    told.fields.append(Field(parameters[1:], words, wrong=not right))


def _read(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    if len(parameters) != 2 * width:
        _fault(told, parameters, 0, f"it takes {2 * width} parameters (address, length)")
        return
    address, length = _number(parameters[:width]), _number(parameters[width:])
    told.what = span(tables.of(servo_id), address, length)
    told.asked.append((servo_id, address, length))
    told.add(parameters[:width], f"address {address}{_names(tables, servo_id, address, length)}")
    told.add(parameters[width:], f"length {length}")


def _write(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    if len(parameters) < width + 1:
        _fault(told, parameters, 0, f"it takes {width + 1} parameters or more (address, data)")
        return
    address = _number(parameters[:width])
    told.add(parameters[:width], f"address {address}")
    told.what = _data(told, servo_id, address, parameters[width:], tables)


def _data(told: Told, servo_id: int, address: int, data: bytes, tables: Tables) -> str:
    found = values(tables.of(servo_id), servo_id, address, data, write=True)
    for value in found:
        told.add(value.data, str(value))
    told.writes += found
    whom = "the servos" if servo_id == BROADCAST_ID else f"servo {servo_id}"
    told.notes += [f"{whom} will refuse it: {value.note}" for value in found if value.note]
    return ", ".join(map(str, found))


def _sync_read(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    if len(parameters) < 2 * width + 1:
        _fault(
            told,
            parameters,
            0,
            f"it takes {2 * width + 1} parameters or more (address, length, IDs)",
        )
        return
    address, length = _number(parameters[:width]), _number(parameters[width : 2 * width])
    ids = parameters[2 * width :]
    told.add(parameters[:width], f"address {address}{_names(tables, ids[0], address, length)}")
    told.add(parameters[width : 2 * width], f"length {length}")
    told.add(ids, f"servo{'s' if len(ids) > 1 else ''} {_ids(ids)}")
    told.asked += [(each, address, length) for each in ids]
    told.what = f"{span(tables.of(ids[0]), address, length)} of {_ids(ids)}"
    _once(told, list(ids))


def _sync_write(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    address, length = _number(parameters[:width]), _number(parameters[width : 2 * width])
    body = parameters[2 * width :]
    least = 2 * width + 1 + max(1, length)
    if len(parameters) < least or length < 1 or len(body) % (length + 1):
        needs = f"it takes {least} parameters or more (address, length, then ID and data by turns)"
        _fault(told, parameters, 0, needs)
        return
    told.add(parameters[:width], f"address {address}")
    told.add(parameters[width : 2 * width], f"length {length}, of each servo's data")
    parts, ids = [], []
    for at in range(0, len(body), length + 1):
        ids.append(body[at])
        told.add(body[at : at + 1], f"servo {body[at]}")
        text = _data(told, body[at], address, body[at + 1 : at + 1 + length], tables)
        parts.append(f"servo {body[at]} {text}")
    told.what = "; ".join(parts)
    _once(told, ids)


def _bulk_read(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    lead = 1 if width == 1 else 0  # Protocol 1.0 has a 00 before the first item
    step = 3 if width == 1 else 5
    if len(parameters) < lead + step or (len(parameters) - lead) % step:
        items = "length, ID, address" if width == 1 else "ID, address, length"
        needs = f"it takes {lead + step} parameters or more ({items} by turns)"
        _fault(told, parameters, 0, needs)
        return
    told.add(parameters[:lead], "00, as the e-manual gives it")
    parts = []
    for at in range(lead, len(parameters), step):
        item = parameters[at : at + step]
        if width == 1:
            each, address, length = item[1], item[2], item[0]
        else:
            each, address, length = item[0], _number(item[1:3]), _number(item[3:5])
        text = span(tables.of(each), address, length)
        parts.append(f"servo {each} {text}")
        told.asked.append((each, address, length))
        names = _names(tables, each, address, length)
        told.add(item, f"servo {each}, address {address}, length {length}{names}")
    told.what = "; ".join(parts)
    _once(told, [each for each, _, _ in told.asked])


def _bulk_write(told: Told, servo_id: int, parameters: bytes, width: int, tables: Tables) -> None:
    parts: list[str] = []
    ids: list[int] = []
    at = 0
    while at < len(parameters) or not parts:
        address, length = _number(parameters[at + 1 : at + 3]), _number(parameters[at + 3 : at + 5])
        data = parameters[at + 5 : at + 5 + length]
        if length < 1 or len(data) < length:
            needs = f"it takes {at + 5 + max(1, length)} parameters (ID, address, length, data)"
            _fault(told, parameters, at, needs)
            return
        ids.append(parameters[at])
        words = f"servo {parameters[at]}, address {address}, length {length}"
        told.add(parameters[at : at + 5], words)
        text = _data(told, parameters[at], address, data, tables)
        parts.append(f"servo {parameters[at]} {text}")
        at += 5 + length
    told.what = "; ".join(parts)
    _once(told, ids)


def _once(told: Told, ids: list[int]) -> None:
    twice = sorted({each for each in ids if ids.count(each) > 1})
    if twice:
        told.notes.append(f"names servo {_ids(bytes(twice))} more than once")


def _names(tables: Tables, servo_id: int, address: int, length: int) -> str:
    table = tables.of(servo_id)
    return "" if table is None else f": {span(table, address, length)}"


def _ids(ids: bytes) -> str:
    """IDs in words, runs of neighbours as one: `1 to 18`, `3, 7, 4`."""
    if len(ids) > 2 and all(b - a == 1 for a, b in pairwise(ids)):
        return f"{ids[0]} to {ids[-1]}"
    return ", ".join(map(str, ids))


#: Whether Protocol 1.0 and 2.0 have the instruction, and how its parameters read.
_LAYOUTS: dict[Instruction, tuple[bool, bool, Callable[[Told, int, bytes, int, Tables], None]]] = {
    Instruction.PING: (True, True, _nothing),
    Instruction.READ: (True, True, _read),
    Instruction.WRITE: (True, True, _write),
    Instruction.REG_WRITE: (True, True, _write),
    Instruction.ACTION: (True, True, _nothing),
    Instruction.FACTORY_RESET: (True, True, _factory_reset),
    Instruction.REBOOT: (True, True, _nothing),
    Instruction.CLEAR: (False, True, _clear),
    Instruction.CONTROL_TABLE_BACKUP: (False, True, _backup),
    Instruction.SYNC_READ: (False, True, _sync_read),
    Instruction.SYNC_WRITE: (True, True, _sync_write),
    Instruction.USB2AX_SYNC_READ: (True, False, _sync_read),
    Instruction.FAST_SYNC_READ: (False, True, _sync_read),
    Instruction.BULK_READ: (True, True, _bulk_read),
    Instruction.BULK_WRITE: (False, True, _bulk_write),
    Instruction.FAST_BULK_READ: (False, True, _bulk_read),
}
