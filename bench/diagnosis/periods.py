"""Periods in which registers are renewed: seen in when they change, without a model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST = 30  #: changes of the register that are needed
SELDOM = 0.2  #: of the gaps between changes may be shorter than the period
LONGER = 2.5  #: samples that a period must last: else each may well be new
UNLIKE = 1.3  #: times the believed period at which it is another
STEADY = 0.8  #: of the gaps that must be whole periods, within a sample or two
SAMPLES_OFF = 1.6
MOST_PERIODS = 4  #: without a change that still count


def own_period(
    seen: Iterable[tuple[Floats, Floats]], believed_s: float = 0.0
) -> tuple[float, float, int] | None:
    """Period in which a register changes, time between reads [s], and how many gaps show it.

    ``seen`` are times [s] and values of it, of every recording; ``believed_s`` is a period that is
    known. ``None`` where no longer one is seen.
    """
    gaps, steps = [], []
    for t_s, value in seen:
        if len(t_s) < 3:
            continue
        changed = np.flatnonzero(np.diff(value) != 0.0)
        gaps += np.diff(t_s[changed + 1]).tolist()
        steps.append(float(np.median(np.diff(t_s))))
    if len(gaps) < LEAST:
        return None
    step, every = max(steps), np.array(gaps)
    shortest = float(np.quantile(every, SELDOM))
    if shortest < max(LONGER * step, UNLIKE * believed_s):
        return None
    turns = np.maximum(1.0, np.round(every / shortest))
    few = turns <= MOST_PERIODS
    period = float(every[few].sum() / turns[few].sum())
    turns = np.maximum(1.0, np.round(every / period))
    off = np.abs(every - turns * period)
    if few.sum() < LEAST or np.mean(off[few] <= SAMPLES_OFF * step) < STEADY:
        return None
    return period, step, int(few.sum())
