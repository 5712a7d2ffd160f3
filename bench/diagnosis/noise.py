"""How residuals scatter: the register's step, the instant's uncertainty, and what is coloured.

A residual is modelled as white noise plus an Ornstein-Uhlenbeck process, the plainest thing that
has a memory. Its likelihood is that of a Kalman filter with one state, and the filter's
standardised innovations are the whitened residual: linear in the residual, so that least squares
can use them. Samples that follow each other quickly then count for little more than one, as they
should; with independent samples assumed, a simulator that is merely not perfect seems to miss
physics in nearly every recording. What memory the innovations keep all the same is judged when two
hypotheses are compared, by the spread of their difference over stretches of time.

The white part is never below the register's step over sqrt(12), the deviation of rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import minimize

Floats = NDArray[np.float64]

LONGEST_MEMORY_S = 0.5  #: assumed: a misfit that lasts longer is none that noise explains
SHORTEST_MEMORY_S = 0.004  #: assumed: faster than this is white at any rate a bus can sample
ROUGH = {"maxiter": 40, "ftol": 1e-9, "eps": 1e-4}
FINE = {"maxfev": 60, "xatol": 0.01, "fatol": 0.05}  #: wild samples leave kinks in the likelihood
NONE = 0.1  #: of the floor: a coloured part below it is as good as none
LEAST_SWAY = 1e-6  #: of a squared length in deviations of noise: shorter ones do nothing
CLIP = 3.5  #: innovations beyond so many deviations count as linear, not square (Huber)


@dataclass(frozen=True, slots=True)
class Noise:
    """Deviations of the white and the coloured part (in the channel's unit), and memory [s]."""

    white: float
    coloured: float
    memory_s: float

    @property
    def total(self) -> float:
        """Deviation of a single residual."""
        return math.hypot(self.white, self.coloured)


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Residuals of one channel in one recording, shape (n,), at ascending times [s].

    ``extra`` is a known additional white variance of each sample: what an uncertain instant does to
    a moving joint. ``sways`` (n, k) is what happens to the whole recording as nobody knows how much
    of it did: each column times a number of deviation 1 (:mod:`bench.diagnosis.joint.sways`).
    """

    t_s: Floats
    value: Floats
    extra: Floats
    sways: Floats | None = None

    @property
    def scatter(self) -> Floats:
        """Known variance of each sample, however much of it is one number of many samples (n,)."""
        if self.sways is None:
            return self.extra
        found: Floats = self.extra + np.sum(self.sways**2, axis=1)
        return found

    def apart(self) -> Floats:
        """Samples about what is all along in those that are swayed together (n,)."""
        if self.sways is None:
            return self.value
        along = np.linalg.lstsq(self.sways, self.value, rcond=None)[0]
        found: Floats = self.value - self.sways @ along
        return found


@njit(cache=True, error_model="numpy")
def _filter(
    t: Floats,
    columns: Floats,
    extra: Floats,
    white: float,
    coloured: float,
    memory: float,
    out: Floats,
    deviation: Floats,
) -> float:
    """Standardised innovations of every column into ``out``; the sum of their log deviations."""
    n, width = columns.shape
    state = np.zeros(width)
    process = coloured * coloured
    variance = process
    total = 0.0
    for k in range(n):
        if k > 0:
            keep = math.exp(-(t[k] - t[k - 1]) / memory)
            for c in range(width):
                state[c] *= keep
            variance = process + keep * keep * (variance - process)
        spread = variance + white * white + extra[k]
        root = math.sqrt(spread)
        gain = variance / spread
        total += math.log(root)
        deviation[k] = root
        for c in range(width):
            innovation = columns[k, c] - state[c]
            out[k, c] = innovation / root
            state[c] += gain * innovation
        variance *= 1.0 - gain
    return total


@njit(cache=True, error_model="numpy")
def _calmed(white: Floats, count: int) -> float:
    """Whitened columns (n, k) without what the first ``count`` may sway them by, in place.

    Each factor is a root of the inverse of 1 + a a', so that squares of what comes out are those of
    a likelihood in which how much of every sway there is was summed over. Returns the sum of log
    deviations that belongs to it.
    """
    n, width = white.shape
    total = 0.0
    for c in range(count):
        square = 0.0
        for i in range(n):
            square += white[i, c] * white[i, c]
        if square < LEAST_SWAY:
            continue
        total += 0.5 * math.log(1.0 + square)
        share = (1.0 - 1.0 / math.sqrt(1.0 + square)) / square
        for j in range(c + 1, width):
            along = 0.0
            for i in range(n):
                along += white[i, c] * white[i, j]
            for i in range(n):
                white[i, j] -= share * along * white[i, c]
    return total


@njit(cache=True, error_model="numpy")
def _cost(
    t: Floats,
    value: Floats,
    extra: Floats,
    white: float,
    coloured: float,
    memory: float,
    clip: float,
) -> float:
    """Huber's cost of one column's innovations as :func:`_filter` has them, with their logs."""
    state = 0.0
    process = coloured * coloured
    variance = process
    total = 0.0
    for k in range(len(value)):
        if k > 0:
            keep = math.exp(-(t[k] - t[k - 1]) / memory)
            state *= keep
            variance = process + keep * keep * (variance - process)
        spread = variance + white * white + extra[k]
        gain = variance / spread
        innovation = value[k] - state
        size = abs(innovation) / math.sqrt(spread)
        total += 0.5 * math.log(spread)
        total += 0.5 * size * size if size <= clip else clip * (size - 0.5 * clip)
        state += gain * innovation
        variance *= 1.0 - gain
    return total


def whiten(block: Block, noise: Noise, columns: Floats) -> tuple[Floats, float]:
    """Whitened columns (n, k) as if each were the residual, and the sum of log deviations."""
    count = 0
    if block.sways is not None:
        count = block.sways.shape[1]
        columns = np.concatenate([block.sways, columns], axis=1)
    out = np.empty_like(columns)
    deviation = np.empty(len(columns))
    total = _filter(
        block.t_s,
        columns,
        block.extra,
        noise.white,
        noise.coloured,
        noise.memory_s,
        out,
        deviation,
    )
    if count:
        total += _calmed(out, count)
    return out[:, count:], float(total)


def calm(block: Block, noise: Noise) -> Block:
    """The block without what most likely swayed it."""
    assert block.sways is not None
    bare = replace(block, sways=None)
    white, _ = whiten(bare, noise, np.column_stack([block.sways, block.value]))
    sways, value = white[:, :-1], np.clip(white[:, -1], -CLIP, CLIP)
    much = np.linalg.solve(np.eye(sways.shape[1]) + sways.T @ sways, sways.T @ value)
    return replace(block, value=block.value - block.sways @ much)


def huber(z: Floats) -> Floats:
    """Half the square up to :data:`CLIP`, linear beyond: what an innovation costs [nats]."""
    size = np.abs(z)
    cost: Floats = np.where(size <= CLIP, 0.5 * z * z, CLIP * size - 0.5 * CLIP * CLIP)
    return cost


def huber_weight(z: Floats) -> Floats:
    """Weight of an innovation in least squares: 1 up to :data:`CLIP`, less the farther beyond."""
    weight: Floats = np.minimum(1.0, CLIP / np.maximum(np.abs(z), CLIP))
    return weight


def cost(block: Block, noise: Noise) -> float:
    """Negative log-likelihood [nats] of a block, without its constants."""
    if block.sways is not None:
        white, total = whiten(block, noise, block.value[:, None])
        return float(np.sum(huber(white[:, 0])) + total)
    return float(
        _cost(
            block.t_s, block.value, block.extra, noise.white, noise.coloured, noise.memory_s, CLIP
        )
    )


def estimate(
    blocks: Sequence[Block],
    floor: float,
    start: Noise | None = None,
) -> Noise:
    """The noise that makes some blocks of one channel likeliest; the white part is >= ``floor``."""
    spread = math.sqrt(float(np.mean([np.mean(b.value**2) for b in blocks]))) + 1e-12
    if start is None:
        start = Noise(1.2 * floor, max(0.7 * spread, 0.1 * floor), 0.1)
    box = (
        (math.log(floor), math.log(max(30.0 * spread, 2.0 * floor))),
        (math.log(1e-3 * floor), math.log(10.0 * (spread + floor))),
        (math.log(SHORTEST_MEMORY_S), math.log(LONGEST_MEMORY_S)),
    )

    def of(x: Floats) -> Noise:
        return Noise(math.exp(x[0]), math.exp(x[1]), math.exp(x[2]))

    def total(x: Floats) -> float:
        return sum(cost(b, of(x)) for b in blocks)

    def likeliest(begin: Noise) -> tuple[float, Noise]:
        first = np.clip(np.log([begin.white, begin.coloured, begin.memory_s]), *np.transpose(box))
        rough = minimize(total, first, method="L-BFGS-B", bounds=box, options=ROUGH)
        fine = minimize(total, rough.x, method="Nelder-Mead", bounds=box, options=FINE)
        return float(fine.fun), of(fine.x)

    best = likeliest(start)
    if best[1].coloured < NONE * floor:  # there nothing changes any more: no way leads back
        again = likeliest(Noise(1.2 * floor, 0.5 * floor, 0.1))
        best = min(best, again, key=lambda pair: pair[0])
    return best[1]
