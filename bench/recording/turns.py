"""When servos that are read together answer: one after another, whatever a host noted.

A sync read's replies follow each other on the line. A host that has them from a library notes the
end of the last for all of them; each then has its share of the wait, in the order of the rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .columns import numbers, texts
from .rules import READ

Floats = NDArray[np.float64]

SAME_S = 1e-6  #: within which replies are of one instant
#: share of packets whose replies are of one instant beyond which a host notes a packet's end for
#: all: a library does so each time or never, and a lost reply or two must not decide; assumed
MOST = 0.5


class Waits(NamedTuple):
    """From an instruction's end to a reply's [s], of every row; NaN where none was noted.

    ``own`` is that to the servo's own reply, ``first`` that to the first reply of the same packet:
    the same where a servo is read alone. Both of shape (rows,).
    """

    own: Floats
    first: Floats


def waits(table: pa.Table) -> Waits:
    """The waits of all rows of an event table in the order of time."""
    t_s = numbers(table, "t_s")
    own = numbers(table, "t_reply_s") - t_s
    first = own.copy()
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
    last = np.fmax.reduceat(own[reads], starts)
    soonest = np.fmin.reduceat(own[reads], starts)
    answered = np.add.reduceat((~np.isnan(own[reads])).astype(int), starts)
    told = answered > 1
    if told.any() and (last - soonest < SAME_S)[told].mean() > MOST:  # the packet's end for all
        whole = told & (answered == count)
        usual = float(np.median(last[whole])) if whole.any() else np.inf
        share = np.minimum(last, usual)[group] / count[group]
        alone = (count == 1)[group]
        there = ~np.isnan(own[reads]) & ~alone
        own[reads[there]] = (share * (turn + 1))[there]
        first[reads[there]] = share[there]
    else:
        first[reads] = soonest[group]
    return Waits(own, first)
