"""Logs of the recorder that comes with ``bam``: one servo, one weight on an arm, JSON.

One object a file: ``mass`` [kg], ``length`` [m], ``kp``, ``vin`` [V], ``motor``, ``trajectory``,
perhaps ``arm_mass`` [kg], and ``entries``: a list of samples with ``timestamp`` [s],
``goal_position`` and ``position`` [rad, 0 hanging down], ``speed`` [rad/s], ``load`` (a register),
``input_volts`` [V], ``temp`` [degC] and ``torque_enable``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from bench.recording import Recording, RecordingError
from busemu.tables import ControlTable, load_table

from .bam_loop import Log, Loop, find_loop, load_register
from .rows import EventColumns, Floats, group_name, raw_of_counts, raw_of_si, whole
from .source import LARGEST, bounded, checked_times, json_object

NAME = "bam"
SERVO_ID = 1
#: ``motor`` in a log -> model; the X330 of the published logs is the M288
MOTORS: Mapping[str, str] = MappingProxyType(
    {
        "xl330": "XL330-M288",
        "xl320": "XL-320",
        "mx64": "MX-64",
        "mx106": "MX-106",
        "sts3215": "STS3215",
    }
)
#: model -> robot file of the rig
ROBOTS: Mapping[str, str] = MappingProxyType(
    {
        "XL330-M288": "xl330-pendulum",
        "XL-320": "xl320-pendulum",
        "MX-64": "mx64-pendulum",
        "MX-106": "mx106-pendulum",
        "STS3215": "sts3215-pendulum",
    }
)
#: a field of a sample -> registers it may be, the first that the model has; in the order in which
#: the recorder reads them
FIELDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "position": ("present_position",),
        "speed": ("present_velocity", "present_speed"),
        "load": (),
        "input_volts": ("present_input_voltage", "present_voltage"),
        "temp": ("present_temperature",),
    }
)
GAINS = ("position_p_gain", "p_gain")


def recognises(head: str) -> bool:
    """Whether a file that begins like this is such a log."""
    return head.lstrip().startswith("{") and '"entries"' in head and '"timestamp"' in head


def read(path: Path) -> list[Recording]:
    """Read one log. Raises :class:`RecordingError`."""
    document = json_object(path)
    entries = document.get("entries")
    if not isinstance(entries, list) or not entries:
        raise RecordingError(path, "entries is no list of samples: the log holds nothing")
    for number, entry in enumerate(entries, start=1):
        if not isinstance(entry, dict):
            raise RecordingError(path, "the sample is no object: {...} is needed", number)
    table = _table(document, path)
    events = EventColumns()
    log = _log(document, entries, table, path)
    events = EventColumns()
    events.note_order(log.t_s, "samples")
    loop = find_loop(log)
    events.note(loop.told)
    _writes(events, table, log, loop, path)
    _reads(events, table, entries, log, loop, path)
    return [events.recording(path, NAME, _metadata(document, table, bool(log.torque_on[0]), path))]


def _log(
    document: Mapping[str, Any], entries: list[dict[str, Any]], table: ControlTable, path: Path
) -> Log:
    torque = _column(entries, "torque_enable", path)
    gain = next((name for name in GAINS if name in table), None)
    return Log(
        trajectory=str(document.get("trajectory")),
        kp=_kp(document, gain, path),
        t_s=checked_times(_column(entries, "timestamp", path), path, "timestamp"),
        goal_rad=_column(entries, "goal_position", path),
        position_rad=_column(entries, "position", path),
        torque_on=np.isnan(torque) | (torque != 0.0),
    )


def _fact(value: Any, key: str, path: Path) -> float:
    """A number of the log's head. Raises :class:`RecordingError`."""
    try:
        if not isinstance(value, bool) and isinstance(value, int | float):
            number = float(value)
            if abs(number) <= LARGEST:
                return number
    except OverflowError:
        pass
    raise RecordingError(path, f"{key} {value!r:.40} is not a number")


def _kp(document: Mapping[str, Any], gain: str | None, path: Path) -> int | None:
    kp = document.get("kp")
    if kp is None or gain is None:
        return None
    if isinstance(kp, bool) or not isinstance(kp, int | float) or kp != kp // 1 or kp < 0:
        raise RecordingError(path, f"kp {kp!r:.40} is no value of the register {gain}")
    return int(kp)


def _table(document: Mapping[str, Any], path: Path) -> ControlTable:
    motor = document.get("motor", "xl330")
    model = MOTORS.get(str(motor).lower().replace("-", "").replace("_", ""))
    if model is None:
        raise RecordingError(
            path, f"motor {motor!r} has no control table here: known are {', '.join(MOTORS)}"
        )
    return load_table(model)


def _column(entries: list[dict[str, Any]], name: str, path: Path) -> Floats:
    """A field of all samples, NaN where a sample lacks it."""
    values = np.empty(len(entries))
    for index, entry in enumerate(entries):
        value = entry.get(name)
        if value is not None and not isinstance(value, int | float):
            raise RecordingError(path, f"{name} {value!r:.40} is not a number", index + 1)
        try:
            values[index] = np.nan if value is None else float(value)
        except OverflowError:
            values[index] = np.inf
    return bounded(values, path, name)


def _writes(events: EventColumns, table: ControlTable, log: Log, loop: Loop, path: Path) -> None:
    """Goals while the torque is on, and every change of the torque."""
    on, times = log.torque_on, log.t_s - loop.lead_s
    changes = np.flatnonzero(np.diff(on)) + 1
    events.write(SERVO_ID, "torque_enable", times[changes], on[changes].astype(float))
    goals = raw_of_si(table["goal_position"], log.goal_rad, path, "goal_position")
    events.write(SERVO_ID, "goal_position", times[on], goals[on])
    if not on.all():
        events.note("no goals are taken for written while the torque is off")


def _reads(
    events: EventColumns,
    table: ControlTable,
    entries: list[dict[str, Any]],
    log: Log,
    loop: Loop,
    path: Path,
) -> None:
    for place, (field, names) in enumerate(FIELDS.items()):
        values = _column(entries, field, path)
        if np.isnan(values).all():
            continue
        if field == "load":
            name = load_register(table, log, values, events)
        else:
            name = next((name for name in names if name in table), None)
        times = log.t_s + loop.offset_s(place, len(FIELDS))
        if name is None:
            events.observe(field, times, values)
            continue
        register = table[name]
        if field == "load":
            whole(values, path, "load")
            raw = np.where(values < 0, raw_of_counts(register, np.minimum(values, 0), path), values)
        else:
            raw = raw_of_si(register, values, path, field)
        events.read(SERVO_ID, name, times, raw, loop.read_s / len(FIELDS))


def _metadata(
    document: Mapping[str, Any], table: ControlTable, torque_on: bool, path: Path
) -> dict[str, Any]:
    condition: dict[str, Any] = {"support": "rig"}
    for key, word in (
        ("mass", "payload_kg"),
        ("length", "payload_at_m"),
        ("arm_mass", "arm_mass_kg"),
        ("vin", "supply_v"),
    ):
        if (value := document.get(key)) is None:
            continue
        condition[word] = _fact(value, key, path)
    if trajectory := document.get("trajectory"):
        condition["trajectory"] = str(trajectory)
    registers = {"torque_enable": int(torque_on)}
    gain = next((name for name in GAINS if name in table), None)
    kp = _kp(document, gain, path)
    if kp is not None and gain is not None:
        registers[gain] = kp
    told = (
        str(document.get("trajectory", "")),
        f"kp{kp}" if kp is not None else "",
        f"{condition['payload_kg']:g}kg" if "payload_kg" in condition else "",
        f"{condition['payload_at_m']:g}m" if "payload_at_m" in condition else "",
    )
    metadata: dict[str, Any] = {
        "name": path.stem,
        "group": group_name(told),
        "condition": condition,
        "bus": {"protocol": table.protocol},
        "servo": {str(SERVO_ID): {"model": table.model, "registers": registers}},
    }
    if table.model in ROBOTS:
        metadata["robot"] = ROBOTS[table.model]
    return metadata
