"""A recording: what a host wrote to and read from servos' registers, and when."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from busemu.tables import ControlTable, Register, Robot

from .accesses import Access, AccessRows
from .columns import canonical, numbers, servo_ids, texts
from .errors import RecordingError
from .metadata import FORMAT, check_metadata, known_robot, known_tables, plain
from .rules import READ, WRITE, check_rows
from .turns import Waits, waits

Floats = NDArray[np.float64]
#: servo ID, register, operation
SeriesKey = tuple[int, str, str]


class Series(NamedTuple):
    """Values of one register of one servo over time, both of shape (n,).

    ``t_sample_s`` is the host's time at the end of the instruction packet, the best estimate of the
    instant of the sample that a bus alone gives: a servo looks its value up when it has the
    instruction, and the rest of the wait is the answer's way back.
    """

    t_sample_s: Floats
    value: Floats


@dataclass(frozen=True, eq=False)
class Recording:
    """An event table with its metadata; the rules were checked when it was made.

    Make one with :meth:`of` or :meth:`checked`, or :func:`bench.recording.read` a file. ``table``
    is a ``pyarrow.Table`` in the order of time, columns as in :mod:`bench.recording.columns`;
    ``robot`` and ``models`` (control tables by servo ID) are what the metadata's names stand for,
    as far as they are known here.
    """

    table: pa.Table
    metadata: dict[str, Any]
    path: Path | None
    robot: Robot | None
    models: Mapping[int, ControlTable]

    @classmethod
    def checked(
        cls, table: pa.Table, metadata: Mapping[str, Any], path: Path | None = None
    ) -> Recording:
        """Make a recording of a table with at least the format's columns.

        Raises :class:`RecordingError` with the file, the row and the rule that is broken.
        """
        document = plain(metadata, path)
        check_metadata(document, path)
        table = canonical(table, path)
        robot = known_robot(document, path)
        models = known_tables(document, robot)
        check_rows(table, models, path)
        return cls(table, document, path, robot, models)

    @classmethod
    def of(cls, accesses: Iterable[Access] | AccessRows, metadata: Mapping[str, Any]) -> Recording:
        """Make a recording of accesses in any order; adds ``format`` to ``metadata`` if missing."""
        if not isinstance(accesses, AccessRows):
            rows = AccessRows()
            for access in accesses:
                rows(access)
            accesses = rows
        return cls.checked(accesses.table(), {"format": FORMAT, **metadata})

    def __len__(self) -> int:
        """Rows of the event table."""
        return int(self.table.num_rows)

    @property
    def name(self) -> str:
        """The recording's name: as its metadata has it, else its file's."""
        return str(self.metadata.get("name") or (self.path.stem if self.path else "unnamed"))

    @property
    def t_s(self) -> Floats:
        """Times of all rows [s], shape (rows,), ascending."""
        return numbers(self.table, "t_s")

    @property
    def duration_s(self) -> float:
        """From the first row to the last [s]; 0 for an empty recording."""
        times = self.t_s
        return float(times[-1] - times[0]) if len(times) else 0.0

    @property
    def servo_ids(self) -> tuple[int, ...]:
        """IDs of the servos on the bus, ascending; namespaced registers belong to none."""
        return tuple(sorted({servo for servo, name, _ in self.by_series if "/" not in name}))

    @property
    def registers(self) -> tuple[str, ...]:
        """Names of all registers, those under a namespace too, sorted."""
        return tuple(sorted({name for _, name, _ in self.by_series}))

    @cached_property
    def by_series(self) -> Mapping[SeriesKey, NDArray[np.intp]]:
        """Rows (from 0, ascending) of every series: (servo ID, register, operation)."""
        (op, ops), (register, registers) = texts(self.table, "op"), texts(self.table, "register")
        servo = servo_ids(self.table)
        key = servo.astype(np.int32) * (len(registers) * len(ops)) + register * len(ops) + op
        counts = np.bincount(key)
        used = np.flatnonzero(counts)
        number = np.zeros(len(counts), dtype=np.uint16 if len(used) < 1 << 16 else np.int32)
        number[used] = np.arange(len(used))
        order = np.argsort(number[key], kind="stable")
        found: dict[SeriesKey, NDArray[np.intp]] = {}
        for rows in np.split(order, np.cumsum(counts[used])[:-1]) if len(used) else ():
            first = int(rows[0])
            name, access = registers[int(register[first])], ops[int(op[first])]
            found[int(servo[first]), name, access] = rows
        return found

    def rows(self, servo_id: int, register: str, op: str | None = None) -> NDArray[np.intp]:
        """Find the rows (from 0) of one register: all, or only its ``"read"`` or ``"write"``."""
        wanted = (READ, WRITE) if op is None else (op,)
        keys = [(servo_id, register, access) for access in wanted]
        found = [self.by_series[key] for key in keys if key in self.by_series]
        if not found:
            return np.empty(0, dtype=np.intp)
        return found[0] if len(found) == 1 else np.sort(np.concatenate(found))

    def series(self, servo_id: int, register: str, op: str | None = None) -> Series:
        """Give raw values of one register over time; lost replies are left out."""
        rows = self.rows(servo_id, register, op)
        raw = numbers(self.table, "raw")[rows]
        there = ~np.isnan(raw)
        return Series(self.t_s[rows][there], raw[there])

    def waits(self, servo_id: int, register: str) -> Waits:
        """From an instruction to when a servo looked, of every sample that was read [s]."""
        rows = self.rows(servo_id, register, READ)
        rows = rows[~np.isnan(numbers(self.table, "raw")[rows])]
        return Waits(self._waits.own[rows], self._waits.first[rows])

    @cached_property
    def _waits(self) -> Waits:
        return waits(self.table)

    def si(self, servo_id: int, register: str, op: str | None = None) -> Series:
        """:meth:`series` in SI, in the register's ``si_unit``; as it is for a namespaced register.

        Raises :class:`RecordingError` if the servo's model is not known.
        """
        times, raw = self.series(servo_id, register, op)
        if "/" in register:
            return Series(times, raw)
        described = self.register(servo_id, register)
        values, inverse = np.unique(raw, return_inverse=True)
        in_si = np.array([described.to_si(int(value)) for value in values], dtype=np.float64)
        return Series(times, in_si[inverse])

    def observed(self, register: str) -> Series:
        """Give a namespaced register (``mocap/base_z_m``) over time, in SI."""
        return self.series(0, register)

    def register(self, servo_id: int, name: str) -> Register:
        """Describe a servo's register as its control table does.

        Raises :class:`RecordingError` if the servo's model is not known or has none of that name.
        """
        model = self.models.get(servo_id)
        if model is None:
            raise RecordingError(
                self.path,
                f"the model of servo {servo_id} is not known: name it in the metadata as "
                f'[servo.{servo_id}] model = "...", or name the robot',
            )
        if name not in model:
            raise RecordingError(self.path, f"servo {servo_id} is {model.model}, without {name!r}")
        return model[name]

    def setting(self, servo_id: int, register: str) -> int | None:
        """Tell the raw value a register had at first: the metadata's, else the factory's.

        ``None`` if neither tells. Raises :class:`RecordingError` as :meth:`register` does.
        """
        servo = self.metadata.get("servo", {}).get(str(servo_id), {})
        value = servo.get("registers", {}).get(register)
        return self.register(servo_id, register).initial if value is None else int(value)
