"""How a trunk leans over the phase of a gait, where a sensor on it or an observer saw that.

Which way its axes point nobody tells: "roll" is about the axis forward to some and sideways to
others, and a board may sit turned about. So the recorded angles are taken for those of the robot
that an exact replay comes nearest to. Nor is it known how level the sensor sits, so that only what
an angle does about its mean is compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

AXES = 2
#: which of the recorded angles each of the robot's two is, and its sign
Turn = tuple[tuple[int, int], tuple[int, int]]
TURNS: tuple[Turn, ...] = tuple(
    ((first, one), (1 - first, other)) for first, one, other in product((0, 1), (1, -1), (1, -1))
)


def rows_of(means_rad: Sequence[Floats]) -> Floats:
    """Means in bins, an array an angle, about their own mean and one after another (rows,)."""
    return np.concatenate([means - np.nanmean(means) for means in means_rad])


def turned(rows_rad: Floats, turn: Turn) -> Floats:
    """Rows of recorded angles as the robot's own."""
    halves = np.split(rows_rad, AXES)
    return np.concatenate([sign * halves[axis] for axis, sign in turn])


def nearest(recorded: Sequence[Floats], replayed: Sequence[Floats]) -> Turn:
    """The turn by which recorded rows come nearest to replayed ones, all recordings together."""

    def square(turn: Turn) -> float:
        every = zip(recorded, replayed, strict=True)
        return float(sum(np.nansum((turned(seen, turn) - told) ** 2) for seen, told in every))

    return min(TURNS, key=square)
