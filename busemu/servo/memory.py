"""A servo's registers as bytes, and the rules that guard them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ..tables import ControlTable, Register
from .status import Refusal

#: Puts a measured value [SI] into one register.
Gauge = Callable[[float], None]
#: The places of reads and writes that one servo keeps in mind.
MOST_PLACES = 64


class Memory:
    """The control table of one servo, as the bytes it holds.

    A write is checked whole before any byte of it is stored, so a refused write changes nothing.
    Reserved addresses between registers read as 0 and swallow writes; so do registers that the
    servo's firmware (``firmware_version``, by default the table's) is too old for.
    """

    def __init__(self, table: ControlTable, firmware_version: int | None = None) -> None:
        self.table = table
        firmware = table.firmware_version if firmware_version is None else firmware_version
        self._there = {r.name for r in table.registers if r.since_firmware <= firmware}
        self._bytes = bytearray(table.size)
        self._places = {r.name: slice(r.address, r.address + r.size) for r in table.registers}
        self._to_si = {r.name: r.to_si for r in table.registers}
        self._gauges: dict[str, Gauge] = {}
        self._found: dict[tuple[int, int], tuple[Register, ...]] = {}
        self._at: list[Register | None] = [None] * table.size
        for register in table.registers:
            if register.name in self._there:
                for address in range(register.address, register.address + register.size):
                    self._at[address] = register
        self.reset(table.registers)
        if firmware_version is not None:
            self["firmware_version"] = firmware_version

    def has(self, name: str) -> bool:
        """Whether this servo has a register, at its firmware."""
        return name in self._there

    def writable(self, area: str) -> list[Register]:
        """The registers of an area that this servo has and an instruction may change."""
        return [
            register
            for register in self.table.registers
            if register.area == area and register.writable and register.name in self._there
        ]

    def reset(self, registers: Iterable[Register]) -> None:
        """Put initial values into ``registers``; those without one become 0."""
        for register in registers:
            if register.name in self._there:
                self[register.name] = register.initial or 0

    def __getitem__(self, name: str) -> int:
        return int.from_bytes(self._bytes[self._places[name]], "little")

    def __setitem__(self, name: str, raw: int) -> None:
        place = self._places[name]
        self._bytes[place] = raw.to_bytes(place.stop - place.start, "little")

    def count(self, name: str) -> int:
        """A register's decoded count: negative where its encoding says so."""
        return self.table[name].decode(self[name])

    def put(self, name: str, count: int) -> None:
        """Set a register to a decoded count."""
        self[name] = self.table[name].encode(count)

    def clip(self, name: str, count: int) -> None:
        """Set a register to a decoded count, or to the end of its range where that is nearer."""
        register = self.table[name]
        self[name] = register.encode(max(register.minimum, min(register.maximum, count)))

    def show(self, name: str, value: float) -> None:
        """Set a register to a measured value [SI]; a sensor beyond its range reads its end."""
        gauge = self._gauges.get(name)
        if gauge is None:
            gauge = self._gauges[name] = self.gauge(name)
        gauge(value)

    def gauge(self, name: str) -> Gauge:
        """What :meth:`show` does to one register, for who does it often."""
        register = self.table[name]
        scale, zero, encode = register.si_scale, register.zero, register.encode
        low, high, size = register.minimum, register.maximum, register.size
        held, start, end = self._bytes, register.address, register.address + register.size
        plain = register.encoding == "unsigned"
        mask = register.raw_maximum if register.encoding == "signed" else 0

        def show(value: float) -> None:
            count = round(value / scale) + zero
            if count < low:
                count = low
            elif count > high:
                count = high
            if mask:
                count &= mask
            elif not plain:
                count = encode(count)
            held[start:end] = count.to_bytes(size, "little")

        return show

    def si(self, name: str) -> float:
        """A register's value in SI."""
        return self._to_si[name](self[name])

    def covers(self, address: int, length: int) -> bool:
        """Whether all of the addresses exist."""
        return length > 0 and address + length <= len(self._bytes)

    def read(self, address: int, length: int) -> bytes:
        """The bytes at an address; the caller has made sure that they exist."""
        return bytes(self._bytes[address : address + length])

    def registers(self, address: int, length: int) -> tuple[Register, ...]:
        """The registers that any of the addresses belong to, in order."""
        found = self._found.get((address, length))
        if found is None:
            if len(self._found) >= MOST_PLACES:
                self._found.clear()
            there = self._at[address : address + length]
            found = tuple(dict.fromkeys(register for register in there if register is not None))
            self._found[address, length] = found
        return found

    def check(self, address: int, data: bytes) -> Refusal | None:
        """Whether the write would break a rule of the table: existence, access, range."""
        if not self.covers(address, len(data)):
            return Refusal.ACCESS
        touched = self.registers(address, len(data))
        if not touched or not all(register.writable for register in touched):
            return Refusal.ACCESS
        for register in touched:
            if not register.accepts(register.decode(self.after(register, address, data))):
                return Refusal.RANGE
        return None

    def after(self, register: Register, address: int, data: bytes) -> int:
        """The raw value that a register would have after the write."""
        start = register.address - address
        if 0 <= start <= len(data) - register.size:
            return int.from_bytes(data[start : start + register.size], "little")
        held = bytearray(self.read(register.address, register.size))
        for offset in range(register.size):
            index = register.address + offset - address
            if 0 <= index < len(data):
                held[offset] = data[index]
        return int.from_bytes(held, "little")

    def eeprom_bytes(self, runs: Iterable[tuple[int, bytes]]) -> int:
        """How many bytes of writes, each an address and its data, lie in the EEPROM area."""
        return sum(
            (register := self._at[at]) is not None and register.area == "EEPROM"
            for address, data in runs
            for at in range(address, address + len(data))
        )

    def store(self, address: int, data: bytes) -> None:
        """Store a checked write."""
        for offset, value in enumerate(data):
            if self._at[address + offset] is not None:
                self._bytes[address + offset] = value


def baud_rate_code(table: ControlTable, baud_rate: int) -> int:
    """The value of the ``baud_rate`` register for a baud rate; ``ValueError`` if there is none."""
    for code, rate in table.baud_rates.items():
        if rate == baud_rate:
            return code
    known = ", ".join(str(rate) for rate in table.baud_rates.values())
    raise ValueError(f"{table.model} cannot be set to {baud_rate} baud; it knows {known}")
