"""What a step's answer is like: rise, overshoot, settling, steady error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: The last share of the samples, whose mean is where the joint came to rest.
AT_REST = 0.2


@dataclass(frozen=True, slots=True)
class StepAnswer:
    """One answer to a step; times from the goal on [s], NaN where it never came to that."""

    rise_s: float  #: from 10 % to 90 % of the way to where it came to rest
    overshoot: float  #: largest way beyond where it came to rest, as a share of the way
    settling_s: float  #: after which it stays within the tolerance of where it came to rest
    final_rad: float
    steady_error_rad: float  #: goal minus where it came to rest


def answer(
    t_s: Floats, position_rad: Floats, start_rad: float, goal_rad: float, tolerance_rad: float
) -> StepAnswer:
    """Measure an answer; ``t_s`` and ``position_rad`` of shape (samples,), at least five.

    ``t_s`` counts from the goal, ``start_rad`` is where the joint was.
    """
    rest = max(1, round(AT_REST * len(t_s)))
    final = float(np.mean(position_rad[-rest:]))
    way = final - start_rad
    if way == 0.0:
        nan = float("nan")
        return StepAnswer(nan, 0.0, nan, final, goal_rad - final)
    share = (position_rad - start_rad) / way
    outside = np.flatnonzero(np.abs(position_rad - final) > tolerance_rad)
    last = int(outside[-1]) + 1 if len(outside) else 0
    return StepAnswer(
        rise_s=_crossing(t_s, share, 0.9) - _crossing(t_s, share, 0.1),
        overshoot=max(0.0, float(share.max()) - 1.0),
        settling_s=float(t_s[last]) if last < len(t_s) else float("nan"),
        final_rad=final,
        steady_error_rad=goal_rad - final,
    )


def _crossing(t_s: Floats, share: Floats, level: float) -> float:
    """When ``share`` first reaches ``level``, linear between samples; NaN if it never does."""
    at = np.flatnonzero(share >= level)
    if not len(at):
        return float("nan")
    i = int(at[0])
    if i == 0:
        return float(t_s[0])
    part = (level - share[i - 1]) / (share[i] - share[i - 1])
    return float(t_s[i - 1] + part * (t_s[i] - t_s[i - 1]))
