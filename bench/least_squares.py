"""The linear algebra of a calibration: least squares with lower bounds, and row reduction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Entries below this share of a matrix's largest are taken for zero. What is reduced here are
#: derivatives of times by parts of them: whole and half numbers, over standard errors.
FLAT = 1e-4


def bounded_least_squares(matrix: Floats, wanted: Floats, lower: Floats) -> Floats:
    """The ``x >= lower`` with the least ``|matrix x - wanted|``; shapes (m, n), (m,), (n,).

    The active-set method of Lawson and Hanson, *Solving Least Squares Problems*, 1974, chapter 23.
    """
    count = matrix.shape[1]
    target = wanted - matrix @ lower
    x = np.zeros(count)
    free = np.zeros(count, dtype=bool)
    for _ in range(10 * count + 10):
        gradient = matrix.T @ (target - matrix @ x)
        candidates = np.where(~free, gradient, -np.inf)
        best = int(np.argmax(candidates)) if count else 0
        if not count or candidates[best] <= 1e-10 * (1.0 + float(np.abs(gradient).max())):
            break
        free[best] = True
        while True:
            trial = np.zeros(count)
            trial[free] = np.linalg.lstsq(matrix[:, free], target, rcond=None)[0]
            if np.all(trial[free] > 0.0):
                break
            blocked = free & (trial <= 0.0)
            share = float(np.min(x[blocked] / (x[blocked] - trial[blocked] + 1e-300)))
            x = x + share * (trial - x)
            free &= x > 1e-15
            x[~free] = 0.0
        x = trial
    return np.asarray(x + lower)


def row_reduced(matrix: Floats) -> list[tuple[int, Floats]]:
    """Row-reduced echelon form: (pivot column, row) of each row that is not zero."""
    rows = matrix / max(float(np.abs(matrix).max(initial=0.0)), 1e-300)
    reduced: list[tuple[int, Floats]] = []
    for column in range(rows.shape[1]):
        if not len(rows):
            break
        pivot = int(np.argmax(np.abs(rows[:, column])))
        if abs(rows[pivot, column]) < FLAT:
            continue
        row = rows[pivot] / rows[pivot, column]
        rows = np.delete(rows, pivot, axis=0)
        rows = rows - np.outer(rows[:, column], row)
        reduced = [(at, other - other[column] * row) for at, other in reduced]
        reduced.append((column, row))
    return reduced
