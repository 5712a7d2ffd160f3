"""A straight line through points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Line:
    """``y = slope x + offset``, how much of the variation it explains, and its repeats' spread."""

    slope: float
    offset: float
    r2: float
    spread: float = 0.0  #: standard deviation of the slopes of single repeats


def fit_line(x: Floats, y: Floats) -> Line:
    """Least squares through the points that are there; all NaN with fewer than three of them."""
    there = ~(np.isnan(x) | np.isnan(y))
    x, y = x[there], y[there]
    if len(x) < 3 or np.ptp(x) == 0.0:
        return Line(float("nan"), float("nan"), float("nan"))
    slope, offset = np.polyfit(x, y, 1)
    left = y - (slope * x + offset)
    variance = float(np.var(y))
    r2 = 1.0 - float(np.var(left)) / variance if variance > 0.0 else float("nan")
    return Line(float(slope), float(offset), r2)
