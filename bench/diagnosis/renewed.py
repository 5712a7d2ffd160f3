"""How often a load register is renewed: seen in the data itself, without a model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .confidence import NORMAL
from .observed import Channel, Observed
from .result import Cause, Estimate

LEAST = 30  #: changes of the register that are needed
SELDOM = 0.2  #: of the gaps between changes may be shorter than the period
LONGER = 2.5  #: samples that a period must last: else each may well be new
UNLIKE = 1.3  #: times the believed period at which it is another
STEADY = 0.8  #: of the gaps that must be whole periods, within a sample or two
SAMPLES_OFF = 1.6
MOST_PERIODS = 4  #: without a change that still count


def load_refresh(observed: Sequence[Observed], believed_s: float) -> Cause | None:
    """A register that changes only at whole periods, as a cause; ``None`` where it does not.

    ``believed_s`` is the period of the servo's file, 0 where every value is taken for new. The gain
    [nats] is that of gaps which would as well end at any sample.
    """
    gaps, steps = [], []
    for one in observed:
        samples = one.channels.get(Channel.DUTY)
        if samples is None or len(samples.t_s) < 3:
            continue
        changed = np.flatnonzero(np.diff(samples.value) != 0.0)
        gaps += np.diff(samples.t_s[changed + 1]).tolist()
        steps.append(float(np.median(np.diff(samples.t_s))))
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
    half = NORMAL * step / math.sqrt(float(few.sum()))
    return Cause(
        effect="load_refresh",
        scope=(observed[0].joint,),
        parameters={"period_s": Estimate(period, (period - half, period + half), "s")},
        held_out_gain_nats=float(len(every) * math.log(period / step)),
        explained_share=0.0,
        probability=1.0 - 1.0 / len(every),
    )
