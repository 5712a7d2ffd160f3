"""What kind of value stands where in the document of a control table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .inherit import TableError
from .spelling import near


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


def _positive(value: Any) -> bool:
    return _number(value) and value > 0.0


def _not_negative(value: Any) -> bool:
    return _number(value) and value >= 0.0


def _count(value: Any) -> bool:
    return _whole(value) and value >= 0


def _bits(value: Any) -> bool:
    return (
        _table(value)
        and value.keys() <= set(ALARMS)
        and all(_whole(bit) and 0 <= bit < 8 for bit in value.values())
    )


def _wholes(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(map(_whole, value))


#: What an alarm may be called in ``shutdown_bits``.
ALARMS = ("input_voltage", "overheating", "encoder", "electrical_shock", "overload")

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
        "stored": TRUTH,
    }
)
DRIVE: Mapping[str, Rule] = MappingProxyType(
    {
        **dict.fromkeys(("law", "eeprom_locked_by", "shutdown_cuts"), TEXT),
        **dict.fromkeys(
            (
                "shutdown_latches",
                "speed_zero_is_unlimited",
                "acceleration_needs_speed",
                "clears_errors",
            ),
            TRUTH,
        ),
        **dict.fromkeys(
            (
                *("p_gain_duty_per_rad", "i_gain_duty_per_rad_s", "d_gain_duty_s_per_rad"),
                "position_p_gain_duty_per_rad",
                "position_i_gain_duty_per_rad_s",
                "position_d_gain_duty_s_per_rad",
                *("overload_s", "load_refresh_s"),
            ),
            (_not_negative, "a number of 0 or more"),
        ),
        **dict.fromkeys(
            ("stall_current_a", "overload_torque"), (_positive, "a number of more than 0")
        ),
        **dict.fromkeys(
            ("turn_counts", "torque_on_by_goal_since", "time_profile_since"),
            (_count, "a whole number of 0 or more"),
        ),
        "load_sign": (lambda value: _number(value) and abs(value) == 1, "1 or -1"),
        "wheel_mode": (lambda value: value == "pwm", '"pwm", or left out'),
        "shutdown_bits": (_bits, f"a table of bit numbers, 0 to 7, of {', '.join(ALARMS)}"),
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
        if key not in DRIVE:
            raise TableError(f"{path}: drive: unknown key {key}{near(key, DRIVE)}")
        _check(value, DRIVE[key], f"{path}: drive: {key}")


def _check(value: Any, rule: Rule, where: str) -> None:
    fits, words = rule
    if not fits(value):
        raise TableError(f"{where} must be {words}, not {value!r}")
