"""Numbers of a robot file, each with its provenance.

A physical number stands in the file as ``key = { value = 0.029, source = "thesis" }``. This module
reads such entries and refuses, with one line that names the file, the entry, the value, the unit
and the bounds, whatever is missing or cannot be true.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busemu.tables import RobotError
from busemu.tables.spelling import near


class PhysicsError(RobotError):
    """A robot file whose physical part cannot be used: says the file, the entry and the bounds."""


@dataclass(frozen=True, slots=True)
class Section:
    """One table of a robot file and the way to it, as error messages name it."""

    path: Path
    name: str
    table: Mapping[str, Any]

    def fail(self, problem: str) -> PhysicsError:
        """The error to raise for this section."""
        where = f" [{self.name}]" if self.name else ""
        return PhysicsError(f"{self.path}:{where} {problem}")

    def section(self, key: str) -> Section:
        """The table under ``key``; :class:`PhysicsError` when it is missing."""
        name = f"{self.name}.{key}" if self.name else key
        table = self.table.get(key)
        if not isinstance(table, Mapping):
            raise PhysicsError(f"{self.path}: needs a section [{name}]")
        return Section(self.path, name, table)

    def sections(self, key: str) -> tuple[Section, ...]:
        """The array of tables under ``key``; at least one must be there."""
        name = f"{self.name}.{key}" if self.name else key
        rows = self.table.get(key)
        if not isinstance(rows, list) or not rows:
            raise PhysicsError(f"{self.path}: needs at least one [[{name}]]")
        return tuple(Section(self.path, f"{name}][{i}", row) for i, row in enumerate(rows))

    def __contains__(self, key: str) -> bool:
        return key in self.table

    def number(
        self,
        key: str,
        unit: str,
        low: float,
        high: float,
        default: float | None = None,
    ) -> float:
        """A number with provenance, ``low <= value <= high`` in ``unit``.

        Raises :class:`PhysicsError` when it is missing (and no default is given), has no source,
        is not a number, or is out of bounds.
        """
        if key not in self.table and default is not None:
            return default
        self.deviation(key)
        return self._bounded(key, self._value(key), unit, low, high)

    def deviation(self, key: str) -> float | None:
        """How sure the file is of a number: its relative standard deviation, if it tells.

        Raises :class:`PhysicsError` for one that is not within 0.001 to 10.
        """
        entry = self.table.get(key)
        if not isinstance(entry, Mapping) or "deviation" not in entry:
            return None
        return self._bounded(f"{key} deviation", entry["deviation"], "(ratio)", 0.001, 10.0)

    def numbers(
        self, key: str, unit: str, count: int, low: float, high: float
    ) -> tuple[float, ...]:
        """A list of exactly ``count`` numbers that share a provenance, each within the bounds."""
        values = self._value(key)
        if not isinstance(values, list) or len(values) != count:
            raise self.fail(f"{key}: needs a list of {count} numbers in {unit}, got {values!r}")
        return tuple(self._bounded(key, value, unit, low, high) for value in values)

    def plain(self, key: str, unit: str, low: float, high: float) -> float:
        """A number without provenance of its own (a comment above its section gives it)."""
        if key not in self.table:
            raise self.fail(f"needs {key} in {unit}")
        return self._bounded(key, self.table[key], unit, low, high)

    def plains(self, key: str, unit: str, count: int, low: float, high: float) -> tuple[float, ...]:
        """A list of exactly ``count`` numbers without provenance, each within the bounds."""
        values = self.table.get(key)
        if not isinstance(values, list) or len(values) != count:
            raise self.fail(f"{key}: needs a list of {count} numbers in {unit}, got {values!r}")
        return tuple(self._bounded(key, value, unit, low, high) for value in values)

    def word(self, key: str, allowed: tuple[str, ...] = ()) -> str:
        """A text entry, one of ``allowed`` when that is given."""
        word = self.table.get(key)
        if not isinstance(word, str) or (allowed and word not in allowed):
            rule = f"one of {', '.join(allowed)}" if allowed else "a text"
            raise self.fail(f"{key} must be {rule}, not {word!r}")
        return word

    def only(self, *keys: str) -> None:
        """Refuse entries under any other key: a misspelt key must not be ignored."""
        unknown = sorted(set(self.table) - set(keys))
        if unknown:
            meant = near(unknown[0], keys)
            raise self.fail(f"unknown key {', '.join(unknown)}{meant}; known are {', '.join(keys)}")

    def _value(self, key: str) -> Any:
        entry = self.table.get(key)
        if entry is None:
            raise self.fail(f"needs {key} = {{ value = ..., source = ... }}")
        if not isinstance(entry, Mapping) or set(entry) - {"deviation"} != {"value", "source"}:
            raise self.fail(f"{key} must be {{ value = ..., source = ... }}, not {entry!r}")
        if not isinstance(entry["source"], str) or not entry["source"].strip():
            raise self.fail(f"{key} needs a source: a document, or assumed")
        return entry["value"]

    def _bounded(self, key: str, value: Any, unit: str, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.fail(f"{key} must be a number in {unit}, not {value!r}")
        if not low <= value <= high:
            raise self.fail(f"{key} = {value!s:.40} {unit} is not within {low} to {high} {unit}")
        return float(value)
