"""When servos looked that were read together: one after another, whatever a host noted.

A sync read's replies follow each other on the line, at even distances. What a host notes of them is
later and less even: an adapter hands over what has come in blocks, of a USB frame for instance, and
a library notes the end of the last reply for all of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .columns import numbers, texts
from .rules import READ

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]

SAME_S = 1e-6  #: within which replies are of one instant
#: share of packets whose replies are of one instant beyond which a host notes a packet's end for
#: all: a library does so each time or never, and a lost reply or two must not decide; assumed
MOST = 0.5
#: when the last servo of a packet looks between the instruction and its reply, as a share of that
#: wait: what is left is the line's and the host's
TURN = 0.87
LEAST = 3  #: replies to a packet from which their distances are told


class Waits(NamedTuple):
    """From an instruction to when a servo looked [s], of every row; NaN where no reply was noted.

    ``own`` is the servo's own wait, ``first`` that of the first of the same packet: the same where
    a servo is read alone. Both of shape (rows,).
    """

    own: Floats
    first: Floats


def waits(table: pa.Table) -> Waits:
    """The waits of all rows of an event table in the order of time."""
    t_s = numbers(table, "t_s")
    replied = numbers(table, "t_reply_s") - t_s
    own, first = TURN * replied, TURN * replied
    (op, ops), (register, _) = texts(table, "op"), texts(table, "register")
    reads = np.flatnonzero(op == ops.index(READ)) if READ in ops else np.empty(0, np.intp)
    if not len(reads):
        return Waits(own, first)
    new = np.ones(len(reads), bool)
    new[1:] = (np.diff(t_s[reads]) != 0.0) | (np.diff(register[reads]) != 0)
    starts = np.flatnonzero(new)
    group = np.cumsum(new) - 1
    count = np.bincount(group)
    turn = np.arange(len(reads)) - starts[group]
    after = replied[reads]
    last, soonest = np.fmax.reduceat(after, starts), np.fmin.reduceat(after, starts)
    there = ~np.isnan(after)
    answered = np.bincount(group, there)
    told = answered > 1
    if told.any() and (last - soonest < SAME_S)[told].mean() > MOST:  # the packet's end for all
        whole = told & (answered == count)
        usual = float(np.median(last[whole])) if whole.any() else np.inf
        share = TURN * np.minimum(last, usual)[group] / count[group]
        shared = there & (count > 1)[group]
        own[reads[shared]] = (share * (turn + 1))[shared]
        first[reads[shared]] = share[shared]
    else:
        even = _even(after, turn, group, register[reads])
        looked = even - (1.0 - TURN) * np.fmax.reduceat(even, starts)[group]
        own[reads] = looked
        first[reads] = np.fmin.reduceat(looked, starts)[group]
    return Waits(own, first)


def _even(after: Floats, turn: Whole, group: Whole, register: NDArray[Any]) -> Floats:
    """Waits for replies [s] as they would be without blocks: at even distances within a packet.

    All packets of a register have the same distance, which is the median of their own.
    """
    there = ~np.isnan(after)

    def of_packet(values: NDArray[np.floating[Any]]) -> Floats:
        """Mean of a packet over its replies, for every row."""
        sums = np.bincount(group, np.where(there, values, 0.0))
        found: Floats = (sums / np.maximum(np.bincount(group, there), 1))[group]
        return found

    middle, mean = of_packet(1.0 * turn), of_packet(after)
    spread = of_packet((turn - middle) ** 2)
    many = there & (np.bincount(group, there) >= LEAST)[group]
    found = after.copy()
    for one in np.unique(register[many]):
        mine = many & (register == one)
        slope = of_packet((turn - middle) * (after - mean))[mine] / spread[mine]
        found[mine] = (mean + np.median(slope) * (turn - middle))[mine]
    return found
