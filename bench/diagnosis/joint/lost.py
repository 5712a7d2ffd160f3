"""Samples that were lost and logged as something: seen in the data itself, without a model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..noise import CLIP
from ..observed import Observed
from ..result import Cause, Estimate
from .confidence import NORMAL


def lost_samples(observed: Sequence[Observed], deviation_rad: float) -> Cause | None:
    """Single positions far off both their neighbours, as a cause; ``None`` where there are none.

    ``deviation_rad`` is that of an ordinary residual: the gain [nats] is what such samples would
    cost if they were taken for real, clipped as any wild sample is.
    """
    count = sum(len(o.position.good) for o in observed)
    jumps = []
    for one in observed:
        values, good = one.position.value, one.position.good
        if not good.all() and good.any():
            between = np.interp(one.position.t_s, one.position.t_s[good], values[good])
            jumps += np.abs(values - between)[~good].tolist()
    if not jumps:
        return None
    share = len(jumps) / count
    centre = (share + NORMAL**2 / (2 * count)) / (1 + NORMAL**2 / count)
    half = math.sqrt(share * (1 - share) / count + (NORMAL / (2 * count)) ** 2) * NORMAL
    half /= 1 + NORMAL**2 / count
    gain = sum(CLIP * (jump / deviation_rad) - 0.5 * CLIP**2 for jump in jumps)
    return Cause(
        effect="lost_samples",
        scope=(observed[0].joint,),
        parameters={"share": Estimate(share, (max(0.0, centre - half), centre + half), "(ratio)")},
        held_out_gain_nats=max(0.0, float(gain)),
        explained_share=0.0,
        probability=1.0 - 0.5 ** len(jumps),
    )
