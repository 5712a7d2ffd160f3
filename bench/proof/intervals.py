"""Intervals of 95 %: Wilson's for shares, the bootstrap for anything else."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
NORMAL_975 = 1.959964  #: of the standard normal distribution
DRAWS = 2000


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's interval (J. Am. Stat. Assoc. 22, 1927) of a share."""
    z2 = NORMAL_975**2
    share = hits / count
    middle = (share + z2 / (2 * count)) / (1 + z2 / count)
    spread = share * (1 - share) / count + z2 / (4 * count**2)
    half = NORMAL_975 * math.sqrt(spread) / (1 + z2 / count)
    return max(0.0, middle - half), min(1.0, middle + half)


def bootstrap(
    groups: Sequence[Floats], of: Callable[[Floats], float], seed: int = 0
) -> tuple[float, float]:
    """Percentile interval of a statistic of rows, whole groups (cases) drawn again."""
    random = np.random.default_rng([seed, 32])
    found = []
    for _ in range(DRAWS):
        drawn = random.integers(0, len(groups), len(groups))
        found.append(of(np.concatenate([groups[i] for i in drawn])))
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)
