"""Control tables as data: one TOML file a servo model, under ``busemu/tables/servos/``.

A register is described once, in the e-manual's words, and everything else follows from it: which
bytes a write may touch, what a factory reset restores, and how a raw value reads in SI. A table may
extend another (:mod:`busemu.tables.inherit`); a row with ``count`` stands for a numbered series.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .inherit import SERVOS, TableError, file_name, resolve
from .needs import LAWS, cramped, lacking
from .register import Register, registers_of_row
from .shape import check_shape
from .spelling import near
from .toml_file import read_toml

__all__ = ["ControlTable", "TableError", "load_table", "models", "parse_table"]

#: Instructions that a model takes if its table does not say, by protocol. Source: e-manual,
#: protocol1 and protocol2. Bulk read of Protocol 1.0 is for the MX series only.
_INSTRUCTIONS_1 = ("ping", "read", "write", "reg_write", "action", "factory_reset", "sync_write")
_INSTRUCTIONS_2 = (*_INSTRUCTIONS_1, "reboot", "sync_read", "bulk_read", "bulk_write")
INSTRUCTIONS: Mapping[float, tuple[str, ...]] = MappingProxyType(
    {1.0: _INSTRUCTIONS_1, 2.0: _INSTRUCTIONS_2}
)
#: Every instruction a table may name.
KNOWN_INSTRUCTIONS = frozenset(
    {*_INSTRUCTIONS_2, "clear", "control_table_backup", "fast_sync_read", "fast_bulk_read"}
)
_KEYS = frozenset({"model", "model_number", "protocol", "source", "register", "baud_rates"})
_OPTIONAL = frozenset({"drive", "instructions"})
_MERGING = frozenset({"extends", "remove"})


@dataclass(frozen=True)
class ControlTable:
    """The registers of one servo model, and what a servo of that model does by itself.

    ``drive`` holds how registers become a drive's numbers in SI, each with its source
    (see ``docs/reference/tables.md``). ``instructions`` are the instructions it takes, each with
    the firmware that brought it (0: always there).
    """

    model: str
    model_number: int
    protocol: float
    registers: tuple[Register, ...]
    baud_rates: Mapping[int, int]  #: value of the ``baud_rate`` register -> bits a second
    drive: Mapping[str, Any]
    source: str
    path: Path
    instructions: Mapping[str, int]

    @cached_property
    def by_name(self) -> Mapping[str, Register]:
        """Registers by name."""
        return MappingProxyType({r.name: r for r in self.registers})

    @cached_property
    def size(self) -> int:
        """Bytes from address 0 to the end of the last register."""
        return max(r.address + r.size for r in self.registers)

    @cached_property
    def firmware_version(self) -> int:
        """The firmware version a servo has if nothing else is said."""
        register = self.by_name.get("firmware_version")
        return 0 if register is None else register.initial or 0

    def supports(self, instruction: str, firmware_version: int | None = None) -> bool:
        """Whether a servo takes an instruction (``"sync_read"``); by default at its firmware."""
        since = self.instructions.get(instruction)
        firmware = self.firmware_version if firmware_version is None else firmware_version
        return since is not None and firmware >= since

    def __getitem__(self, name: str) -> Register:
        try:
            return self.by_name[name]
        except KeyError:
            raise KeyError(f"{self.model} has no register {name!r}") from None

    def __contains__(self, name: object) -> bool:
        return name in self.by_name


def models() -> tuple[str, ...]:
    """Names of the servo models that have a table, sorted."""
    documents = (read_toml(path, TableError) for path in SERVOS.glob("*.toml"))
    return tuple(sorted(document["model"] for document in documents if "model" in document))


@lru_cache
def load_table(model: str) -> ControlTable:
    """The control table of a model by its name (``"AX-12A"``), or of a TOML file by its path."""
    path = Path(model)
    if path.suffix == ".toml":
        return parse_table(read_toml(path, TableError), path)
    path = SERVOS / file_name(model)
    document = read_toml(path, TableError) if path.is_file() else {}
    if "model" not in document:
        raise TableError(
            f"no control table for servo model {model!r}: known are {', '.join(models())}; "
            "or give the path of a table ending in .toml"
        )
    return parse_table(document, path)


def parse_table(document: Mapping[str, Any], path: Path) -> ControlTable:
    """Check a table document and make a :class:`ControlTable` of it.

    Raises :class:`TableError` naming the file, the register and the rule that is broken.
    """
    document = resolve(document, path)
    missing = _KEYS - {"source"} - set(document)
    if missing:
        raise TableError(f"{path}: missing {', '.join(sorted(missing))}")
    unknown = set(document) - _KEYS - _OPTIONAL
    if unknown:
        words = (key + near(key, _KEYS | _OPTIONAL | _MERGING) for key in sorted(unknown))
        raise TableError(f"{path}: unknown key {', '.join(words)}")
    check_shape(document, path)
    protocol = document["protocol"]
    if protocol not in INSTRUCTIONS:
        raise TableError(f"{path}: protocol must be 1.0 or 2.0, not {protocol!r}")
    registers = tuple(
        sorted(
            (register for row in document["register"] for register in registers_of_row(row, path)),
            key=lambda r: r.address,
        )
    )
    number = document["model_number"]
    seen: dict[str, Register] = {}
    end, before = 0, ""
    for register in registers:
        if register.name in seen:
            raise TableError(f"{path}: register {register.name!r} is there twice")
        if register.address < end:
            raise TableError(f"{path}: {register.name!r} overlaps {before!r}")
        seen[register.name] = register
        end, before = register.address + register.size, register.name
    if not 0 <= number <= 0xFFFF:
        raise TableError(f"{path}: model_number must be 0 to 65535, what a ping can tell")
    if "model_number" in seen and seen["model_number"].initial != number:
        raise TableError(
            f"{path}: model_number is {number!r}, but the register of that name starts with "
            f"{seen['model_number'].initial}: leave its initial out, or say the same"
        )
    return ControlTable(
        model=document["model"],
        model_number=number,
        protocol=float(protocol),
        registers=registers,
        baud_rates=_baud_rates(document["baud_rates"], path),
        drive=MappingProxyType(_drive(document.get("drive", {}), seen, path)),
        source=document.get("source", ""),
        path=path,
        instructions=_instructions(document.get("instructions"), float(protocol), path),
    )


def _baud_rates(rows: Mapping[str, Any], path: Path) -> Mapping[int, int]:
    for code, rate in rows.items():
        if not code.isdecimal() or type(rate) is not int or rate <= 0:
            raise TableError(f"{path}: baud_rates: {code} = {rate}: a value and bits a second")
    return MappingProxyType({int(code): rate for code, rate in rows.items()})


def _instructions(rows: Mapping[str, Any] | None, protocol: float, path: Path) -> Mapping[str, int]:
    if rows is None:
        return MappingProxyType(dict.fromkeys(INSTRUCTIONS[protocol], 0))
    for name, since in rows.items():
        if name not in KNOWN_INSTRUCTIONS:
            known = ", ".join(sorted(KNOWN_INSTRUCTIONS))
            raise TableError(f"{path}: instructions: {name!r} is not one of {known}")
        if since is not False and (since is True or not isinstance(since, int) or since < 0):
            raise TableError(
                f"{path}: instructions: {name} = {since!r}: the firmware that brought it, "
                "0 for always, or false"
            )
    return MappingProxyType({name: since for name, since in rows.items() if since is not False})


def _drive(
    drive: Mapping[str, Any], registers: Mapping[str, Register], path: Path
) -> dict[str, Any]:
    if not drive:
        return {}
    law = str(drive.get("law"))
    if law not in LAWS:
        raise TableError(f"{path}: drive: law {law!r} is not one of {', '.join(LAWS)}")
    missing = {"eeprom_locked_by", "shutdown_cuts", *LAWS[law]} - set(drive)
    if missing:
        raise TableError(f"{path}: drive: missing {', '.join(sorted(missing))}")
    for key in ("eeprom_locked_by", "shutdown_cuts"):
        if drive[key] not in registers:
            raise TableError(f"{path}: drive: {key} names no register: {drive[key]!r}")
    absent = lacking(law, drive, registers)
    if absent:
        raise TableError(
            f"{path}: a servo of law {law!r} needs these registers, too: {', '.join(absent)}"
        )
    for problem in cramped(law, registers):
        raise TableError(f"{path}: register {problem}: give it more (size)")
    return dict(drive)
