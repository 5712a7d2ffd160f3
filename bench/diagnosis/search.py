"""Which effects: screened cheaply, confirmed by fits, taken one by one, and dropped again.

What a hypothesis gains is a difference of log-likelihoods [nats] with all nuisances fitted again.
The noise model is never quite right, so a gain counts only after it is divided by its *inflation*:
how much wider the sandwich variance of the effect's own parameters is, with the scores summed over
stretches of time, than the variance the likelihood believes in (White, 1982; Takeuchi's penalty is
the same ratio). Then it must hold on recordings the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sim.effects import Effect, catalogue

from .fit import EDGE, Fit, Score, bounds, fit, linearise, score
from .intervals import covariances
from .journal import digest
from .knobs import AMOUNTS, TWINS, Knob, effect_knobs
from .model import JointModel, Kind
from .noise import CLIP, whiten
from .valleys import explore
from .watch import OutOfTimeError

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

SIZES = (0.05, 0.2, 0.7, 2.0)  #: of amplitudes, in typical sizes, at which an effect is tried
SHAPES = (-1.2, 0.0, 1.2)  #: of parameters that only shape it
SURE, CONFIRMED = 3, 6  #: how many of the screened effects are fitted in a step, at least, at most
PROMISING = 1.0  #: gain [nats] when screened of those beyond the least
EXPLORED = 2  #: of the confirmed that are fitted further
NEEDED = 7.0  #: gain [nats, deflated] of an effect to be taken; see docs on power
HELD_OUT = 1.5  #: gain [nats, deflated] it must have on recordings not used to fit
PLAIN = 80.0  #: gain [nats, deflated] that no difference of engines has: however small its trace
PROVISIONAL = 25.0  #: gain [nats, deflated] of an effect that may only lack another beside it
LIKEWISE = 0.4  #: of such a gain that must be there on recordings not used to fit, too
HARM = 0.3  #: of the squared noise floor that it may add to another kind, or where it is judged
CLOSE = 6.0  #: nats (deflated) by which the second best may be behind, to be asked at all
NUMBER_NATS = 1.5  #: gain [nats, deflated] that every number of an effect must be worth
RELIEF = (
    0.04  #: of the squared noise floor that it must take off the mean square of some kind there
)


@dataclass(frozen=True, slots=True, eq=False)
class Gain:
    """What an effect gains over a hypothesis without it."""

    effect: str
    fit: Fit
    nats: float  #: as the likelihood has it
    inflation: float  #: what it must be divided by, at least 1
    held_out: Outside | None = None  #: on recordings not used to fit

    @property
    def deflated(self) -> float:
        """The gain that counts [nats]."""
        return self.nats / self.inflation


def starts(knobs: Sequence[Knob]) -> list[Floats]:
    """Values of an effect's knobs to try: amplitudes together, shapes in all combinations."""
    choices: list[tuple[float, ...]] = []
    amplitudes = [k for k in knobs if not k.parameter.shape]
    two_sided = len(amplitudes) == 1 and amplitudes[0].bounds[0] < 0.0
    sizes = (*SIZES, *(-s for s in SIZES)) if two_sided else SIZES
    for knob in knobs:
        if knob.parameter.shape:
            low, high = knob.bounds
            spread = SHAPES if knob.logarithmic else tuple(s * 1.6 for s in SHAPES)
            choices.append(tuple(min(high, max(low, s)) for s in spread))
    tried = []
    for size in sizes:
        for shapes in product(*choices):
            left = list(shapes)
            tried.append(
                np.array([left.pop(0) if k.parameter.shape else size for k in knobs], np.float64)
            )
    return tried


def vectors_to_try(
    model: JointModel, base: Fit, effect: Effect, knobs: Sequence[Knob]
) -> list[Floats]:
    """Vectors with an effect on: of several sizes, and in the place of a nuisance like it."""
    names = [n.name for n in model.nuisances]
    twin = TWINS.get(effect.name)
    if twin not in names:
        return [np.concatenate([base.z, x]) for x in starts(knobs)]
    k = names.index(twin)
    away = base.z[k] * model.nuisances[k].deviation / knobs[0].unit
    if twin in AMOUNTS:
        away *= float(model.candidate(base.hypothesis, base.z * 0.0, 0).drive[AMOUNTS[twin]])
    elif model.nuisances[k].unit != knobs[0].parameter.unit:
        away = 0.0
    if knobs[0].parameter.typical < knobs[0].parameter.off:
        away = -away
    z = base.z.copy()
    z[k] = 0.0
    sizes = [0.5 * away, away, 1.5 * away, *(away + float(x[0]) for x in starts(knobs))]
    return [np.append(z, np.clip(size, *knobs[0].bounds)) for size in sizes]


def screen(
    model: JointModel, base: Fit, effects: Iterable[Effect], which: Sequence[int] | None = None
) -> list[tuple[float, str, Floats]]:
    """Effects by how well one try of each fits: gain [nats], name, and vector to start from.

    Every try is one rollout; what nuisances and effects already in could do instead is projected
    out by their tangents, and the noise scaled to what is left. Nuisances that are as far as they
    may be do nothing more. A ranking that was kept is not made again.
    """
    effects = list(effects)
    key = ""
    if model.journal is not None:
        noise = sorted((k.value, n) for k, n in base.noise.items())
        names = [e.name for e in effects]
        told = (noise, names, which and list(which))
        key = digest("screen", model.key, base.hypothesis.knobs, base.z, told)
        if (kept := model.journal.get(key)) is not None:
            return [(gain, name, np.array(x, np.float64)) for gain, name, x in kept["ranking"]]
    ranking = _ranking(model, base, effects, which)
    if model.journal is not None:
        model.journal.put(key, {"ranking": [(g, name, x.tolist()) for g, name, x in ranking]})
    return ranking


def _ranking(
    model: JointModel, base: Fit, effects: Iterable[Effect], which: Sequence[int] | None
) -> list[tuple[float, str, Floats]]:
    residual, tangents = linearise(model, base.hypothesis, base.z, base.noise, which)
    count = len(model.nuisances)
    low, high = bounds(model, base.hypothesis)
    free = (base.z > low + EDGE) & (base.z < high - EDGE)
    free[count:] = True
    tangents = tangents[:, free]
    prior = np.zeros(len(base.z))
    prior[:count] = 1.0
    prior, moved = prior[free], base.z[free]
    weight = np.minimum(1.0, CLIP / np.maximum(np.abs(residual), CLIP))
    normal = (tangents * weight[:, None]).T @ tangents + np.diag(prior + 1e-9)

    def left(z: Floats) -> float:
        step = np.linalg.solve(normal, tangents.T @ (weight * z) + prior * moved)
        after = z - tangents @ step
        size = np.abs(after)
        return float(np.sum(np.where(size < CLIP, size**2, 2.0 * CLIP * size - CLIP**2)))

    before = left(residual)
    ranking = []
    for effect in effects:
        knobs = effect_knobs(effect)
        if effect.name in base.hypothesis.effects:
            continue
        hypothesis = base.hypothesis + knobs
        tries = vectors_to_try(model, base, effect, knobs)
        found = model.residuals(hypothesis, tries, which)
        best = (-np.inf, tries[0])
        for x, blocks in zip(tries, found, strict=True):
            rows = [
                whiten(b, base.noise[key[1]], b.value[:, None])[0][:, 0]
                for key, b in blocks.items()
            ]
            gain = 0.5 * len(residual) * float(np.log(before / left(np.concatenate(rows))))
            gain += 0.5 * float(np.sum(base.z[:count] ** 2) - np.sum(x[:count] ** 2))
            if gain > best[0]:
                best = (gain, x)
        ranking.append((best[0], effect.name, best[1]))
    return sorted(ranking, key=lambda row: -row[0])


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
    return Gain(effect.name, found, base.cost - found.cost, inflation(model, found, own))


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
        scores.append(score(model, again, part))
    return scores


def inside(model: JointModel, without: Fit, with_it: Fit, floors: Mapping[Kind, float]) -> Outside:
    """The same comparison on all recordings of a model, with the fits as they are."""
    everything = range(len(model.observed))
    before, after = (score(model, found, everything) for found in (without, with_it))
    return held_out([before], [after], floors)


def held_out(
    without: Sequence[Score], with_it: Sequence[Score], floors: Mapping[Kind, float]
) -> Outside:
    """Compare two hypotheses on groups left out."""
    nats = sum(s.nats for s in with_it) - sum(s.nats for s in without)
    falls = [0.0]
    for kind, floor in floors.items():
        count = sum(s.count.get(kind, 0) for s in without)
        if count:
            fall = sum(s.squares.get(kind, 0.0) for s in without)
            fall -= sum(s.squares.get(kind, 0.0) for s in with_it)
            falls.append(fall / count / floor**2)
    return Outside(float(nats), float(max(falls)), float(-min(falls)))


def grow(
    model: JointModel,
    base: Fit,
    effects: dict[str, Effect],
    say: Progress,
    floors: Mapping[Kind, float],
    most: int = 4,
) -> tuple[Fit, list[Gain], list[Gain]]:
    """Take effects one by one while they gain; the fit, those taken, and all that were confirmed.

    ``floors`` are the deviations of every kind that a perfect model would leave. After every step
    effects that no longer gain are dropped. One that gains very much where it is fitted, but not on
    recordings left out, may lack another beside it: then the search goes on, and all that it finds
    is judged together. Where ``say`` is out of time, what was taken until then is given.
    """
    taken: list[Gain] = []
    confirmed: list[Gain] = []
    now = base
    sure: tuple[Fit, list[Gain]] | None = None
    try:
        for step in range(most):
            say(f"step {step + 1}: trying every effect")
            left = [e for n, e in effects.items() if n not in now.hypothesis.effects]
            ranking = screen(model, now, left)
            ranking = ranking[:SURE] + [r for r in ranking[SURE:CONFIRMED] if r[0] > PROMISING]
            gains = []
            for _, name, start in ranking:
                say(f"step {step + 1}: fitting {name}")
                gains.append(confirm(model, now, effects[name], start))
            gains = further(model, now, ranked(gains), say)
            confirmed += gains
            chosen = _chosen(model, now, gains, floors, say)
            if chosen is None and sure is None and _promising(model, now, gains, floors):
                sure = now, list(taken)
                chosen = gains[0]
            if chosen is None:
                break
            now = fit(model, chosen.fit.hypothesis, chosen.fit.z, chosen.fit.noise)
            taken.append(chosen)
            now, taken = prune(model, now, taken, say)
        if sure is not None:
            say("all that was found together, on recordings left out")
            taken = _together(model, now, taken, floors)
    except OutOfTimeError:
        pass
    if sure is not None and not all(gain.held_out for gain in taken):
        now, taken = sure
    return now, taken, confirmed


def _chosen(
    model: JointModel,
    now: Fit,
    gains: Sequence[Gain],
    floors: Mapping[Kind, float],
    say: Progress,
) -> Gain | None:
    """The best effect that gains on groups left out as well."""
    without: list[Score] | None = None
    for gain in gains[:2]:
        if gain.deflated < max(NEEDED, gains[0].deflated - CLOSE):
            break
        plainly = gain.deflated > PLAIN
        if not plainly and inside(model, now, gain.fit, floors).relief < RELIEF:
            continue
        say(f"{gain.effect} on recordings left out")
        without = without or score_outside(model, now)
        outside = held_out(without, score_outside(model, gain.fit), floors)
        nats = outside.nats / gain.inflation
        if (nats > HELD_OUT and outside.relief > RELIEF) or (
            plainly and nats > LIKEWISE * gain.deflated
        ):
            return replace(gain, held_out=outside)
    return None


def _promising(
    model: JointModel, now: Fit, gains: Sequence[Gain], floors: Mapping[Kind, float]
) -> bool:
    """Whether the best effect gains so much where it is fitted that it may only lack another."""
    return (
        bool(gains)
        and gains[0].deflated > PROVISIONAL
        and inside(model, now, gains[0].fit, floors).relief > RELIEF
    )


def _together(
    model: JointModel, now: Fit, taken: Sequence[Gain], floors: Mapping[Kind, float]
) -> list[Gain]:
    """What every effect of a set gains on groups left out beside the others; none if it fails."""
    whole = score_outside(model, now)
    checked = []
    for gain in taken:
        without, *_ = drop(model, now, gain.effect)
        outside = held_out(score_outside(model, without), whole, floors)
        holds = outside.nats / gain.inflation > HELD_OUT and outside.relief > RELIEF
        checked.append(replace(gain, held_out=outside if holds else None))
    return checked


def further(model: JointModel, base: Fit, gains: Sequence[Gain], say: Progress) -> list[Gain]:
    """Gains with the fits of the best effects of several numbers taken as deep as they go."""
    found = []
    for place, gain in enumerate(gains):
        deeper = gain.fit
        if place < EXPLORED and gain.deflated > NEEDED / 2.0:
            say(f"fitting {gain.effect} further")
            deeper = explore(model, gain.fit, gain.effect)
        found.append(replace(gain, fit=deeper, nats=base.cost - deeper.cost))
    return ranked(found)


def ranked(gains: Sequence[Gain]) -> list[Gain]:
    """Gains on one scale, the best first; of two that are close, the one with fewer numbers.

    Gains of one step are divided by one inflation, the mean of those that gain anything: what is
    compared is how far each follows the same recordings.
    """
    useful = [g.inflation for g in gains if g.nats > 0.0]
    common = float(np.exp(np.mean(np.log(useful)))) if useful else 1.0
    levelled = [replace(g, inflation=max(common, 1.0)) for g in gains]
    return sorted(
        levelled, key=lambda g: NUMBER_NATS * len(effect_knobs(catalogue()[g.effect])) - g.deflated
    )


def prune(model: JointModel, now: Fit, taken: list[Gain], say: Progress) -> tuple[Fit, list[Gain]]:
    """Drop effects without which the rest does as well."""
    while len(now.hypothesis.effects) > 1:
        worst: tuple[float, str, Fit] | None = None
        for name in now.hypothesis.effects:
            say(f"doing without {name}")
            without, nats, inflated = drop(model, now, name)
            loss = nats / inflated
            if worst is None or loss < worst[0]:
                worst = (loss, name, without)
        assert worst is not None
        if worst[0] >= NEEDED:
            return now, taken
        now = worst[2]
        taken = [gain for gain in taken if gain.effect != worst[1]]
    return now, taken


def drop(model: JointModel, now: Fit, name: str) -> tuple[Fit, float, float]:
    """The hypothesis without one effect, what that costs [nats], and the effect's inflation."""
    count = len(model.nuisances)
    keep = [k.effect != name for k in now.hypothesis.knobs]
    own = [
        count + i
        for i, k in enumerate(now.hypothesis.knobs)
        if k.effect == name and not k.parameter.shape
    ]
    start = np.concatenate([now.z[:count], now.z[count:][keep]])
    without = fit(model, now.hypothesis.without(name), start, now.noise, rounds=5)
    return without, without.cost - now.cost, inflation(model, now, own)
