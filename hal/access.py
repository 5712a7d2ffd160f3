"""What a bus client tells about its work: every register access, and counts."""

from __future__ import annotations

import enum
from collections import Counter
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Access:
    """One access of one register of one servo: a row of a recording's event table.

    ``t_s``: when the last byte of the instruction packet left the host. ``t_reply_s``: when the
    last byte of the status packet with this value reached it; NaN for writes and for reads without
    a good answer. ``op``: ``"read"`` or ``"write"``. ``raw``: the unsigned value on the wire; NaN
    for reads without a good answer.
    """

    t_s: float
    t_reply_s: float
    servo_id: int
    op: str
    register: str
    raw: float


class Failure(enum.Enum):
    """Kinds of failed accesses."""

    NO_REPLY = "no reply"
    CORRUPT = "corrupt reply"
    SERVO_ERROR = "servo error"
    PORT_LOST = "port lost"


@dataclass(slots=True)
class BusStatistics:
    """What a client has seen so far. ``failures`` counts servos, ``transactions`` packets."""

    transactions: int = 0  #: transactions begun; a sync_read is one
    failures: Counter[Failure] = field(default_factory=Counter)
    alerts: Counter[int] = field(default_factory=Counter)  #: status packets with an alert, by ID
    alert_bits: dict[int, int] = field(default_factory=dict)  #: all alert bits seen, by ID

    @property
    def failed(self) -> int:
        """Failures of all kinds."""
        return sum(self.failures.values())
