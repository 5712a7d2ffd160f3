"""A recording's metadata: a plain dict that is TOML in a file, and the servos it speaks of."""

from __future__ import annotations

import datetime
import hashlib
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from busemu.tables import (
    ControlTable,
    Robot,
    RobotError,
    TableError,
    load_robot,
    load_table,
)

from .errors import RecordingError

FORMAT = "busemu-recording/1"


def of_robot(
    robot: Robot,
    *,
    name: str,
    source: str,
    group: str,
    condition: Mapping[str, Any],
    baud_rate: int | None = None,
) -> dict[str, Any]:
    """Metadata of a recording of ``robot`` on its bus, each servo as the robot's file sets it.

    ``source``: see :func:`source_of`. ``baud_rate`` [bit/s] if it was not the robot's.
    """
    return {
        "name": name,
        "robot": robot.name if robot.path.stem == robot.name else str(robot.path),
        "source": source,
        "group": group,
        "condition": dict(condition),
        "bus": {"protocol": robot.protocol, "baud_rate": baud_rate or robot.baud_rate},
        "servo": {
            str(servo.servo_id): {"model": servo.model, "registers": dict(servo.registers)}
            for servo in robot.servos
        },
    }


def fingerprint(robot: Robot) -> str:
    """SHA-256 of what a robot file says, whatever its layout and comments."""
    said = json.dumps(robot.document, sort_keys=True, default=dict)
    return hashlib.sha256(said.encode()).hexdigest()


def source_of(port: str) -> str:
    """What to call a serial port as a source: a pseudo-terminal is taken for an emulated bus."""
    return "emulator" if Path(port).resolve().is_relative_to("/dev/pts") else "real"


def plain(metadata: Mapping[str, Any], path: Path | None = None) -> dict[str, Any]:
    """Make a deep copy of ``metadata`` that TOML can hold.

    Keys become texts (``{"servo": {3: ...}}`` may be written with numbers), NumPy scalars and
    arrays become numbers and lists, paths become texts. Raises :class:`RecordingError` naming the
    key of a value TOML has no word for (``None``, say).
    """
    return {str(key): _plain(value, str(key), path) for key, value in metadata.items()}


def _plain(value: Any, key: str, path: Path | None) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(k): _plain(v, f"{key}.{k}", path) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{key}[{i}]", path) for i, item in enumerate(value)]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, str | bool | int | float | datetime.date | datetime.time):
        return value
    raise RecordingError(
        path, f"metadata {key} = {value!r} cannot be written as TOML: leave the key out"
    )


def to_toml(metadata: Mapping[str, Any]) -> str:
    """Write ``metadata`` as TOML text."""
    return tomli_w.dumps(metadata)


def from_toml(text: bytes, path: Path) -> dict[str, Any]:
    """Read the metadata in the bytes of a TOML file. Raises :class:`RecordingError`."""
    try:
        return tomllib.loads(text.decode("utf-8-sig").replace("\r\n", "\n"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RecordingError(path, f"the metadata is not TOML: {error}") from None


def check_metadata(metadata: Mapping[str, Any], path: Path | None) -> None:
    """Refuse a wrong ``format`` and ``servo`` tables that cannot be read.

    Raises :class:`RecordingError`.
    """
    found = metadata.get("format")
    if found != FORMAT:
        raise RecordingError(
            path,
            f'the metadata needs the line format = "{FORMAT}", '
            + ("but has no format" if found is None else f"not {found!r}")
            + ": if the file follows that format, add the line, else convert it first",
        )
    servos = metadata.get("servo", {})
    if not isinstance(servos, Mapping):
        raise RecordingError(path, "the metadata's servo is no table: write [servo.3] and so on")
    for key, servo in servos.items():
        if not key.isdecimal() or not isinstance(servo, Mapping):
            raise RecordingError(path, f"[servo.{key}]: a servo table is named by the servo's ID")
        _check_servo(key, servo, path)


def _check_servo(key: str, servo: Mapping[str, Any], path: Path | None) -> None:
    registers = servo.get("registers", {})
    if not isinstance(registers, Mapping):
        raise RecordingError(path, f"[servo.{key}]: registers is no table of names and values")
    table = _known_table(servo.get("model"))
    for name, raw in registers.items():
        where = f"[servo.{key}] registers.{name}"
        if table is not None and name not in table:
            raise RecordingError(path, f"{where}: {table.model} has no such register")
        if not isinstance(raw, int) or isinstance(raw, bool) or raw < 0:
            raise RecordingError(path, f"{where} = {raw!r} is not a raw value as on the wire")
        if table is not None and raw > table[name].raw_maximum:
            raise RecordingError(
                path, f"{where} = {raw} is more than its {table[name].size} byte(s) hold"
            )


def known_robot(metadata: Mapping[str, Any], path: Path | None) -> Robot | None:
    """Load the robot that ``metadata`` names; ``None`` if it names none that can be loaded.

    A path is looked up from the working directory, then from the recording's own folder.
    """
    name = metadata.get("robot")
    if not isinstance(name, str) or not name:
        return None
    places = [name] if path is None else [name, str(path.parent / name)]
    for place in places:
        try:
            return load_robot(place)
        except RobotError:
            continue
    return None


def known_tables(metadata: Mapping[str, Any], robot: Robot | None) -> dict[int, ControlTable]:
    """Load the control tables, by servo ID, of all servos whose model is named and known.

    The ``servo`` table names a model; the robot's file does where it is silent.
    """
    tables = {} if robot is None else dict(robot.tables)
    for key, servo in metadata.get("servo", {}).items():
        if "model" in servo:
            table = _known_table(servo["model"])
            tables.pop(int(key), None)
            if table is not None:
                tables[int(key)] = table
    return tables


def _known_table(model: object) -> ControlTable | None:
    if not isinstance(model, str):
        return None
    try:
        return load_table(model)
    except TableError:
        return None
