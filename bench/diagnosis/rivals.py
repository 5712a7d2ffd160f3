"""What a named effect could be instead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim.effects import Effect

from .fit import Fit
from .model import JointModel
from .result import Rival
from .search import Gain, Progress, confirm, drop, screen

TRIED = 5  #: rivals that are fitted in an effect's place
CLOSE = 4.0  #: nats (deflated) within which a rival is not told apart
TEMPER = 0.5  #: of gains, when they become probabilities: see docs on power


def rivals(
    model: JointModel,
    now: Fit,
    name: str,
    effects: Mapping[str, Effect],
    known: Sequence[Gain],
    say: Progress,
) -> tuple[float, list[Rival], Fit]:
    """Probability of an effect among all fitted in its place, those close, the fit without it."""
    say(f"what {name} could be instead")
    without, own = drop(model, now, name)
    gains: dict[str, float] = {}
    if len(now.hypothesis.effects) == 1:  # the search has fitted them already
        for gain in known:
            if gain.effect != name and gain.fit.hypothesis.effects == (gain.effect,):
                gains[gain.effect] = gain.deflated
    else:
        others = [
            e for n, e in effects.items() if n != name and n not in without.hypothesis.effects
        ]
        for _, other, start in screen(model, without, others)[:TRIED]:
            gains[other] = confirm(model, without, effects[other], start).deflated
    weights = {other: float(np.exp(TEMPER * min(0.0, g - own))) for other, g in gains.items()}
    total = 1.0 + sum(weights.values()) + float(np.exp(-TEMPER * own))
    close = [
        Rival(other, (model.observed[0].joint,), weights[other] / total, own - gain)
        for other, gain in gains.items()
        if own - gain < CLOSE
    ]
    return 1.0 / total, sorted(close, key=lambda r: r.behind_nats), without
