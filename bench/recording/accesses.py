"""Accesses on their way into a table: cheap to keep in a running loop."""

from __future__ import annotations

import struct
from math import nan
from typing import Protocol

import numpy as np
import pyarrow as pa

from .rules import READ

_ROW = struct.Struct("=ddddhi")
_FIELDS = np.dtype(
    [
        ("t_s", "f8"),
        ("t_reply_s", "f8"),
        ("t_latch_s", "f8"),
        ("raw", "f8"),
        ("servo_id", "i2"),
        ("kind", "i4"),
    ]
)


class Access(Protocol):
    """One access of one register of one servo: a row of the event table.

    ``t_s``: when the last byte of the instruction packet left the host [s]. ``t_reply_s``: when the
    last byte of the status packet with this value reached it [s], NaN if none did. ``op``:
    ``"read"`` or ``"write"``. ``raw``: the unsigned value on the wire, NaN if no answer came. An
    access may also have ``t_latch_s``: when the servo took or sampled the value [s].
    """

    @property
    def t_s(self) -> float: ...  # noqa: D102
    @property
    def t_reply_s(self) -> float: ...  # noqa: D102
    @property
    def servo_id(self) -> int: ...  # noqa: D102
    @property
    def op(self) -> str: ...  # noqa: D102
    @property
    def register(self) -> str: ...  # noqa: D102
    @property
    def raw(self) -> float: ...  # noqa: D102


class AccessRows:
    """Rows that grow by one access a call; 38 bytes and well under 2 us each.

    A row is added in one step: a Ctrl-C that comes in between leaves it in or out, never half.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._add = self._bytes.extend
        self._kinds: dict[tuple[str, str], int] = {}

    def __call__(self, access: Access) -> None:
        """Keep one access. Accesses may come in any order of time."""
        kind = (access.op, access.register)
        code = self._kinds.get(kind)
        if code is None:
            code = self._kinds.setdefault(kind, len(self._kinds))
        self._add(
            _ROW.pack(
                access.t_s,
                access.t_reply_s,
                getattr(access, "t_latch_s", nan),
                access.raw,
                access.servo_id,
                code,
            )
        )

    def observe(self, t_s: float, register: str, value: float) -> None:
        """Keep a value the bus does not have, in SI, under a namespace (``mocap/base_z_m``)."""
        code = self._kinds.setdefault((READ, register), len(self._kinds))
        self._add(_ROW.pack(t_s, t_s, nan, value, 0, code))

    def __len__(self) -> int:
        """Rows so far."""
        return len(self._bytes) // _ROW.size

    def table(self) -> pa.Table:
        """Make an event table of all rows so far, sorted by time; the rows can grow on."""
        rows = np.frombuffer(bytes(self._bytes), dtype=_FIELDS)
        rows = rows[np.argsort(rows["t_s"], kind="stable")]
        kinds = pa.array(np.ascontiguousarray(rows["kind"]))
        columns = {name: np.ascontiguousarray(rows[name]) for name in ("t_s", "t_reply_s")}
        columns["servo_id"] = np.ascontiguousarray(rows["servo_id"])
        for place, name in enumerate(("op", "register")):
            texts = pa.array([kind[place] for kind in self._kinds], pa.string())
            columns[name] = pa.DictionaryArray.from_arrays(kinds, texts)
        columns["raw"] = np.ascontiguousarray(rows["raw"])
        if not np.isnan(rows["t_latch_s"]).all():
            columns["t_latch_s"] = np.ascontiguousarray(rows["t_latch_s"])
        return pa.table(columns)
