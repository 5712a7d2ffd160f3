"""One register of one servo over time, decoded, as the checks look at it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from busemu.tables import ControlTable, Register

from ..columns import numbers
from ..recording import Recording
from .oddity import Oddity, Weight, first_rows

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """A series with its values as signed counts; NaN where a reply was lost. Shapes (n,)."""

    servo_id: int
    name: str
    op: str
    model: ControlTable | None
    rows: Rows  #: rows of the event table, from 0
    t_s: Floats
    raw: Floats

    @property
    def register(self) -> Register | None:
        """The register, if its model is known."""
        return None if self.model is None or "/" in self.name else self.model[self.name]

    def counts(self) -> Floats:
        """Signed counts, as the register encodes them; as they are for an unknown register."""
        register, raw = self.register, self.raw
        if register is None:
            return raw
        if register.encoding == "signed":
            half = float(1 << (8 * register.size - 1))
            return np.where(raw >= half, raw - 2.0 * half, raw)
        if register.encoding == "sign_magnitude":
            sign = float(1 << register.sign_bit)
            magnitude = np.mod(raw, sign)
            return np.where(np.mod(np.floor(raw / sign), 2.0) == 1.0, -magnitude, magnitude)
        return raw

    def si(self) -> Floats:
        """Values in SI; as they are for an unknown register."""
        register = self.register
        if register is None:
            return self.raw
        found: Floats = (self.counts() - register.zero) * register.si_scale
        return found

    @property
    def period_s(self) -> float:
        """Median time between accesses [s]; NaN for fewer than two."""
        return float(np.median(np.diff(self.t_s))) if len(self.t_s) > 1 else float("nan")


def channels(recording: Recording) -> Iterator[Channel]:
    """All series, one after the other."""
    for servo_id, name, op in recording.by_series:
        found = channel(recording, servo_id, name, op)
        if found is not None:
            yield found


def channel(recording: Recording, servo_id: int, name: str, op: str) -> Channel | None:
    """One series, ``None`` if the recording has none of it."""
    rows = recording.by_series.get((servo_id, name, op))
    if rows is None:
        return None
    return Channel(
        servo_id,
        name,
        op,
        recording.models.get(servo_id),
        rows,
        recording.t_s[rows],
        numbers(recording.table, "raw")[rows],
    )


def at(
    series: Channel, places: Rows, kind: str, weight: Weight, what: str, why: str, advice: str
) -> Oddity:
    """An oddity of some samples (from 0, at least one) of a series."""
    return Oddity(
        kind,
        weight,
        what,
        why,
        advice,
        series.servo_id,
        series.name,
        float(series.t_s[places[0]]),
        float(series.t_s[places[-1]]),
        first_rows(series.rows[places]),
        len(places),
    )
