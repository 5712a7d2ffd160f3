"""Small recordings to start from, and a comparison that knows NaN."""

from dataclasses import dataclass
from math import nan

import numpy as np
import pyarrow as pa

from bench.recording import Recording

FORMAT = "busemu-recording/1"
MARVIN = {"format": FORMAT, "name": "sample", "robot": "marvin", "source": "emulator"}


@dataclass(frozen=True, slots=True)
class Row:
    t_s: float
    t_reply_s: float
    servo_id: int
    op: str
    register: str
    raw: float


def write_row(t_s, servo_id, raw, register="goal_position"):
    return Row(t_s, nan, servo_id, "write", register, raw)


def read_row(t_s, servo_id, raw, register="present_position"):
    return Row(t_s, nan if raw != raw else t_s + 0.001, servo_id, "read", register, raw)


def rows(cycles=20, servos=(1, 2, 3), cycle_s=0.02):
    """A walk's traffic: a goal for each servo, then a position of each."""
    found = []
    for cycle in range(cycles):
        t_s = 10.0 + cycle * cycle_s
        found += [write_row(t_s, servo, 512 + cycle) for servo in servos]
        found += [read_row(t_s + 0.001, servo, 512 + max(cycle - 1, 0)) for servo in servos]
    return found


def sample(**more):
    return Recording.of(rows(), MARVIN | more)


def table(**columns):
    """Three good rows, with some columns replaced; ``None`` takes a column away."""
    good = {
        "t_s": [0.0, 0.1, 0.2],
        "t_reply_s": [nan, 0.101, 0.201],
        "servo_id": [1, 1, 2],
        "op": ["write", "read", "read"],
        "register": ["goal_position", "present_position", "present_position"],
        "raw": [512.0, 500.0, 501.0],
    }
    return pa.table({k: v for k, v in (good | columns).items() if v is not None})


def same_bits(left, right):
    """Whether two recordings hold the same columns, types, values to the bit, and metadata."""
    if left.metadata != right.metadata or left.table.schema.names != right.table.schema.names:
        return False
    for name in left.table.schema.names:
        a, b = left.table[name], right.table[name]
        if a.type != b.type:
            return False
        if pa.types.is_float64(a.type):
            same = np.array_equal(a.to_numpy().view(np.uint64), b.to_numpy().view(np.uint64))
        else:
            same = a.to_pylist() == b.to_pylist()
        if not same:
            return False
    return True
