"""How often a load register is renewed: seen in the data itself, without a model."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..observed import Channel, Observed
from ..periods import own_period
from ..result import Cause, Estimate
from .confidence import NORMAL


def load_refresh(observed: Sequence[Observed], believed_s: float) -> Cause | None:
    """A register that changes only at whole periods, as a cause; ``None`` where it does not.

    ``believed_s`` is the period of the servo's file, 0 where every value is taken for new. The gain
    [nats] is that of gaps which would as well end at any sample.
    """
    told = (one.channels[Channel.DUTY] for one in observed if Channel.DUTY in one.channels)
    seen = own_period(((samples.t_s, samples.value) for samples in told), believed_s)
    if seen is None:
        return None
    period, step, gaps = seen
    half = NORMAL * step / math.sqrt(gaps)
    return Cause(
        effect="load_refresh",
        scope=(observed[0].joint,),
        parameters={"period_s": Estimate(period, (period - half, period + half), "s")},
        held_out_gain_nats=gaps * math.log(period / step),
        explained_share=0.0,
        probability=1.0 - 1.0 / gaps,
    )
