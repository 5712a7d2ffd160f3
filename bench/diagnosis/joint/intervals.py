"""Intervals of parameters: as wide as the noise, the recordings and the two engines leave them.

The likelihood's own curvature is far too sure of itself: the model is never quite right. So the
variance of a number is the greatest of what the likelihood believes, what its scores say when they
are summed over stretches of time, and when they are summed over whole recordings (friction and
supply are not quite the same in each); what two sound simulations differ by is added. Along a bent
valley no formula holds: there the number is moved and held while the others are fitted again, until
the likelihood falls by what that variance allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from sim.stepped import TICK_S

from ..knobs import Knob
from ..noise import huber_weight, whiten
from ..result import Estimate
from .confidence import NORMAL, estimate, sandwich, state, stretches
from .fit import EDGE, Around, Fit, bounds, fit
from .floor import ENGINE_RAD
from .model import JointModel, Kind

Floats = NDArray[np.float64]

ENGINE_S = 0.3  #: assumed memory of what two simulations differ by
DRAWS = 40  #: of such a difference
KEPT = 0.2  #: of what seems to be known in a direction, however rough
FALL = 0.5 * NORMAL**2  #: of the likelihood at its ends [nats, deflated]
REACH = (1.0, 2.0, 4.0)  #: half widths at which an end is looked for
#: of an effect's distance from off, by which two sound simulations mean another size by the same
#: motion (standard deviation). With 0.05 intervals held 0.84 of 114 sizes of opened cases, 0.72
#: without it, and 0.86 of 133 in the proofs after that
ENGINES_SHARE = 0.08
#: of a delay or skew (standard deviation): where in its tick a firmware takes goals and angles is
#: not known, up to a tick either way
TICKS_S = TICK_S / math.sqrt(3.0)
UNSEEN = 1e4  #: variance of a number, in its unit, whose steps change nothing
SOON = 0.5  #: of the fall, at which the formula's end holds


def covariances(model: JointModel, found: Fit) -> tuple[Floats, Floats]:
    """What the likelihood believes of the errors of a vector, and what scores by stretch say.

    Cheaply: roughness is not taken off, which makes both smaller alike.
    """
    spread = Spread(model, found, both_ways=False)
    return spread.believed, spread.sandwich(spread.stretches)


def _smooth(information: Floats, added: Floats) -> Floats:
    """What is known in every direction, less what roughness added, but never below a share."""
    own = np.diag(information)
    scale = np.sqrt(np.maximum(own, 1e-12))
    whole = information / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(whole - np.diag(np.minimum(added, own) / scale**2))
    least = KEPT * np.einsum("ik,ij,jk->k", vectors, whole, vectors)
    kept: Floats = (vectors * np.maximum(values, least)) @ vectors.T
    kept *= np.outer(scale, scale)
    return kept


def _inverse(information: Floats) -> Floats:
    """Variances of what is known so well, each number in its own measure: of little known, much."""
    scale = np.sqrt(np.diag(information))
    variances: Floats = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    variances /= np.outer(scale, scale)
    return variances


class Spread:
    """How sure a fit can be of its numbers: variances in the order of its vector."""

    def __init__(self, model: JointModel, found: Fit, *, both_ways: bool = True) -> None:
        self.model, self.found = model, found
        around = Around(model, found.hypothesis, found.z, found.noise)
        residual = around.residual
        if both_ways:
            jacobian, added = around.slopes()
        else:
            size, change = around.forward()
            jacobian, added = change / size, np.zeros(len(size))
        self.blocks = model.residuals(found.hypothesis, [found.z])[0]
        weight = huber_weight(residual)
        self.weighted = jacobian * weight[:, None]
        self.scores = self.weighted * residual[:, None]
        self.prior = np.zeros(jacobian.shape[1])
        self.prior[: len(model.nuisances)] = 1.0
        normal = _smooth(self.weighted.T @ jacobian, added)
        normal += np.diag(self.prior + 1e-9)
        low, high = bounds(model, found.hypothesis)
        free = np.flatnonzero(low < high)
        self.believed: Floats = np.zeros_like(normal)
        self.believed[np.ix_(free, free)] = _inverse(normal[np.ix_(free, free)])
        recordings = [np.full(len(block.t_s), r) for (r, _), block in self.blocks.items()]
        self.stretches = stretches(block.t_s for block in self.blocks.values())
        self.recordings = np.unique(np.concatenate(recordings), return_inverse=True)[1]

    def sandwich(self, cluster: NDArray[np.intp]) -> Floats:
        """Covariance when scores are summed over clusters of samples."""
        return sandwich(self.believed, self.scores, cluster, self.prior)

    def between_recordings(self) -> Floats:
        """Covariance when scores are summed over recordings, widened as these are few."""
        count = int(self.recordings.max()) + 1
        if count < 2:
            return self.believed
        widened = (student.ppf(0.975, count - 1) / NORMAL) ** 2 * count / (count - 1)
        covariance: Floats = self.sandwich(self.recordings) * widened
        return covariance

    def between_engines(self, seed: int = 0) -> Floats:
        """Covariance that a difference between two sound simulations makes.

        In a duty register it is how the value was rounded: up to half a step towards 0 or away.
        """
        random = np.random.default_rng(seed)
        moved = np.zeros((DRAWS, self.scores.shape[1]))
        first = 0
        rounded = random.uniform(-0.5, 0.5, DRAWS)
        for (r, kind), block in self.blocks.items():
            count = len(block.t_s)
            if kind is Kind.DUTY:
                shown = self.model.observed[r].channels[kind.channel]
                way = np.sign(np.interp(block.t_s, shown.t_s, shown.value))
                difference = shown.quantum * np.outer(way, rounded)
                white, _ = whiten(block, self.found.noise[kind], difference)
                moved += white.T @ self.weighted[first : first + count]
            if kind is Kind.POSITION:
                steps = random.standard_normal((count, DRAWS))
                keep = np.exp(-np.diff(block.t_s, prepend=block.t_s[:1]) / ENGINE_S)
                keep[0] = 0.0
                difference = np.empty_like(steps)
                last = np.zeros(DRAWS)
                for k in range(count):
                    last = keep[k] * last + np.sqrt(1.0 - keep[k] ** 2) * steps[k]
                    difference[k] = last
                white, _ = whiten(block, self.found.noise[kind], ENGINE_RAD * difference)
                moved += white.T @ self.weighted[first : first + count]
            first += count
        shifts = moved @ self.believed
        covariance: Floats = shifts.T @ shifts / DRAWS
        return covariance

    @cached_property
    def accounts(self) -> tuple[Floats, ...]:
        """Covariances as the likelihood, stretches of time and whole recordings have them."""
        engines = self.between_engines()
        within = (self.believed, self.sandwich(self.stretches), self.between_recordings())
        return tuple(covariance + engines for covariance in within)

    def variances(self) -> Floats:
        """What intervals are made of."""
        total: Floats = np.max([np.diag(account) for account in self.accounts], axis=0)
        return total

    def seen_by_steps(self, own: Sequence[int]) -> bool:
        """Whether small steps of some numbers change anything: not where something is or is not."""
        return bool((np.diag(self.believed)[list(own)] < UNSEEN).any())

    def doubt(self, own: Sequence[int]) -> float:
        """How much too sure of some numbers together the likelihood is, by the widest account."""
        z, block = self.found.z[list(own)], np.ix_(own, own)
        believed, *distances = [
            float(z @ np.linalg.pinv(account[block], hermitian=True) @ z)
            for account in (self.believed, *self.accounts)
        ]
        return max(1.0, believed / max(min(distances), 1e-300))


def interval(
    model: JointModel, found: Fit, spread: Spread, variances: Floats, k: int
) -> tuple[float, float]:
    """The ends of number ``k`` of a fit's vector, of 95 %."""
    low, high = (float(b[k]) for b in bounds(model, found.hypothesis))
    own = max(float(spread.believed[k, k]), 1e-30)
    half = NORMAL * float(np.sqrt(variances[k]))
    deflated = max(1.0, float(variances[k]) / own)
    ridge = spread.believed[:, k] / own
    middle = float(found.z[k])
    effect = found.hypothesis.knobs[k - len(model.nuisances)].effect
    if sum(knob.effect == effect for knob in found.hypothesis.knobs) == 1:  # no valley
        return max(low, middle - half), min(high, middle + half)
    ends = []
    for side in (-1.0, 1.0):
        end = middle + side * half
        before = 0.0
        for reach in REACH:
            at = min(high, max(low, middle + side * reach * half))
            start = found.z + ridge * (at - middle)
            start[k] = at
            tried = fit(
                model, found.hypothesis, start, found.noise, rounds=1, evaluations=2, held=[k]
            )
            fall = (tried.cost - found.cost) / deflated
            end = at
            if fall > FALL and abs(at - middle) < half - EDGE:  # a bound, and beyond the end
                end = middle + (at - middle) * float(np.sqrt(FALL / fall))
                break
            if fall >= FALL or (reach == REACH[0] and fall > SOON * FALL) or at in (low, high):
                if reach > REACH[0] and fall > before:
                    last = middle + side * half * reach / 2.0
                    end = last + (at - last) * (FALL - before) / max(fall - before, FALL - before)
                break
            before = max(0.0, fall)
        ends.append(end)
    return ends[0], ends[1]


def widened(found: Fit, variances: Floats, knob: Knob, k: int) -> Floats:
    """Variances with what two sound simulations mean by number ``k``, a size of an effect.

    Of a time that is also where in their ticks two firmwares take goals and angles.
    """
    variances = variances.copy()
    if knob.logarithmic:
        variances[k] += ENGINES_SHARE**2
    elif not knob.parameter.shape:
        variances[k] += (ENGINES_SHARE * float(found.z[k])) ** 2
        if knob.parameter.unit == "s":
            variances[k] += (TICKS_S / knob.unit) ** 2
    return variances


def may_be_nothing(model: JointModel, found: Fit, spread: Spread, effect: str) -> bool:
    """Whether the intervals of all sizes of an effect hold its off value."""
    variances, count = spread.variances(), len(model.nuisances)
    for i, knob in enumerate(found.hypothesis.knobs):
        if knob.effect != effect or knob.parameter.shape:
            continue
        wide = widened(found, variances, knob, count + i)
        low, high = interval(model, found, spread, wide, count + i)
        if low > EDGE or high < -EDGE or _falls(model, found, spread, variances, count + i):
            return False
    return True


def _falls(model: JointModel, found: Fit, spread: Spread, variances: Floats, k: int) -> bool:
    """Whether the likelihood falls by more than an interval's ends do where a number is off.

    Where what could stand in for it has gone as far as it may, variances do not know that.
    """
    knob = found.hypothesis.knobs[k - len(model.nuisances)]
    if knob.parameter.unit == "s":
        return False
    own = max(float(spread.believed[k, k]), 1e-30)
    start = found.z.copy()
    start[k] = 0.0
    off = fit(model, found.hypothesis, start, found.noise, rounds=1, held=[k])
    return (off.cost - found.cost) / max(1.0, float(variances[k]) / own) > FALL


def estimates(model: JointModel, found: Fit, effect: str) -> dict[str, Estimate]:
    """Parameters of an effect with their intervals and states."""
    spread = Spread(model, found)
    variances = spread.variances()
    low, high = bounds(model, found.hypothesis)
    count = len(model.nuisances)
    names = [n.name for n in model.nuisances] + [k.name for k in found.hypothesis.knobs]
    names = [name if low[j] < high[j] else "" for j, name in enumerate(names)]
    made = {}
    for i, knob in enumerate(found.hypothesis.knobs):
        if knob.effect != effect:
            continue
        k = count + i
        wide = widened(found, variances, knob, k)
        ends = interval(model, found, spread, wide, k)
        said = state(found.z, k, float(np.sqrt(wide[k])), knob, spread.believed, names)
        made[knob.parameter.name] = estimate(knob, float(found.z[k]), ends, said)
    return made
