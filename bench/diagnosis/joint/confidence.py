"""How sure a number of a fit is: what diagnoses of a joint and of a whole robot have in common.

The likelihood's own curvature is far too sure of itself, as the model is never quite right. The
*sandwich* variance asks instead how far the scores (derivatives of the likelihood) of stretches of
time differ from each other, which neighbours with a memory in common do not do for chance alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..knobs import Knob
from ..result import DEAD, Estimate
from .fit import EDGE

Floats = NDArray[np.float64]

NORMAL = 1.96  #: deviations of an interval of 95 %
STRETCH_S = 0.5  #: over which scores are summed; assumed longer than any memory
WIDE = 3.0  #: times its size that a deviation is, from which a number is called flat
BLIND = 1e6  #: believed variance from which nothing depends on a number
TRADED = 0.9  #: believed correlation from which two numbers stand for each other


def stretches(times_s: Iterable[Floats]) -> NDArray[np.intp]:
    """Number of the stretch of every sample, block after block; ``times_s`` are the blocks'."""
    starts = [1e6 * number + np.floor(t_s / STRETCH_S) for number, t_s in enumerate(times_s)]
    found: NDArray[np.intp] = np.unique(np.concatenate(starts), return_inverse=True)[1]
    return found


def sandwich(believed: Floats, scores: Floats, cluster: NDArray[np.intp], prior: Floats) -> Floats:
    """Covariance (k, k) when scores (n, k) are summed over clusters of samples (n,).

    ``believed`` is the likelihood's own covariance, ``prior`` what priors know of each number.
    """
    sums = np.zeros((int(cluster.max()) + 1, scores.shape[1]))
    np.add.at(sums, cluster, scores)
    covariance: Floats = believed @ (sums.T @ sums + np.diag(prior)) @ believed
    return covariance


def state(
    z: Floats, k: int, deviation: float, knob: Knob, believed: Floats, others: Sequence[str]
) -> str:
    """Whether data pins number ``k`` of a vector ``z``, the value of a knob; else why not.

    ``others`` names all numbers of the vector, "" for those that are held and stand for nothing.
    """
    low, high = knob.bounds
    spread = np.sqrt(np.outer(np.diag(believed), np.diag(believed)) + 1e-300)
    alike = np.abs(believed / spread)[k]
    free = [j for j, name in enumerate(others) if name and j != k]
    nearest = max(free, key=lambda j: alike[j], default=k)
    at = float(z[k])
    if believed[k, k] > BLIND:
        return DEAD
    if deviation > WIDE * max(1.0, abs(at)):
        return "flat"
    if at <= low + EDGE or at >= high - EDGE:
        return "at bound"
    if nearest != k and alike[nearest] > TRADED:
        return f"trade-off with {others[nearest]}"
    return "pinned"


def estimate(knob: Knob, z: float, ends: Iterable[float], said: str) -> Estimate:
    """A knob's value with the ends of its interval (values stay in their bounds), and its state.

    A dead number that nothing moved from off is off, not a rounding away from it.
    """
    z = 0.0 if said == DEAD and abs(z) < EDGE else z
    values = [knob.value(end) for end in ends]
    return Estimate(knob.value(z), (min(values), max(values)), knob.parameter.unit, said)
