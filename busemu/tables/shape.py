"""What kind of value stands where in the document of a control table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .inherit import TableError


def _whole(value: Any) -> bool:
    return type(value) is int


def _number(value: Any) -> bool:
    return type(value) in (int, float) and not math.isnan(value)


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _truth(value: Any) -> bool:
    return isinstance(value, bool)


def _table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _bits(value: Any) -> bool:
    return _table(value) and all(map(_whole, value.values()))


def _wholes(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(map(_whole, value))


Rule = tuple[Callable[[Any], bool], str]
WHOLE: Rule = (_whole, "a whole number")
NUMBER: Rule = (_number, "a number")
TEXT: Rule = (_text, "text in quotes")
TRUTH: Rule = (_truth, "true or false")
TABLE: Rule = (_table, "a table of names and values")
WHOLES: Rule = (_wholes, "a list of whole numbers")

DOCUMENT: Mapping[str, Rule] = MappingProxyType(
    {
        "model": TEXT,
        "model_number": WHOLE,
        "protocol": NUMBER,
        "source": TEXT,
        "baud_rates": TABLE,
        "drive": TABLE,
        "instructions": TABLE,
    }
)
REGISTER: Mapping[str, Rule] = MappingProxyType(
    {
        **dict.fromkeys(
            ("address", "size", "initial", "zero", "sign_bit", "since_firmware"), WHOLE
        ),
        **dict.fromkeys(("count", "first", "initial_step"), WHOLE),
        **dict.fromkeys(("name", "access", "area", "encoding", "unit", "source"), TEXT),
        **dict.fromkeys(("range", "allowed"), WHOLES),
        "scale": NUMBER,
    }
)
#: Any other key of ``drive`` is a number.
DRIVE: Mapping[str, Rule] = MappingProxyType(
    {
        **dict.fromkeys(("law", "eeprom_locked_by", "shutdown_cuts", "wheel_mode"), TEXT),
        **dict.fromkeys(("shutdown_latches", "speed_zero_is_unlimited", "clears_errors"), TRUTH),
        "shutdown_bits": (_bits, "a table of names and bit numbers"),
    }
)


def check_shape(document: Mapping[str, Any], path: Path) -> None:
    """Raise :class:`TableError` for the first value of a whole document that is of a wrong kind."""
    for key, rule in DOCUMENT.items():
        if key in document:
            _check(document[key], rule, f"{path}: {key}")
    for row in document["register"]:
        for key, rule in REGISTER.items():
            if key in row:
                _check(row[key], rule, f"{path}: register {row.get('name', '?')!r}: {key}")
    for key, value in document.get("drive", {}).items():
        _check(value, DRIVE.get(key, NUMBER), f"{path}: drive: {key}")


def _check(value: Any, rule: Rule, where: str) -> None:
    fits, words = rule
    if not fits(value):
        raise TableError(f"{where} must be {words}, not {value!r}")
