"""Event tables from columns: what was written and read, as arrays, brought into the format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.recording import Recording, RecordingError
from bench.recording.metadata import FORMAT
from busemu.tables import Register

Floats = NDArray[np.float64]

WRITE, READ = "write", "read"
#: namespace of what a foreign log has and no register holds
FOREIGN = "foreign"


class EventColumns:
    """Columns on their way into an event table; rows of one time keep the order they came in."""

    def __init__(self) -> None:
        self._parts: list[tuple[Floats, Floats, Floats, int, str, str]] = []
        self.notes: list[str] = []  #: what a reader of the recording has to know of the import

    def write(self, servo_id: int, register: str, t_s: Floats, raw: Floats) -> None:
        """Add writes of raw values, shapes (n,); rows without a value are left out."""
        there = ~np.isnan(raw)
        nothing = np.full(int(there.sum()), np.nan)
        self._parts.append((t_s[there], nothing, raw[there], servo_id, WRITE, register))

    def read(
        self, servo_id: int, register: str, t_s: Floats, raw: Floats, reply_s: float = 0.0
    ) -> None:
        """Add reads of raw values, shapes (n,), NaN where no answer came.

        ``reply_s``: how long after ``t_s`` [s] the answers were there, if that is known.
        """
        replies = np.where(np.isnan(raw), np.nan, t_s + reply_s)
        self._parts.append((t_s, replies, raw, servo_id, READ, register))

    def observe(self, name: str, t_s: Floats, value: Floats) -> None:
        """Add values that no register holds, in SI, as ``foreign/name``; missing ones left out."""
        there = ~np.isnan(value)
        self.namespaced(f"{FOREIGN}/{name}", t_s[there], value[there])

    def namespaced(self, register: str, t_s: Floats, value: Floats) -> None:
        """Add values under a namespace of their own (``imu/roll_rad``), in SI."""
        self._parts.append((t_s, t_s, value, 0, READ, register))

    def note(self, what: str) -> None:
        """Say once what a reader has to know of the import."""
        if what not in self.notes:
            self.notes.append(what)

    def note_order(self, t_s: Floats, what: str = "rows") -> None:
        """Note times that run backwards; the rows are put in order."""
        back = np.flatnonzero(np.diff(t_s) < 0.0)
        if back.size:
            worst_s = float(-np.diff(t_s)[back].min())
            self.note(
                f"unsorted times: {back.size} {what} come before the one above them "
                f"(first: row {int(back[0]) + 2}; by up to {worst_s:.3g} s); sorted by time"
            )

    def recording(self, path: Path, kind: str, metadata: Mapping[str, Any]) -> Recording:
        """Make the recording; its metadata gets ``[import]`` with the format, file and notes.

        Raises :class:`RecordingError`.
        """
        told: dict[str, Any] = {"format": kind, "file": path.name}
        if self.notes:
            told["notes"] = list(self.notes)
        document = {"format": FORMAT, "source": "real", **metadata, "import": told}
        return Recording.checked(self._table(), document, path)

    def _table(self) -> pa.Table:
        parts = self._parts
        counts = [len(part[0]) for part in parts]
        t_s = _joined([part[0] for part in parts])
        t_reply_s = _joined([part[1] for part in parts])
        raw = _joined([part[2] for part in parts])
        order = np.argsort(t_s, kind="stable")
        kinds = np.repeat(np.arange(len(parts), dtype=np.int32), counts)[order]
        ids = np.array([part[3] for part in parts], dtype=np.int16)
        columns: dict[str, Any] = {
            "t_s": t_s[order],
            "t_reply_s": t_reply_s[order],
            "servo_id": ids[kinds] if len(ids) else np.empty(0, np.int16),
        }
        for place, name in ((4, "op"), (5, "register")):
            columns[name] = pa.DictionaryArray.from_arrays(
                pa.array(kinds), pa.array([part[place] for part in parts], pa.string())
            )
        columns["raw"] = raw[order]
        return pa.table(columns)


def raw_of_counts(register: Register, counts: Floats, path: Path, what: str = "") -> Floats:
    """Raw values on the wire of signed counts (whole numbers, NaN where there is none).

    Raises :class:`RecordingError` with the row of a count that the register's bytes cannot hold.
    """
    top = register.raw_maximum
    if register.encoding == "sign_magnitude":
        sign = 1 << register.sign_bit
        low, high = -(sign - 1), sign - 1
        raw = np.where(counts < 0, sign - counts, counts)
    elif register.encoding == "signed":
        low, high = -(top // 2) - 1, top // 2
        raw = np.where(counts < 0, counts + top + 1, counts)
    else:
        low, high = 0, top
        raw = counts
    wrong = np.flatnonzero((counts < low) | (counts > high))
    if wrong.size:
        row = int(wrong[0])
        raise RecordingError(
            path,
            f"{what or register.name} is {counts[row]:.0f} counts, which {register.name} cannot "
            f"hold ({low} to {high}): is the unit right?",
            row + 1,
        )
    found: Floats = raw
    return found


def raw_of_si(register: Register, values: Floats, path: Path, what: str = "") -> Floats:
    """Raw values nearest to values in the register's SI unit. Raises :class:`RecordingError`."""
    return raw_of_counts(register, np.round(values / register.si_scale) + register.zero, path, what)


def whole(values: Floats, path: Path, what: str) -> Floats:
    """Give ``values`` back if all are whole numbers. Raises :class:`RecordingError`."""
    wrong = np.flatnonzero(~np.isnan(values) & (values != np.round(values)))
    if wrong.size:
        row = int(wrong[0])
        raise RecordingError(
            path, f"{what} {values[row]:g} is no whole number: a register was expected", row + 1
        )
    return values


def changes(values: Floats) -> NDArray[np.intp]:
    """Rows whose value is another than that of the row above, the first one too."""
    there = np.flatnonzero(~np.isnan(values))
    if not there.size:
        return there
    found: NDArray[np.intp] = there[np.flatnonzero(np.diff(values[there], prepend=np.nan) != 0.0)]
    return found


def group_name(words: Sequence[object]) -> str:
    """A group's name of words: small letters, joined by hyphens."""
    return "-".join(str(word).strip().lower().replace(" ", "_") for word in words if str(word))


def _joined(parts: Sequence[Floats]) -> Floats:
    return np.concatenate(parts) if parts else np.empty(0)
