"""Collecting accesses while a loop runs."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from math import nan
from typing import Any

import numpy as np
import pyarrow as pa

from .metadata import FORMAT
from .recording import Access, Recording
from .rules import READ


class Recorder:
    """Keeps accesses in memory; give it as the callback of a bus client.

    An access costs a few appends to flat arrays, some 40 bytes and well under 2 us, so that a
    control loop does not feel it. Nothing touches a disk before :func:`bench.recording.write`.
    """

    def __init__(self) -> None:
        self._times = array("d")
        self._replies = array("d")
        self._latches = array("d")
        self._values = array("d")
        self._servos = array("h")
        self._kinds = array("i")
        self._codes: dict[tuple[str, str], int] = {}

    def __call__(self, access: Access) -> None:
        """Keep one access. Accesses may come in any order of time."""
        self._times.append(access.t_s)
        self._replies.append(access.t_reply_s)
        self._latches.append(getattr(access, "t_latch_s", nan))
        self._values.append(access.raw)
        self._servos.append(access.servo_id)
        kind = (access.op, access.register)
        code = self._codes.get(kind)
        self._kinds.append(self._codes.setdefault(kind, len(self._codes)) if code is None else code)

    def observe(self, t_s: float, register: str, value: float) -> None:
        """Keep a value the bus does not have, in SI, under a namespace (``mocap/base_z_m``)."""
        self._times.append(t_s)
        self._replies.append(t_s)
        self._latches.append(nan)
        self._values.append(value)
        self._servos.append(0)
        self._kinds.append(self._codes.setdefault((READ, register), len(self._codes)))

    def __len__(self) -> int:
        """Rows so far."""
        return len(self._kinds)

    def recording(self, metadata: Mapping[str, Any]) -> Recording:
        """Make a recording of all accesses so far; adds ``format`` to ``metadata`` if missing.

        The recorder stays as it is and can go on. Raises :class:`RecordingError`.
        """
        rows = len(self._kinds)
        kinds = np.array(self._kinds, dtype=np.int32)[:rows]
        ops, registers = (
            pa.DictionaryArray.from_arrays(
                kinds, pa.array([k[i] for k in self._codes], pa.string())
            )
            for i in (0, 1)
        )
        times = np.array(self._times)[:rows]
        latches = np.array(self._latches)[:rows]
        columns = {
            "t_s": times,
            "t_reply_s": np.array(self._replies)[:rows],
            "servo_id": np.array(self._servos)[:rows],
            "op": ops,
            "register": registers,
            "raw": np.array(self._values)[:rows],
        }
        if not np.isnan(latches).all():
            columns["t_latch_s"] = latches
        table = pa.table(columns).take(np.argsort(times, kind="stable"))
        return Recording.checked(table, {"format": FORMAT, **metadata})
