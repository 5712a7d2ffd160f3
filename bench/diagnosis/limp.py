"""When a servo let go: where a recording breaks with its model, and which overload would do that.

A shutdown is there or not: a threshold that is a little off trips in no recording, or in others, so
that no slope leads to the right one. But the instant from which on a recording is unlike its model
tells it: the duty has been at the threshold or above for the overload's time just before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.effects import effect

from .knobs import Knob
from .model import Hypothesis, JointModel, Kind
from .noise import Block

Floats = NDArray[np.float64]

LETS_GO = "overload_shutdown"
UNLIKE = 4.0  #: times as far from the model as before, from when on a recording breaks with it
LEAST = 20  #: samples on either side
TIMES_S = (0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)  #: of an overload that are tried
LATE_S = (0.0, 0.02, 0.05, 0.1)  #: after the trip, at which a break may be seen
BELOW = 0.99  #: of the least duty that was still too high


def breaks_s(block: Block) -> float | None:
    """From when on residuals are of another size than before [s]; ``None`` where they are not."""
    count = len(block.value)
    if count < 2 * LEAST:
        return None
    squares = np.cumsum(block.value**2) + 1e-300
    first = np.arange(LEAST, count - LEAST)
    before, after = squares[first - 1] / first, (squares[-1] - squares[first - 1]) / (count - first)
    cost = first * np.log(before + 1e-300) + (count - first) * np.log(after + 1e-300)
    best = int(np.argmin(cost))
    if after[best] < UNLIKE**2 * before[best]:
        return None
    return float(block.t_s[first[best]])


def overloads(
    model: JointModel, hypothesis: Hypothesis, z: Floats, knobs: Sequence[Knob]
) -> list[Floats]:
    """Values of the overload's knobs that would trip where recordings break with their model."""
    blocks = model.residuals(hypothesis, [z], kinds=(Kind.POSITION,))[0]
    breaks = {r: at for (r, _), block in blocks.items() if (at := breaks_s(block)) is not None}
    if not breaks:
        return []
    duties = {r: model.duty(hypothesis, z, r) for r in breaks}
    duty, time = (effect(LETS_GO).parameter(name) for name in ("duty", "time_s"))
    tried = []
    for time_s in TIMES_S:
        for late_s in LATE_S:
            thresholds = []
            for r, at in breaks.items():
                t_s, sizes = duties[r]
                within = (t_s >= at - late_s - time_s) & (t_s <= at - late_s)
                if within.any() and at - late_s - time_s >= t_s[0]:
                    thresholds.append(float(sizes[within].min()))
            if not thresholds or not duty.low < min(thresholds) * BELOW < duty.high:
                continue
            values = {duty.name: min(thresholds) * BELOW, time.name: time_s}
            tried.append(np.array([knob.at(values[knob.parameter.name]) for knob in knobs]))
    return tried
