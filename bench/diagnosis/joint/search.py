"""What effects gain: confirmed by fits, judged on recordings left out.

What a hypothesis gains is a difference of log-likelihoods [nats] with all nuisances fitted again.
The noise model is never quite right, so a gain counts only after it is divided by its *inflation*:
how much wider the sandwich variance of the effect's own parameters is, with the scores summed over
stretches of time, than the variance the likelihood believes in (White, 1982; Takeuchi's penalty is
the same ratio). What nuisances need no longer stray is known of them beforehand, and counts as it
is. Then it must hold on recordings the fit has not seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.effects import Effect

from ..knobs import effect_knobs
from .fit import Fit, fit, prior_cost
from .intervals import covariances
from .model import JointModel, Kind
from .remaining import Score, score

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

NEEDED = 7.0  #: gain [nats, deflated] of an effect to be taken; see docs on power
HELD_OUT = 1.5  #: gain [nats, deflated] it must have on recordings not used to fit
STRAYED = 50.0  #: nats that a fit without a group may lose on it, to be a judge there
HARM = 0.3  #: of the squared noise floor that it may add to another kind, or where it is judged
NUMBER_NATS = 1.5  #: gain [nats, deflated] that every number of an effect must be worth


@dataclass(frozen=True, slots=True, eq=False)
class Gain:
    """What an effect gains over a hypothesis without it."""

    effect: str
    fit: Fit
    nats: float  #: as likelihood and priors have it
    inflation: float  #: what the likelihood's part must be divided by, at least 1
    relief: float = 0.0  #: of that, what nuisances cost less under their priors [nats]
    held_out: Outside | None = None  #: on recordings not used to fit

    @property
    def deflated(self) -> float:
        """The gain that counts [nats]."""
        return self.counted(self.inflation)

    def counted(self, inflation: float) -> float:
        """The gain if the likelihood is so much too sure of itself [nats]."""
        return (self.nats - self.relief) / inflation + self.relief

    @property
    def outside(self) -> float:
        """What it gains on recordings not used to fit, as it counts [nats]."""
        return self.held_out.nats / self.inflation if self.held_out is not None else 0.0

    def over(self, model: JointModel, base: Fit) -> Gain:
        """The same effect and its fit, over another fit without it."""
        relief = prior_cost(model, base.z) - prior_cost(model, self.fit.z)
        return replace(self, nats=base.cost - self.fit.cost, relief=relief)

    @property
    def unlikely(self) -> float:
        """How unlikely a size so far beyond the typical one is beforehand [nats]: Cauchy's prior.

        A weight ten typical errors off is not impossible; of two causes that fit as well, the other
        is meant.
        """
        knobs = self.fit.hypothesis.knobs
        sizes = zip(knobs, self.fit.z[len(self.fit.z) - len(knobs) :].tolist(), strict=True)
        return sum(
            math.log1p(z * z)
            for knob, z in sizes
            if knob.effect == self.effect and not knob.parameter.shape
        )


def inflation(model: JointModel, found: Fit, knobs: Sequence[int]) -> float:
    """How much too narrow the likelihood believes some numbers of a vector to be, at least 1."""
    believed, sandwich = covariances(model, found)
    ratios = [sandwich[k, k] / believed[k, k] for k in knobs if believed[k, k] > 0.0]
    return float(max([1.0, *ratios]))


def confirm(model: JointModel, base: Fit, effect: Effect, start: Floats) -> Gain:
    """Fit a hypothesis with one effect more."""
    hypothesis = base.hypothesis + effect_knobs(effect)
    found = fit(model, hypothesis, start, base.noise, rounds=3)
    own = [
        k
        for k in range(len(base.z), len(found.z))
        if not hypothesis.knobs[k - len(model.nuisances)].parameter.shape
    ]
    return Gain(effect.name, found, 0.0, inflation(model, found, own)).over(model, base)


def folds(model: JointModel) -> list[list[int]]:
    """Recordings by group, dealt into at most four parts; one part when there is one group."""
    groups: dict[str, list[int]] = {}
    for r, observed in enumerate(model.observed):
        groups.setdefault(observed.group, []).append(r)
    parts: list[list[int]] = [[] for _ in range(min(4, len(groups)))]
    for k, group in enumerate(sorted(groups)):
        parts[k % len(parts)] += groups[group]
    return parts


@dataclass(frozen=True, slots=True)
class Outside:
    """What an effect gains on groups left out: nats, and squares by kind over the noise's own."""

    nats: float
    relief: float  #: the most any kind's mean square falls, in squares of its noise floor
    harm: float  #: the most any kind's mean square rises


def score_outside(model: JointModel, found: Fit) -> list[Score]:
    """How a hypothesis does on every part of the recordings, fitted anew without that part."""
    parts = folds(model)
    everything = range(len(model.observed))
    scores = []
    for part in parts:
        rest = [r for r in everything if r not in part] or part
        again = fit(model, found.hypothesis, found.z, found.noise, rest, rounds=1, evaluations=3)
        scores.append(replace(score(model, again, part), seen=score(model, found, part)))
    return scores


def inside(model: JointModel, without: Fit, with_it: Fit, floors: Mapping[Kind, float]) -> Outside:
    """The same comparison on all recordings of a model, with the fits as they are."""
    everything = range(len(model.observed))
    before, after = (score(model, found, everything) for found in (without, with_it))
    return held_out([before], [after], floors)


def held_out(
    without: Sequence[Score], with_it: Sequence[Score], floors: Mapping[Kind, float]
) -> Outside:
    """Compare two hypotheses on groups left out.

    Of a group unlike all others the rest does not tell how to fit it, and what it would say is
    mostly where nuisances happened to go without it: there, fits that have seen it are compared.
    """
    pairs = [
        (a.seen, b.seen) if a.seen and b.seen and a.seen.nats - a.nats > STRAYED else (a, b)
        for a, b in zip(without, with_it, strict=True)
    ]
    without, with_it = [a for a, _ in pairs], [b for _, b in pairs]
    nats = sum(s.nats for s in with_it) - sum(s.nats for s in without)
    falls = [0.0]
    for kind, floor in floors.items():
        count = sum(s.count.get(kind, 0) for s in without)
        if count:
            fall = sum(s.squares.get(kind, 0.0) for s in without)
            fall -= sum(s.squares.get(kind, 0.0) for s in with_it)
            falls.append(fall / count / floor**2)
    return Outside(float(nats), float(max(falls)), float(-min(falls)))


def beside_others(
    model: JointModel,
    now: Fit,
    parts: Sequence[tuple[Gain, Fit]],
    floors: Mapping[Kind, float],
) -> list[Gain]:
    """What every effect of a hypothesis gains on groups left out, beside the others.

    ``parts`` are the effects, each with the fit of the hypothesis without it.
    """
    whole = score_outside(model, now)
    return [
        replace(gain, held_out=held_out(score_outside(model, without), whole, floors))
        for gain, without in parts
    ]


def drop(model: JointModel, now: Fit, name: str) -> tuple[Fit, Gain]:
    """The hypothesis without one effect, and what the effect gains over that."""
    count = len(model.nuisances)
    keep = [k.effect != name for k in now.hypothesis.knobs]
    own = [
        count + i
        for i, k in enumerate(now.hypothesis.knobs)
        if k.effect == name and not k.parameter.shape
    ]
    start = np.concatenate([now.z[:count], now.z[count:][keep]])
    without = fit(model, now.hypothesis.without(name), start, now.noise, rounds=5)
    return without, Gain(name, now, 0.0, inflation(model, now, own)).over(model, without)
