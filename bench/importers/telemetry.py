"""Telemetry of several servos as CSV: a column a value and servo, its ID in brackets.

``timestamp`` (ISO 8601), then ``target pos (5)``, ``pos (5)``, ``speed (5)``, ``load (5)``,
``current (5)``, ``temp (5)``, ``status (5)``, ``moving (5)``: raw register values of an STS3215.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from bench.recording import Recording, RecordingError
from busemu.tables import load_robot, load_table

from .rows import EventColumns, Floats, changes, group_name, whole
from .source import TextTable, bare_name, csv_table

NAME = "telemetry"
MODEL, ROBOT = "STS3215", "sts3215-lever"
TARGET = "target pos"
#: a column -> the register
REGISTERS: Mapping[str, str] = MappingProxyType(
    {
        "pos": "present_position",
        "speed": "present_speed",
        "load": "present_load",
        "current": "present_current",
        "temp": "present_temperature",
        "status": "hardware_error_status",
        "moving": "moving",
    }
)
COLUMN = re.compile(rf"({'|'.join((TARGET, *REGISTERS))}) \((\d{{1,3}})\)$")


def recognises(head: str) -> bool:
    """Whether a file that begins like this is such a log."""
    first = head.split("\n", 1)[0].rstrip("\r").split(",")
    return first[0] == "timestamp" and any(COLUMN.match(name) for name in first[1:])


def read(path: Path) -> list[Recording]:
    """Read one log. Raises :class:`RecordingError`."""
    cells = csv_table(path)
    start, t_s = _times(cells)
    table = load_table(MODEL)
    events = EventColumns()
    events.note_order(t_s)
    servos: dict[str, Any] = {}
    for column in cells.names:
        if column == "timestamp":
            continue
        found = COLUMN.match(column)
        if found is None:
            events.observe(column.replace(" ", "_").replace("/", "_"), t_s, cells.numbers(column))
            continue
        what, servo_id = found[1], int(found[2])
        servos[str(servo_id)] = {"model": MODEL}
        register = table["goal_position" if what == TARGET else REGISTERS[what]]
        raw = whole(cells.numbers(column), path, column)
        if what == TARGET:
            first = changes(raw)
            events.write(servo_id, register.name, t_s[first], raw[first])
        else:
            events.read(servo_id, register.name, t_s, raw)
    events.note("changes of a target are taken for writes; empty cells for lost replies")
    metadata: dict[str, Any] = {
        "name": bare_name(path),
        "group": group_name((bare_name(path),)),
        "condition": {"support": "rig", "started": start},
        "bus": {"protocol": table.protocol},
        "servo": servos,
    }
    if {int(servo_id) for servo_id in servos} <= set(load_robot(ROBOT).by_id):
        metadata["robot"] = ROBOT
    return [events.recording(path, NAME, metadata)]


def _times(cells: TextTable) -> tuple[datetime.datetime, Floats]:
    """The first row's time, and all times after it [s]."""
    found: list[datetime.datetime] = []
    for row, cell in enumerate(cells.texts("timestamp"), start=1):
        try:
            stamp = datetime.datetime.fromisoformat(cell.strip())
        except ValueError:
            raise RecordingError(
                cells.path, f"timestamp {cell[:40]!r} is no ISO 8601 time", row
            ) from None
        found.append(stamp if stamp.tzinfo else stamp.replace(tzinfo=datetime.UTC))
    start = min(found)
    return start, np.array([(stamp - start).total_seconds() for stamp in found])
