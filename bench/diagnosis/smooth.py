"""Angles that no motion has: a body has inertia, so that its way is nowhere much rougher."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

FAR_QUANTA = 8.0  #: of the register, that an angle must be off its neighbours; assumed
NEAR = 5  #: samples on either side that tell how smooth a motion is
ROUGHER = 4.0  #: times as far off as any of them; assumed
GAP = 8.0  #: usual steps of time within which two neighbours on either side must lie
BESIDE = (-2, -1, 1, 2)


def smooth(t_s: Floats, angles: Floats, quantum: float) -> Mask:
    """Where angles [rad], shape (n,), are no glitches; ``quantum`` is the register's step.

    A glitch is more than eight steps off the cubic through its two neighbours on either side, and
    four times as far as any angle near it is once it is taken out itself. However fast a joint is,
    one sample cannot leave its way and the next be on it again.
    """
    result = np.ones(len(angles), bool)
    off = _off_cubic(t_s, angles)
    for k in np.flatnonzero(np.abs(off) > FAR_QUANTA * quantum).tolist():
        near = slice(max(0, k - NEAR), k + NEAR + 1)
        others = angles[near].copy()
        others[k - near.start] -= off[k]
        usual = float(np.abs(_off_cubic(t_s[near], others)).max())
        result[k] = abs(off[k]) <= FAR_QUANTA * quantum + ROUGHER * usual
    return result


def follows(t_s: Floats, angles: Floats, quantum: float) -> Mask:
    """Where angles [rad], shape (n,), lie within eight steps of the cubic through their neighbours.

    The top of an overshoot does, that stands out above both its neighbours. Not so at ends and
    beside gaps, where there is no such cubic.
    """
    result = np.zeros(len(angles), bool)
    k = _between(t_s)
    result[k] = np.abs(_off_cubic(t_s, angles)[k]) <= FAR_QUANTA * quantum
    return result


def _between(t_s: Floats) -> NDArray[np.int64]:
    """Samples that have two neighbours on either side, and no gap among them."""
    if len(t_s) < 5:
        return np.zeros(0, np.int64)
    steps = np.diff(t_s)
    least = np.lib.stride_tricks.sliding_window_view(steps, 4).min(axis=1)
    k = np.arange(2, len(t_s) - 2)
    known: NDArray[np.int64] = k[(t_s[k + 2] - t_s[k - 2] < GAP * np.median(steps)) & (least > 0.0)]
    return known


def _off_cubic(t_s: Floats, values: Floats) -> Floats:
    """How far values are off the cubic through their neighbours; 0 at ends and beside gaps."""
    off = np.zeros(len(values))
    k = _between(t_s)
    off[k] = values[k]
    for a in BESIDE:
        weight = np.ones(len(k))
        for b in BESIDE:
            if a != b:
                weight *= (t_s[k] - t_s[k + b]) / (t_s[k + a] - t_s[k + b])
        off[k] -= weight * values[k + a]
    return off
