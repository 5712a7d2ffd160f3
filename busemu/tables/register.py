"""One register of a control table: where it lies, what it accepts, how it reads in SI."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .inherit import TableError
from .spelling import near

#: unit as written in a table -> (unit in SI, factor)
UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "": ("", 1.0),
        "deg": ("rad", math.pi / 180.0),
        "deg/s2": ("rad/s2", math.pi / 180.0),
        "rpm": ("rad/s", math.pi / 30.0),
        "rev/min2": ("rad/s2", math.pi / 1800.0),
        "percent": ("", 0.01),
        "V": ("V", 1.0),
        "A": ("A", 1.0),
        "mA": ("A", 1e-3),
        "degC": ("degC", 1.0),
        "us": ("s", 1e-6),
        "ms": ("s", 1e-3),
        "baud": ("baud", 1.0),
        "mV/ms": ("V/s", 1.0),
    }
)
ENCODINGS = ("unsigned", "signed", "sign_magnitude")
#: Bytes a register may have. Source: e-manual, control tables of all models.
SIZES = (1, 2, 4)
ACCESSES = ("R", "RW")
AREAS = ("EEPROM", "RAM")
#: Addresses from 0 on that a packet can name: two bytes. Source: e-manual, protocol2.
ADDRESSES = 1 << 16


@dataclass(frozen=True, slots=True)
class Register:
    """One register of a control table.

    ``raw`` values are the unsigned numbers on the wire. ``minimum`` and ``maximum`` bound what a
    write may put there, in the register's own *decoded* counts (signed registers may be negative);
    where ``allowed`` is not empty, only those counts. A servo whose firmware is older than
    ``since_firmware`` does not have the register. One that is ``stored`` is kept and read back, and
    the emulated servo moves no otherwise for it, though a real one does.
    In SI: ``value = (decoded - zero) * scale``, in :attr:`si_unit`.
    """

    name: str
    address: int
    size: int
    access: str = "RW"
    area: str = "RAM"
    initial: int | None = None
    minimum: int = 0
    maximum: int = 0
    unit: str = ""
    scale: float = 1.0
    zero: int = 0
    encoding: str = "unsigned"
    sign_bit: int = 10
    source: str = ""
    allowed: tuple[int, ...] = ()
    since_firmware: int = 0
    stored: bool = False

    @property
    def writable(self) -> bool:
        """Whether an instruction may change it."""
        return self.access == "RW"

    @property
    def raw_maximum(self) -> int:
        """The largest number its bytes can hold."""
        return (1 << (8 * self.size)) - 1

    @property
    def si_unit(self) -> str:
        """The unit of :meth:`to_si`."""
        return UNITS[self.unit][0]

    @property
    def si_scale(self) -> float:
        """SI units a count."""
        return self.scale * UNITS[self.unit][1]

    def accepts(self, count: int) -> bool:
        """Whether a write may put this decoded count there."""
        if self.allowed and count not in self.allowed:
            return False
        return self.minimum <= count <= self.maximum

    def decode(self, raw: int) -> int:
        """The signed count that ``raw`` stands for on the wire."""
        if self.encoding == "signed":
            sign = 1 << (8 * self.size - 1)
            return raw - ((raw & sign) << 1)
        if self.encoding == "sign_magnitude":
            sign = 1 << self.sign_bit
            magnitude = raw & (sign - 1)
            return -magnitude if raw & sign else magnitude
        return raw

    def encode(self, count: int) -> int:
        """The raw number for a signed count; ``ValueError`` if it does not fit in the bytes."""
        if self.encoding == "sign_magnitude":
            sign = 1 << self.sign_bit
            if abs(count) >= sign:
                raise ValueError(f"{self.name}: {count} does not fit in {self.sign_bit} bits")
            return sign | -count if count < 0 else count
        raw = count & self.raw_maximum if self.encoding == "signed" else count
        if not 0 <= raw <= self.raw_maximum or self.decode(raw) != count:
            raise ValueError(f"{self.name}: {count} does not fit in {self.size} byte(s)")
        return raw

    def to_si(self, raw: int) -> float:
        """``raw`` in SI."""
        return (self.decode(raw) - self.zero) * self.si_scale

    def from_si(self, value: float) -> int:
        """The raw number nearest to ``value`` [SI]: rounded, then checked, never clipped.

        Raises ``ValueError`` with the register, the value and the bounds where it is out of range.
        """
        count = round(value / self.si_scale) + self.zero
        if not self.minimum <= count <= self.maximum:
            low = (self.minimum - self.zero) * self.si_scale
            high = (self.maximum - self.zero) * self.si_scale
            raise ValueError(
                f"{self.name}: {value:.6g} {self.si_unit} is outside [{low:.6g}, {high:.6g}]"
            )
        return self.encode(count)


def registers_of_row(row: Mapping[str, Any], path: Path) -> Iterator[Register]:
    """The register of a row; for a row with ``count``, ``name_1``, ``name_2`` and so on.

    ``first`` is the first number; ``initial_step`` is added to ``initial`` from one to the next.
    """
    row = dict(row)
    count, first = row.pop("count", None), row.pop("first", 1)
    step = row.pop("initial_step", 0)
    if count is None:
        yield _register(row, path)
        return
    if not isinstance(count, int) or count < 1:
        raise TableError(f"{path}: register {row.get('name', '?')!r}: count must be 1 or more")
    base = _register(row, path)
    if base.address + count * base.size > ADDRESSES:
        raise TableError(f"{path}: register {base.name!r}: count {count} goes beyond 65535")
    for index in range(count):
        numbered = {
            **row,
            "name": f"{base.name.removesuffix('_')}_{first + index}",
            "address": base.address + index * base.size,
        }
        if base.initial is not None:
            numbered["initial"] = base.initial + index * step
        yield _register(numbered, path)


def _register(row: Mapping[str, Any], path: Path) -> Register:
    where = f"{path}: register {row.get('name', '?')!r}"
    row = dict(row)
    known = {field.name for field in fields(Register)} - {"minimum", "maximum"} | {"range"}
    unknown = sorted(set(row) - known)
    missing = {"name", "address", "size"} - set(row)
    if missing:
        raise TableError(f"{where}: needs {', '.join(sorted(missing))}")
    if unknown:
        words = ", ".join(key + near(key, known) for key in unknown)
        raise TableError(f"{where}: unknown key {words}")
    if row["size"] not in SIZES:
        raise TableError(f"{where}: size must be 1, 2 or 4 bytes, not {row['size']!r}")
    if not isinstance(row["address"], int) or not 0 <= row["address"] <= ADDRESSES - row["size"]:
        raise TableError(f"{where}: address must be 0 or more, and its last byte at most at 65535")
    low, high = _range(row, where)
    row["allowed"] = tuple(row.get("allowed", ()))
    register = Register(minimum=low, maximum=high, **row)
    for value, choices, what in (
        (register.access, ACCESSES, "access"),
        (register.area, AREAS, "area"),
        (register.unit, tuple(UNITS), "unit"),
        (register.encoding, ENCODINGS, "encoding"),
    ):
        if value not in choices:
            words = ", ".join(filter(None, choices))
            raise TableError(f"{where}: {what} {value!r} is not one of {words}")
    if not (isinstance(register.scale, int | float) and register.scale > 0.0):
        raise TableError(f"{where}: scale must be more than 0, not {register.scale!r}")
    if register.initial is not None:
        if not 0 <= register.initial <= register.raw_maximum:
            raise TableError(f"{where}: initial {register.initial} does not fit in its bytes")
        if not register.accepts(register.decode(register.initial)):
            raise TableError(f"{where}: initial {register.initial} is outside what it accepts")
    return register


def _range(row: dict[str, Any], where: str) -> tuple[int, int]:
    """Take ``range`` out of a row; by default all that the bytes hold."""
    top = (1 << (8 * row["size"])) - 1
    bottom = 0
    if row.get("encoding") == "signed":
        top >>= 1
        bottom = -top - 1
    elif row.get("encoding") == "sign_magnitude":
        bottom = -top
    bounds = row.pop("range", [bottom, top])
    if len(bounds) != 2 or not all(isinstance(bound, int) for bound in bounds):
        raise TableError(f"{where}: range must be two whole numbers, not {bounds}")
    low, high = bounds
    if low > high:
        raise TableError(f"{where}: range {low} to {high} is empty")
    if low < bottom or high > top:
        raise TableError(f"{where}: range {low} to {high} does not fit in {row['size']} byte(s)")
    return low, high
