"""Out of the first hollow: fits of effects whose numbers make up for each other.

Numbers like a heat resistance and its time constant, or a spring and where it rests, lie in a long,
bent and rough valley, in which least squares stop early. So each number that shapes an effect is
moved by hand and held while the others are fitted; if that leads further down, the fit goes on
from there.
"""

from __future__ import annotations

import numpy as np

from .fit import Fit, fit
from .model import JointModel

MOVES = (-0.7, 0.7)  #: in units of a shape; of the value, for a number that is an amount
LOOSE = 0.1  #: least of these units for an amount
DEEPER = 3.0  #: gain [nats] that counts: friction and rounding leave the likelihood rough
WALKS = 4  #: how often the best move is followed


def explore(model: JointModel, found: Fit, effect: str) -> Fit:
    """The fit, or a deeper one with the numbers of an effect elsewhere."""
    count = len(model.nuisances)
    own = [count + i for i, k in enumerate(found.hypothesis.knobs) if k.effect == effect]
    if len(own) < 2:
        return found
    for _ in range(WALKS):
        best = found
        for k in own:
            knob = found.hypothesis.knobs[k - count]
            unit = 1.0 if knob.parameter.shape else max(LOOSE, abs(float(found.z[k])))
            for move in MOVES:
                start = found.z.copy()
                start[k] = np.clip(start[k] + move * unit, *knob.bounds)
                if start[k] == found.z[k]:
                    continue
                tried = fit(
                    model, found.hypothesis, start, found.noise, rounds=1, evaluations=2, held=[k]
                )
                if tried.cost < best.cost:
                    best = tried
        if best.cost > found.cost - DEEPER:
            break
        found = fit(model, best.hypothesis, best.z, best.noise)
    return found
