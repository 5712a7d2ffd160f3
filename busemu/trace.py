"""What happened on the wire, with the times the model gives it."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class WireEventKind(enum.Enum):
    """What a stretch of the wire carried."""

    INSTRUCTION = "instruction"  #: bytes of the host
    STATUS = "status"  #: bytes of a servo
    NOISE = "noise"  #: bytes of the host that no servo could read
    COLLISION = "collision"  #: bytes that met others on the wire
    FAULT = "fault"  #: no bytes: a fault struck, and the words say how


@dataclass(frozen=True, slots=True)
class WireEvent:
    """A run of bytes on the wire, from its first start bit to its last stop bit [s]."""

    kind: WireEventKind
    start_s: float
    end_s: float
    data: bytes
    words: str = ""


@dataclass(slots=True)
class BusCounts:
    """What a bus has seen since it was made."""

    transactions: int = 0  #: instruction packets that servos could read
    replies: int = 0
    errors: int = 0  #: bad packets, refusals, collisions, instructions nobody answered
    noise_bytes: int = 0
