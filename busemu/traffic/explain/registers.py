"""Addresses and data as registers by name and values in SI, where the control table is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...tables import ControlTable, Register
from ...wording import amount

#: More registers than this are named by the first and the last only.
NAMES_LIMIT = 4
#: The `baud_rate` register says a number of its own for each rate.
_BAUD_RATE = "baud_rate"


@dataclass(frozen=True, slots=True)
class Tables:
    """The control table of each servo: by its ID, else `default`, else unknown."""

    by_id: Mapping[int, ControlTable] = field(default_factory=dict)
    default: ControlTable | None = None

    def of(self, servo_id: int) -> ControlTable | None:
        """The table of a servo, None where it is not known."""
        return self.by_id.get(servo_id, self.default)


@dataclass(frozen=True, slots=True)
class Value:
    """What a packet says of one register of one servo.

    `raw` is the unsigned number on the wire. `name` and `text` are as for reading: without a
    control table the name is the address and the text the number. `note` says why a write of it
    will be refused, or is empty.
    """

    servo_id: int
    address: int
    data: bytes
    name: str
    text: str
    note: str = ""

    @property
    def raw(self) -> int:
        """The number on the wire."""
        return int.from_bytes(self.data, "little")

    def __str__(self) -> str:
        return f"{self.name} = {self.text}"


def span(table: ControlTable | None, address: int, length: int) -> str:
    """What lies at `length` bytes from `address`, in words."""
    where = f"address {address}, {amount(length, 'byte')}"
    if table is None:
        return where
    inside = [r for r in table.registers if r.address < address + length and _end(r) > address]
    if not inside:
        return f"{where}: no register of {table.model}"
    names = [
        r.name if address <= r.address and _end(r) <= address + length else f"a part of {r.name}"
        for r in inside
    ]
    if len(names) > NAMES_LIMIT:
        return f"{names[0]} to {names[-1]}, {len(names)} registers"
    return ", ".join(names)


def values(
    table: ControlTable | None, servo_id: int, address: int, data: bytes, *, write: bool = False
) -> list[Value]:
    """`data` at `address`, register by register; bytes that are no whole register by themselves."""
    found: list[Value] = []
    at, end = address, address + len(data)
    for register in table.registers if table is not None else ():
        if register.address < at or _end(register) > end:
            continue
        if register.address > at:
            found.append(_loose(servo_id, at, data[at - address : register.address - address]))
        piece = data[register.address - address : _end(register) - address]
        text = value_text(register, int.from_bytes(piece, "little"), table)
        note = _refusal(register, int.from_bytes(piece, "little")) if write else ""
        found.append(Value(servo_id, register.address, piece, register.name, text, note))
        at = _end(register)
    if at < end:
        found.append(_loose(servo_id, at, data[at - address :]))
    return found


def value_text(register: Register, raw: int, table: ControlTable | None = None) -> str:
    """A raw value as its count and, where it has a unit, in SI: `512 (2.618 rad)`."""
    count = register.decode(raw)
    if register.name == _BAUD_RATE and table is not None and raw in table.baud_rates:
        return f"{count} ({table.baud_rates[raw]} bit/s)"
    if not register.si_unit and register.scale == 1.0:
        return str(count)
    return f"{count} ({register.to_si(raw) + 0.0:.4g} {register.si_unit}".rstrip() + ")"


def _end(register: Register) -> int:
    return register.address + register.size


def _refusal(register: Register, raw: int) -> str:
    if not register.writable:
        return f"{register.name} is read-only"
    count = register.decode(raw)
    if not register.accepts(count):
        return f"{register.name} takes {register.minimum} to {register.maximum}, not {count}"
    return ""


def _loose(servo_id: int, address: int, data: bytes) -> Value:
    number = int.from_bytes(data, "little")
    text = str(number) if len(data) in (1, 2, 4) else data.hex(" ").upper()
    return Value(servo_id, address, data, f"address {address}", text)
