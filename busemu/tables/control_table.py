"""Control tables as data: one TOML file a servo model, under ``busemu/tables/servos/``.

A register is described once, in the e-manual's words, and everything else follows from it: which
bytes a write may touch, what a factory reset restores, and how a raw value reads in SI.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

SERVOS = Path(__file__).with_name("servos")


class TableError(ValueError):
    """A control table that cannot be used: says the file, the register, the rule."""


#: unit as written in a table -> (unit in SI, factor)
UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "": ("", 1.0),
        "deg": ("rad", math.pi / 180.0),
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
    }
)
ENCODINGS = ("unsigned", "signed", "sign_magnitude")
ACCESSES = ("R", "RW")
AREAS = ("EEPROM", "RAM")


@dataclass(frozen=True, slots=True)
class Register:
    """One register of a control table.

    ``raw`` values are the unsigned numbers on the wire. ``minimum`` and ``maximum`` bound what a
    write may put there, in the register's own *decoded* counts (signed registers may be negative).
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


@dataclass(frozen=True)
class ControlTable:
    """The registers of one servo model, and what a servo of that model does by itself.

    ``drive`` holds how registers become a drive's numbers in SI, each with its source
    (see ``docs/reference/tables.md``).
    """

    model: str
    model_number: int
    protocol: float
    registers: tuple[Register, ...]
    baud_rates: Mapping[int, int]  #: value of the ``baud_rate`` register -> bits a second
    drive: Mapping[str, Any]
    source: str
    path: Path

    @cached_property
    def by_name(self) -> Mapping[str, Register]:
        """Registers by name."""
        return MappingProxyType({r.name: r for r in self.registers})

    @cached_property
    def size(self) -> int:
        """Bytes from address 0 to the end of the last register."""
        return max(r.address + r.size for r in self.registers)

    def __getitem__(self, name: str) -> Register:
        try:
            return self.by_name[name]
        except KeyError:
            raise KeyError(f"{self.model} has no register {name!r}") from None

    def __contains__(self, name: object) -> bool:
        return name in self.by_name


def models() -> tuple[str, ...]:
    """Names of the servo models that have a table, sorted."""
    return tuple(sorted(_read(path)["model"] for path in SERVOS.glob("*.toml")))


@lru_cache
def load_table(model: str) -> ControlTable:
    """The control table of a model by its name (``"AX-12A"``), or of a TOML file by its path."""
    path = Path(model)
    if path.suffix != ".toml":
        path = SERVOS / f"{model.lower()}.toml"
    if not path.is_file():
        known = ", ".join(models())
        raise TableError(f"no control table for servo model {model!r}: known are {known}")
    return parse_table(_read(path), path)


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise TableError(f"{path}: not TOML: {error}") from None


def parse_table(document: Mapping[str, Any], path: Path) -> ControlTable:
    """Check a table document and make a :class:`ControlTable` of it.

    Raises :class:`TableError` naming the file, the register and the rule that is broken.
    """
    missing = {"model", "model_number", "protocol", "register", "baud_rates"} - set(document)
    if missing:
        raise TableError(f"{path}: missing {', '.join(sorted(missing))}")
    registers = tuple(
        sorted((_register(row, path) for row in document["register"]), key=lambda r: r.address)
    )
    seen: dict[str, Register] = {}
    end, before = 0, ""
    for register in registers:
        if register.name in seen:
            raise TableError(f"{path}: register {register.name!r} is there twice")
        if register.address < end:
            raise TableError(f"{path}: {register.name!r} overlaps {before!r}")
        seen[register.name] = register
        end, before = register.address + register.size, register.name
    return ControlTable(
        model=document["model"],
        model_number=document["model_number"],
        protocol=float(document["protocol"]),
        registers=registers,
        baud_rates=MappingProxyType({int(k): v for k, v in document["baud_rates"].items()}),
        drive=MappingProxyType(dict(document.get("drive", {}))),
        source=document.get("source", ""),
        path=path,
    )


def _register(row: Mapping[str, Any], path: Path) -> Register:
    where = f"{path}: register {row.get('name', '?')!r}"
    row = dict(row)
    low, high = row.pop("range", (None, None))
    if not isinstance(row.get("size"), int) or not 1 <= row["size"] <= 256:
        raise TableError(f"{where}: size must be 1 to 256 bytes")
    top = (1 << (8 * row["size"])) - 1
    try:
        register = Register(
            minimum=0 if low is None else low, maximum=top if high is None else high, **row
        )
    except TypeError as error:
        raise TableError(f"{where}: {error}") from None
    for value, allowed, what in (
        (register.access, ACCESSES, "access"),
        (register.area, AREAS, "area"),
        (register.unit, tuple(UNITS), "unit"),
        (register.encoding, ENCODINGS, "encoding"),
    ):
        if value not in allowed:
            raise TableError(f"{where}: {what} {value!r} is not one of {', '.join(allowed)}")
    if register.minimum > register.maximum:
        raise TableError(f"{where}: range {register.minimum} to {register.maximum} is empty")
    if register.initial is not None and not 0 <= register.initial <= register.raw_maximum:
        raise TableError(f"{where}: initial {register.initial} does not fit in its bytes")
    return register
