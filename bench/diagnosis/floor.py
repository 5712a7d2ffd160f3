"""How small a misfit can be: rounding, and the spread of repeats of one experiment."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .observed import Observed

Floats = NDArray[np.float64]

ENGINE_RAD = 0.0015  #: what two sound simulations of one joint differ by; see docs on two engines


def tolerance(floor_rad: float) -> float:
    """Deviation [rad] below which a difference between a model and a recording is no physics."""
    return float(np.hypot(floor_rad, ENGINE_RAD))


def noise_floor(observed: Sequence[Observed]) -> float:
    """Deviation [rad] of a position that a perfect model would leave.

    Rounding to the register's step; where an experiment was repeated, the spread between repeats
    with the mean difference taken out (a zero that moved is a nuisance), if that is more.
    """
    rounding = max(o.position.quantum for o in observed) / np.sqrt(12.0)
    squares = [spread**2 for pair in _pairs(observed) if (spread := _spread(*pair)) is not None]
    return float(max(rounding, np.sqrt(np.mean(squares)))) if squares else float(rounding)


def _pairs(observed: Sequence[Observed]) -> list[tuple[Observed, Observed]]:
    groups: dict[str, list[Observed]] = {}
    for one in observed:
        groups.setdefault(one.group, []).append(one)
    return [pair for some in groups.values() for pair in itertools.pairwise(some)]


def _spread(one: Observed, other: Observed) -> float | None:
    """Deviation of a single repeat, from the difference of two at like times since the start."""
    a, b = one.position, other.position
    end = min(a.t_s[-1], b.t_s[-1])
    t = a.t_s[a.good & (a.t_s <= end)]
    if len(t) < 10 or not _same_goals(one, other, t):
        return None
    difference = np.interp(t, b.t_s[b.good], b.value[b.good]) - a.value[a.good & (a.t_s <= end)]
    return float(np.std(difference) / np.sqrt(2.0))


def _same_goals(one: Observed, other: Observed, t: Floats) -> bool:
    """Whether two recordings were told nearly the same: within a few steps, most of the time."""
    goals = [np.interp(t, *o.goal) for o in (one, other)]
    close = np.abs(goals[0] - goals[1]) < 10.0 * one.position.quantum
    return bool(np.mean(close) > 0.9)
