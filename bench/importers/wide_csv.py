"""Any CSV file of one column a signal, with a small TOML file that says what the columns are.

::

    format = "busemu-columns/1"
    robot = "marvin"                    # and any other metadata: group, [condition], [servo.3] ...
    [time]
    column = "t_ms"
    unit = "ms"                         # s, ms, us
    [[column]]
    name = "femur goal"
    joint = "leg1.femur"                # or servo = 3
    register = "goal_position"          # or "imu/roll_rad", which belongs to no servo
    op = "write"                        # or "read", the default
    unit = "deg"                        # raw, count, or a unit: rad, deg, rad/s, rpm, V, A, mA ...
    sign = -1                           # value = sign * cell + offset, both in that unit
    offset = 90.0
    at_s = 0.002                        # this long after the row's time
    on_change = true                    # a row only where the value changes

The map lies beside the file as ``NAME.columns.toml``, or is given.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from bench.recording import Recording, RecordingError
from bench.recording.metadata import known_robot, known_tables
from busemu.tables import ControlTable, Robot, ServoMount
from busemu.tables.register import UNITS

from .rows import WRITE, EventColumns, Floats, changes, raw_of_counts, raw_of_si, whole
from .source import TextTable, bare_name, csv_table

NAME = "wide-csv"
FORMAT = "busemu-columns/1"
TIME_UNITS: Mapping[str, float] = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6})
#: unit of a column -> (unit in SI, factor), besides the units of the control tables
MORE_UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "rad": ("rad", 1.0),
        "rad/s": ("rad/s", 1.0),
        "deg/s": ("rad/s", np.pi / 180.0),
        "share": ("", 1.0),
        "s": ("s", 1.0),
        "mV": ("V", 1e-3),
    }
)
RAW, COUNT = "raw", "count"
_COLUMN_KEYS = frozenset(
    {"name", "servo", "joint", "register", "op", "unit", "sign", "offset", "at_s", "on_change"}
)
_OWN_KEYS = frozenset({"format", "time", "column"})


@dataclass(frozen=True, slots=True)
class Column:
    """What one column of the file is."""

    name: str
    servo_id: int
    mount: ServoMount | None  #: of the joint whose angle it is, if it is told as a joint's
    register: str
    op: str
    unit: str
    sign: float
    offset: float
    at_s: float
    on_change: bool


def map_beside(path: Path) -> Path:
    """Where the map of a file is looked for."""
    return path.with_name(f"{bare_name(path)}.columns.toml")


def read(path: Path, map_path: Path | None = None) -> list[Recording]:
    """Read one file by its map. Raises :class:`RecordingError`."""
    map_path = map_path or map_beside(path)
    document = _document(map_path)
    metadata = {key: value for key, value in document.items() if key not in _OWN_KEYS}
    robot = known_robot(metadata, map_path)
    if "robot" in metadata and robot is None:
        raise RecordingError(map_path, f"robot {metadata['robot']!r} is not known")
    models = known_tables(metadata, robot)
    rows = document.get("column", [])
    if not isinstance(rows, list) or not rows:
        raise RecordingError(map_path, "no [[column]]: say at least one")
    columns = [_column(row, number, robot, map_path) for number, row in enumerate(rows, start=1)]
    cells = csv_table(path)
    time = document.get("time", {})
    if not isinstance(time, Mapping) or not isinstance(time.get("column"), str):
        raise RecordingError(map_path, '[time] needs column = "..."')
    if (unit := time.get("unit", "s")) not in TIME_UNITS:
        raise RecordingError(map_path, f"[time] unit {unit!r} is not one of s, ms, us")
    t_s = cells.times(time["column"], TIME_UNITS[unit])
    events = EventColumns()
    events.note_order(t_s)
    for column in sorted(columns, key=lambda column: column.op != WRITE):
        _add(events, column, cells, t_s, models, map_path)
    left = [n for n in cells.names if n not in {c.name for c in columns} | {time["column"]}]
    if left:
        events.note(f"columns without an entry in the map: {', '.join(left)}")
    metadata.setdefault("name", bare_name(path))
    return [events.recording(path, NAME, metadata)]


def _document(map_path: Path) -> dict[str, Any]:
    try:
        document = tomllib.loads(map_path.read_text("utf-8"))
    except FileNotFoundError:
        raise RecordingError(
            map_path, "there is no such map: write one (see busemu import --help) or name it"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RecordingError(map_path, f"not TOML: {error}") from None
    if document.get("format") != FORMAT:
        raise RecordingError(map_path, f'the map needs the line format = "{FORMAT}" at its top')
    return document


def _column(row: Any, number: int, robot: Robot | None, path: Path) -> Column:
    def refuse(rule: str) -> RecordingError:
        return RecordingError(path, f"[[column]] {number}: {rule}")

    if not isinstance(row, Mapping):
        raise refuse("is no table")
    if unknown := sorted(set(row) - _COLUMN_KEYS):
        raise refuse(f"unknown key {unknown[0]!r}: known are {', '.join(sorted(_COLUMN_KEYS))}")
    for key, kind in (("name", str), ("register", str), ("op", str), ("unit", str)):
        if not isinstance(row.get(key, ""), kind) or (
            key in ("name", "register") and key not in row
        ):
            raise refuse(f'needs {key} = "..."')
    for key in ("sign", "offset", "at_s"):
        value = row.get(key, 1)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise refuse(f"{key} must be a number, not {value!r}")
    if row.get("op", "read") not in ("read", WRITE):
        raise refuse(f"op must be read or write, not {row['op']!r}")
    if row.get("sign", 1) not in (1, -1):
        raise refuse("sign must be 1 or -1")
    mount, servo_id = None, row.get("servo", 0)
    if "joint" in row:
        mount = None if robot is None else robot.by_joint.get(row["joint"])
        if mount is None:
            raise refuse(f"joint {row['joint']!r} is on no robot that the map names")
        servo_id = mount.servo_id
    elif "/" not in row["register"] and "servo" not in row:
        raise refuse("needs servo or joint: whose register is it?")
    if type(servo_id) is not int or not 0 <= servo_id <= 253:
        raise refuse(f"servo must be an ID, 0 to 253, not {servo_id!r}")
    return Column(
        name=row["name"],
        servo_id=0 if "/" in row["register"] else servo_id,
        mount=mount,
        register=row["register"],
        op=row.get("op", "read"),
        unit=row.get("unit", RAW),
        sign=float(row.get("sign", 1)),
        offset=float(row.get("offset", 0.0)),
        at_s=float(row.get("at_s", 0.0)),
        on_change=bool(row.get("on_change", False)),
    )


def _add(
    events: EventColumns,
    column: Column,
    cells: TextTable,
    t_s: Floats,
    models: Mapping[int, ControlTable],
    map_path: Path,
) -> None:
    values = column.sign * cells.numbers(column.name) + column.offset
    times = t_s + column.at_s
    if column.on_change:
        first = changes(values)
        values, times = values[first], times[first]
    if "/" in column.register:
        _, factor = _unit(column, map_path) if column.unit != RAW else ("", 1.0)
        there = ~np.isnan(values)
        events.namespaced(column.register, times[there], values[there] * factor)
        return
    raw = _raw(column, values, models.get(column.servo_id), cells.path, map_path)
    if column.op == WRITE:
        events.write(column.servo_id, column.register, times, raw)
    else:
        events.read(column.servo_id, column.register, times, raw)


def _unit(column: Column, map_path: Path) -> tuple[str, float]:
    known = {**UNITS, **MORE_UNITS}
    if column.unit not in known:
        units = ", ".join(sorted({RAW, COUNT, *filter(None, known)}))
        raise RecordingError(map_path, f"{column.name}: unit {column.unit!r} is not one of {units}")
    return known[column.unit]


def _raw(
    column: Column, values: Floats, model: ControlTable | None, path: Path, map_path: Path
) -> Floats:
    if model is None and column.unit != RAW:
        raise RecordingError(
            map_path,
            f"{column.name}: the model of servo {column.servo_id} is not known, so {column.unit} "
            f'cannot be made of its registers: say [servo.{column.servo_id}] model = "..."',
        )
    if model is None or column.unit == RAW:
        return whole(values, path, column.name)
    if column.register not in model:
        raise RecordingError(
            map_path, f"{column.name}: {model.model} has no register {column.register!r}"
        )
    register = model[column.register]
    if column.unit == COUNT:
        return raw_of_counts(register, whole(values, path, column.name), path, column.name)
    unit, factor = _unit(column, map_path)
    if unit != register.si_unit:
        raise RecordingError(
            map_path,
            f"{column.name}: {column.register} is in {register.si_unit or 'no unit'}, which "
            f"{column.unit} is not",
        )
    si = values * factor
    if column.mount is not None:
        si = column.mount.direction * (si - (column.mount.zero_rad if unit == "rad" else 0.0))
    return raw_of_si(register, si, path, column.name)
