"""One thing that is odd about a recording: what, where, why it matters, what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

#: rows named one by one
ROWS_NAMED = 5


class Weight(IntEnum):
    """How much an oddity weighs for somebody who fits a model."""

    NOTE = 0  #: to be known
    WARNING = 1  #: spoils a fit that does not heed it
    SERIOUS = 2  #: the numbers cannot be right


@dataclass(frozen=True, slots=True)
class Oddity:
    """What is odd. Times [s] are those of the recording; ``rows`` count from 1, the first few.

    ``kind`` is a short name that stays the same; ``servo_id`` and ``register`` are ``None`` where
    the whole recording is meant; ``count`` is how many rows or events are.
    """

    kind: str
    weight: Weight
    what: str
    why: str
    advice: str
    servo_id: int | None = None
    register: str | None = None
    t_start_s: float | None = None
    t_end_s: float | None = None
    rows: tuple[int, ...] = ()
    count: int = 0

    def where(self, start_s: float = 0.0) -> str:
        """The place in words; times from ``start_s`` on."""
        words = []
        if self.servo_id is not None and self.register and "/" not in self.register:
            words.append(f"servo {self.servo_id} {self.register}")
        elif self.register:
            words.append(self.register)
        elif self.servo_id is not None:
            words.append(f"servo {self.servo_id}")
        if self.t_start_s is not None:
            span = f"{self.t_start_s - start_s:.3f}"
            if self.t_end_s is not None and self.t_end_s > self.t_start_s:
                span += f" to {self.t_end_s - start_s:.3f}"
            words.append(f"{span} s")
        if self.rows:
            more = ", ..." if self.count > len(self.rows) else ""
            words.append(f"row {', '.join(map(str, self.rows))}{more}")
        return ", ".join(words) or "metadata"


def first_rows(rows: NDArray[np.intp]) -> tuple[int, ...]:
    """The first few of ``rows`` (from 0), counted from 1."""
    return tuple(int(row) + 1 for row in rows[:ROWS_NAMED])
