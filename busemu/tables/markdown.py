"""A control table as Markdown, for the command line and the reference pages."""

from __future__ import annotations

from collections.abc import Iterable

from .control_table import ControlTable
from .register import Register

HEADER = ("Address", "Size", "Name", "Access", "Initial", "Range", "Unit", "Encoding", "Firmware")


def table_markdown(table: ControlTable) -> str:
    """The whole table: what it is of, EEPROM and RAM area, baud rates, instructions.

    A numbered series (``indirect_data_1`` to ``_28``) is one line. Ranges and initial values are
    decoded counts; the unit is what one count stands for, in SI. Ends with a line break.
    """
    lines = [
        f"# {table.model}",
        "",
        f"Model number {table.model_number}, Protocol {table.protocol}. Source: {table.source}.",
    ]
    for area in ("EEPROM", "RAM"):
        registers = [register for register in table.registers if register.area == area]
        lines += ["", f"## {area} area", "", *_rows(HEADER, map(_cells, _series(registers)))]
    rates = ((str(code), str(rate)) for code, rate in sorted(table.baud_rates.items()))
    lines += ["", "## Baud rates", "", *_rows(("Value", "bit/s"), rates)]
    instructions = (
        (name, "always" if not since else f"firmware {since}")
        for name, since in table.instructions.items()
    )
    lines += ["", "## Instructions", "", *_rows(("Instruction", "Since"), instructions)]
    return "\n".join(lines) + "\n"


def _rows(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    return [
        "| " + " | ".join(cells) + " |" for cells in (header, tuple("---" for _ in header), *rows)
    ]


def _series(registers: Iterable[Register]) -> list[list[Register]]:
    """Registers, those of a long numbered series together."""
    found: list[list[Register]] = []
    for register in registers:
        last = found[-1][-1] if found else None
        if last is not None and _follows(last, register):
            found[-1].append(register)
        else:
            found.append([register])
    return [part for run in found for part in ([run] if len(run) > 3 else [[r] for r in run])]


def _follows(before: Register, after: Register) -> bool:
    stem, _, number = before.name.rpartition("_")
    if not number.isdecimal() or after.name != f"{stem}_{int(number) + 1}":
        return False
    return after.address == before.address + before.size and after.size == before.size


def _cells(series: list[Register]) -> tuple[str, ...]:
    first, last = series[0], series[-1]
    return (
        _span(first.address, last.address),
        str(first.size),
        f"`{first.name}`" if first is last else f"`{first.name}` to `{last.name}`",
        first.access,
        _span(_initial(first), _initial(last)),
        _range(first),
        _unit(first),
        first.encoding.replace("_", " "),
        str(first.since_firmware) if first.since_firmware else "",
    )


def _span(first: object, last: object) -> str:
    return str(first) if first == last else f"{first} to {last}"


def _initial(register: Register) -> str:
    return "" if register.initial is None else str(register.decode(register.initial))


def _range(register: Register) -> str:
    if register.allowed:
        return ", ".join(map(str, register.allowed))
    return f"{register.minimum} to {register.maximum}"


def _unit(register: Register) -> str:
    if not register.unit and register.scale == 1.0:
        return ""
    text = f"{register.si_scale:.6g} {register.si_unit}".strip()
    return f"{text}, 0 at {register.zero}" if register.zero else text
