"""EEPROM that lasts: `busemu serve --state FILE` keeps what the servos hold there.

The file is TOML, one table a servo, named by its joint: raw register values, and its backup area::

    format = "busemu-state/1"
    robot = "marvin"

    [servo.leg1_coxa]
    model = "XL-320"
    id = 1
    return_delay_time = 0

It is written anew as a whole, under another name, and then takes the place of the old one, so that
whatever ends the process leaves either the old file or the new one. Writes come when the bus is
quiet, a moment after the change, and only after a change of EEPROM.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .servo import Servo
from .tables import Robot
from .tables.toml_file import read_toml

FORMAT = "busemu-state/1"
BACKUP = "backup"


class StateError(ValueError):
    """A state file that cannot be used: says the file, the servo, the rule and what to do."""


class State:
    """The file of one bus. While it is open no other server can have it."""

    def __init__(self, path: Path, robot: Robot, servos: Sequence[Servo]) -> None:
        """Put what the file holds into ``servos``; a file that is not there is made.

        Raises :class:`StateError` where it is another robot's, another model's, or damaged.
        """
        self.path = path
        self._robot = robot
        self._servos = servos
        self._changed = False  # since the last attempt to write
        self._behind = False  # the last attempt failed
        self._file = -1
        if not path.parent.is_dir():
            raise StateError(f"--state {path}: there is no folder {path.parent}; make it first")
        if path.exists() and not path.is_file():
            raise StateError(f"--state {path}: is there and is no file; choose another name")
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:
            self._write()
        except OSError as error:
            raise StateError(f"--state {path}: {error.strerror}") from None
        else:
            try:
                self._lock(self._file)
                self._restore()
            except StateError:
                self.close()
                raise
        for servo in servos:
            servo.on_eeprom = self._note

    def _note(self) -> None:
        self._changed = True

    def save(self, *, again: bool = False) -> None:
        """Write the file if any EEPROM has changed since it was written; costs an fsync then.

        Raises :class:`StateError` where the disk does not take it; the old file is then as it was.
        What the disk did not take is tried once more at the next change, or where ``again`` says.
        """
        if self._changed or (again and self._behind):
            self._changed, self._behind = False, True
            self._write()
            self._behind = False

    def describe(self) -> list[str]:
        """A line for each servo that the file has at another ID or baud rate than the robot."""
        return [
            f"--state {self.path}: servo {servo.joint} has ID {servo.servo_id} and "
            f"{servo.baud_rate} baud there"
            for servo in self._servos
            if servo.servo_id != self._robot.by_joint[servo.joint].servo_id
            or servo.baud_rate != self._robot.baud_rate
        ]

    def close(self) -> None:
        """Let other servers have the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    # -- writing -----------------------------------------------------------------------------

    def _write(self) -> None:
        partial = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            file = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
            try:
                self._lock(file)
                with open(file, "w", encoding="utf-8", closefd=False) as whole:
                    whole.write(self._text())
                os.fsync(file)
                os.replace(partial, self.path)
                sync_folder(self.path.parent)
            except BaseException:
                os.close(file)
                partial.unlink(missing_ok=True)
                raise
        except OSError as error:
            raise StateError(f"--state {self.path}: {error.strerror}") from None
        self.close()
        self._file = file

    def _text(self) -> str:
        lines = [
            f"# EEPROM of the servos of {self._robot.name}, kept by busemu serve --state.",
            "# Raw register values. May be edited while no server has it.",
            f'format = "{FORMAT}"',
            f"robot = {json.dumps(self._robot.name)}",
        ]
        for servo in self._servos:
            table = f"[servo.{json.dumps(servo.joint)}"
            lines += ["", f"{table}]", f"model = {json.dumps(servo.table.model)}"]
            lines += [f"{r.name} = {servo.memory[r.name]}" for r in servo.memory.writable("EEPROM")]
            if servo.backup.values:
                lines += [f"{table}.{BACKUP}]"]
                lines += [f"{name} = {raw}" for name, raw in servo.backup.values.items()]
        return "\n".join(lines) + "\n"

    def _lock(self, file: int) -> None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StateError(
                f"--state {self.path}: another server keeps its EEPROM there; choose another file"
            ) from None

    # -- reading -----------------------------------------------------------------------------

    def _restore(self) -> None:
        document = self._document()
        rows = document.get("servo")
        if not isinstance(rows, Mapping):
            raise StateError(
                f"--state {self.path}: has no [servo.JOINT]; delete it to start afresh"
            )
        joints = {servo.joint for servo in self._servos}
        if set(rows) != joints:
            odd = ", ".join(sorted(set(rows) ^ joints))
            raise StateError(
                f"--state {self.path}: its servos are not those of {self._robot.name} ({odd}): "
                "choose another file, or delete it to start afresh"
            )
        values = {servo.joint: self._values(servo, rows[servo.joint]) for servo in self._servos}
        for servo in self._servos:
            servo.recall(*values[servo.joint])

    def _document(self) -> dict[str, Any]:
        document = read_toml(self.path, StateError, f"--state {self.path}")
        if document.get("format") != FORMAT:
            raise StateError(
                f'--state {self.path}: not a state file: needs format = "{FORMAT}"; '
                "choose another file"
            )
        if document.get("robot") != self._robot.name:
            raise StateError(
                f"--state {self.path}: is of robot {document.get('robot')!r}, not "
                f"{self._robot.name!r}: choose another file"
            )
        return document

    def _values(self, servo: Servo, row: Any) -> tuple[dict[str, int], dict[str, int]]:
        """The registers and the backup of one servo, checked."""
        where = f"--state {self.path}: servo {servo.joint}"
        if not isinstance(row, Mapping) or row.get("model") != servo.table.model:
            model = row.get("model") if isinstance(row, Mapping) else None
            raise StateError(
                f"{where}: is a {model!r} there and a {servo.table.model!r} in the robot file: "
                "choose another file, or delete it to start afresh"
            )
        registers = {k: v for k, v in row.items() if k not in ("model", BACKUP)}
        backup = row.get(BACKUP, {})
        if not isinstance(backup, Mapping):
            raise StateError(f"{where}: {BACKUP} must be a table")
        in_eeprom = {register.name for register in servo.memory.writable("EEPROM")}
        for values, known in ((registers, in_eeprom), (backup, servo.backup.names)):
            for name, raw in values.items():
                if name not in known:
                    raise StateError(
                        f"{where}: {servo.table.model} keeps no register {name!r} there"
                    )
                register = servo.table[name]
                fits = type(raw) is int and 0 <= raw <= register.raw_maximum
                if not fits or not register.accepts(register.decode(raw)):
                    raise StateError(f"{where}: {name} = {raw!r} is not a value it can have")
        return registers, dict(backup)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, too. Raises ``OSError``."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
