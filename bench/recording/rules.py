"""The rules an event table must keep, each checked over whole columns.

Refused: times out of order, an operation that is neither ``read`` nor ``write``, a register that
the servo's model does not have, a raw value that does not fit in its register's bytes. Lost replies
and gaps are no reason to refuse; see :mod:`bench.recording.oddities`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from busemu.tables import ControlTable

from .columns import numbers, servo_ids, texts
from .errors import RecordingError

READ, WRITE = "read", "write"
#: highest address in an instruction packet: 254 is all servos at once
BROADCAST_ID = 254

Rows = NDArray[np.bool_]


def check_rows(table: pa.Table, models: Mapping[int, ControlTable], path: Path | None) -> None:
    """Refuse ``table`` (see :func:`bench.recording.columns.canonical`) if a row breaks a rule.

    ``models`` holds control tables by servo ID; registers of other servos cannot be checked.
    Raises :class:`RecordingError` with the first row that breaks the first broken rule.
    """
    _Check(table, models, path).all()


class _Check:
    def __init__(
        self, table: pa.Table, models: Mapping[int, ControlTable], path: Path | None
    ) -> None:
        self.path = path
        self.models = models
        self.t_s = numbers(table, "t_s")
        self.raw = numbers(table, "raw")
        self.servo_id = servo_ids(table)
        self.op, self.ops = texts(table, "op")
        self.register, self.registers = texts(table, "register")
        self.t_reply_s = numbers(table, "t_reply_s")

    def all(self) -> None:
        self.times()
        self.operations()
        self.servos()
        self.names()
        self.values()

    def refuse(self, row: int, rule: str) -> None:
        raise RecordingError(self.path, rule, row + 1)

    def times(self) -> None:
        if (row := _first(~np.isfinite(self.t_s))) is not None:
            self.refuse(row, f"t_s {self.t_s[row]} is no time: every access has one, in seconds")
        if (before := _first(self.t_s[1:] < self.t_s[:-1])) is not None:
            row = before + 1
            self.refuse(
                row,
                f"unsorted times: t_s {self.t_s[row]!s} comes after {self.t_s[before]!s}: "
                "sort the rows by t_s",
            )
        if (row := _first(np.isinf(self.t_reply_s))) is not None:
            self.refuse(row, "t_reply_s is infinite: write nan where no reply came")

    def operations(self) -> None:
        bad = [code for code, op in enumerate(self.ops) if op not in (READ, WRITE)]
        if (row := _first(np.isin(self.op, bad))) is not None:
            self.refuse(row, f"op {self.ops[self.op[row]]!r} is neither 'read' nor 'write'")

    def servos(self) -> None:
        if (row := _first((self.servo_id < 0) | (self.servo_id > BROADCAST_ID))) is not None:
            self.refuse(
                row, f"servo_id {self.servo_id[row]} is no ID on a bus: 0 to {BROADCAST_ID}"
            )
        spaces = [code for code, name in enumerate(self.registers) if "/" in name]
        if (row := _first(np.isin(self.register, spaces) & (self.servo_id != 0))) is not None:
            self.refuse(
                row,
                f"register {self._name(row)!r} is not on the bus (it has a namespace): "
                f"its servo_id must be 0, not {self.servo_id[row]}",
            )

    def names(self) -> None:
        nameless = [code for code, name in enumerate(self.registers) if not name.strip("/ ")]
        if (row := _first(np.isin(self.register, nameless))) is not None:
            self.refuse(row, "register is empty: name it as in the servo's control table")
        unknown = np.zeros(self._keys(), dtype=bool)
        for servo, model in self.models.items():
            for code, name in enumerate(self.registers):
                unknown[self._key(servo, code)] = "/" not in name and name not in model
        if (row := _first(unknown[self._key_of_rows()])) is not None:
            model = self.models[int(self.servo_id[row])]
            self.refuse(
                row,
                f"unknown register: servo {self.servo_id[row]} is {model.model}, which has no "
                f"{self._name(row)!r}: name a register of its control table, give the servo's "
                "true model in [servo.N], or put the value under a namespace",
            )

    def values(self) -> None:
        if (row := _first(np.isinf(self.raw))) is not None:
            self.refuse(row, f"raw {self.raw[row]} of {self._name(row)} is no value")
        writes = [code for code, op in enumerate(self.ops) if op == WRITE]
        if (row := _first(np.isnan(self.raw) & np.isin(self.op, writes))) is not None:
            self.refuse(
                row, f"raw of a write to {self._name(row)} is missing: only lost reads have none"
            )
        largest = np.full(self._keys(), np.inf)
        for servo, model in self.models.items():
            for code, name in enumerate(self.registers):
                if name in model:
                    largest[self._key(servo, code)] = 2.0 ** min(8 * model[name].size, 1000) - 1.0
        limit = largest[self._key_of_rows()]
        bad = (self.raw < 0.0) | (self.raw > limit) | (self.raw != np.floor(self.raw))
        if (row := _first(bad & np.isfinite(limit) & ~np.isnan(self.raw))) is not None:
            self.refuse(
                row,
                f"raw {self.raw[row]:g} is outside {self._name(row)} of servo "
                f"{self.servo_id[row]}: the raw value is the unsigned number on the wire, a whole "
                f"number from 0 to {limit[row]:.0f} (negative counts are encoded, and SI values "
                "have to be converted)",
            )

    def _name(self, row: int) -> str:
        return self.registers[int(self.register[row])]

    def _keys(self) -> int:
        return (BROADCAST_ID + 1) * max(len(self.registers), 1)

    def _key(self, servo: int, code: int) -> int:
        return servo * len(self.registers) + code

    def _key_of_rows(self) -> NDArray[np.int64]:
        return self.servo_id.astype(np.int64) * len(self.registers) + self.register


def _first(broken: Rows) -> int | None:
    """Find the first row (from 0) where ``broken`` is true."""
    if broken.size == 0:
        return None
    row = int(np.argmax(broken))
    return row if broken[row] else None
