"""When a servo let go: where a recording breaks with its model, and which overload would do that.

A shutdown is there or not: a threshold that is a little off trips in no recording, or in others, so
that no slope leads to the right one. But the instant from which on a recording is unlike its model
tells it: the duty has been at the threshold or above for the overload's time just before. A duty's
register tells it better, where it was read: it shows none from then on, though the law asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sim.effects import effect
from sim.stepped import TICK_S

from ..knobs import Knob
from ..noise import Block
from ..observed import Channel
from .model import Hypothesis, JointModel, Kind

Floats = NDArray[np.float64]

LETS_GO = "overload_shutdown"
UNLIKE = 8.0  #: times the usual residual of all recordings, beyond which one breaks with its model
LASTING = 20  #: samples on end that it must be so, no mere transient
TIMES_S = (0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)  #: of an overload that are tried
LATE_S = (0.0, 0.02, 0.05, 0.1, 0.2)  #: after the trip, at which a break may be seen
LEAST = 5  #: samples of the duty in that time
ALMOST_LEAST = 0.05  #: quantile of the duty in that time which was still too high
ASKED = 5.0  #: steps of its register that a law must ask for where that shows none
BELOW = 0.99  #: share of that quantile: a threshold just under what was held so long


def breaks_s(blocks: Mapping[int, Block]) -> dict[int, float]:
    """From when on recordings are far and lastingly from their model [s], those that ever are."""
    if not blocks:
        return {}
    usual = float(np.median(np.abs(np.concatenate([b.value for b in blocks.values()]))))
    found = {}
    for r, block in blocks.items():
        first = _lastingly(np.abs(block.value) > UNLIKE * usual)
        if first > 0:
            found[r] = float(block.t_s[first])
    return found


def _lastingly(such: NDArray[np.bool_]) -> int:
    """The first of enough samples on end that are such; 0 where there are none."""
    run = np.convolve(such, np.ones(LASTING, np.int64), mode="valid")
    return int(np.argmax(run == LASTING)) if len(such) >= LASTING else 0


def silences(
    model: JointModel, hypothesis: Hypothesis, z: Floats
) -> list[tuple[float, Floats, Floats]]:
    """When duty registers fall silent [s], though the law asks for some, and what they showed.

    Times [s] and sizes of the duty, shape (n,), are those of the register: neither motor nor load
    need be right for that.
    """
    found = []
    for r, one in enumerate(model.observed):
        samples = one.channels.get(Channel.DUTY)
        if samples is None:
            continue
        law = model.law(hypothesis, z, r, TICK_S)
        asked = np.abs(law[np.minimum((samples.t_s / TICK_S).astype(np.intp), len(law) - 1)])
        sizes = np.abs(samples.value)
        silent = (sizes < 0.5 * samples.quantum) & (asked > ASKED * samples.quantum)
        shown = np.flatnonzero(sizes[: _lastingly(silent)])
        if len(shown):
            found.append((float(samples.t_s[shown[-1]]), samples.t_s, sizes))
    return found


def overloads(
    model: JointModel, hypothesis: Hypothesis, z: Floats, knobs: Sequence[Knob]
) -> list[Floats]:
    """Values of the overload's knobs that would trip where recordings break with their model."""
    blocks = model.residuals(hypothesis, [z], kinds=(Kind.POSITION,))[0]
    breaks = breaks_s({r: block for (r, _), block in blocks.items()})
    duties = [(at, *model.duty(hypothesis, z, r)) for r, at in breaks.items()]
    duties += silences(model, hypothesis, z)
    duty, time = (effect(LETS_GO).parameter(name) for name in ("duty", "time_s"))
    tried = set()
    for at, t_s, sizes in duties:
        for time_s, late_s in product(TIMES_S, LATE_S):
            first, last = np.searchsorted(t_s, (at - late_s - time_s, at - late_s))
            if first == 0 or last - first < LEAST:
                continue
            threshold = BELOW * float(np.quantile(sizes[first:last], ALMOST_LEAST))
            if duty.low < threshold < duty.high:
                tried.add((round(threshold, 3), time_s))
    values = [{duty.name: threshold, time.name: time_s} for threshold, time_s in sorted(tried)]
    return [np.array([knob.at(one[knob.parameter.name]) for knob in knobs]) for one in values]
