"""Which effects promise something: one rollout for every size of each, and no fit.

What nuisances and effects already in could do instead is projected out by their tangents.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sim.effects import Effect

from ..journal import digest
from ..knobs import AMOUNTS, TWINS, Knob, effect_knobs
from ..noise import CLIP, huber_weight, whiten
from .fit import EDGE, Fit, bounds, linearise
from .limp import LETS_GO, overloads
from .model import Hypothesis, JointModel

Floats = NDArray[np.float64]

SIZES = (0.05, 0.2, 0.7, 2.0, 6.0)  #: of amplitudes, in typical sizes, at which an effect is tried
#: at which it is tried where none of those promises anything: gains that nobody set, say, add up
BETWEEN, FINER = (0.1, 0.4, 1.0, 1.4, 3.5), (0.003, 0.012)
#: by what the best of these is scaled to see whether another size is better, and how far from it
GROWN, FARTHER = 1.2, 4.0
#: effects that do nothing until something reaches them, and then soon too much: their sizes are
#: tried so close to each other, from the least that anything might reach
LIMITS = frozenset({"acceleration_limit", "current_limit", "torque_limit", "velocity_limit"})
CLOSER = 1.25
SHAPES = (-1.2, 0.0, 1.2)  #: of parameters that only shape it
#: screened effects that are worth a fit: so many more than the least if they gain so much [nats],
#: and so many more if they gain so much of the best: of many that are alike, any may be the cause
MORE, PROMISING = 3, 1.0
ALIKE, LIKE = 3, 0.5


def starts(knobs: Sequence[Knob], some: Sequence[float] = SIZES) -> list[Floats]:
    """Values of an effect's knobs to try, shapes in all combinations.

    Amplitudes that may have either sign are tried one by one, others together.
    """
    choices: list[tuple[float, ...]] = []
    amplitudes = [k for k in knobs if not k.parameter.shape]
    sizes = [[size] * len(amplitudes) for size in some]
    if amplitudes and all(k.bounds[0] < 0.0 for k in amplitudes):
        signed = [sign * size for sign in (1.0, -1.0) for size in some]
        sizes = [[s * (a is k) for a in amplitudes] for k in amplitudes for s in signed]
    for knob in knobs:
        if knob.parameter.shape:
            low, high = knob.bounds
            spread = SHAPES if knob.logarithmic else tuple(s * 1.6 for s in SHAPES)
            choices.append(tuple(min(high, max(low, s)) for s in spread))
    tried = []
    for size in sizes:
        for shapes in product(*choices):
            left, own = list(shapes), list(size)
            tried.append(
                np.array([(left if k.parameter.shape else own).pop(0) for k in knobs], np.float64)
            )
    return tried


def limits(knob: Knob) -> list[float]:
    """Values of a limit's knob to try, from the highest limit that there may be to the lowest."""
    least = knob.at(knob.parameter.high / CLOSER) if knob.inverse else SIZES[0]
    most = knob.bounds[1]
    count = 1 + math.ceil(math.log(most / least) / math.log(CLOSER))
    found: list[float] = np.geomspace(least, most, count).tolist()
    return found


def times(knobs: Sequence[Knob]) -> bool:
    """Whether an effect is of a time: less than a tick of the firmware of it is nothing."""
    return any(k.parameter.unit == "s" for k in knobs if not k.parameter.shape)


def vectors_to_try(
    model: JointModel,
    base: Fit,
    effect: Effect,
    knobs: Sequence[Knob],
    some: Sequence[float] = SIZES,
) -> list[Floats]:
    """Vectors with an effect on: of several sizes, and in the place of a nuisance like it.

    Where tolerances have gone as far as they may, they stand in for something else: then an effect
    is tried beside them as they are believed to be, too.
    """
    count = len(model.nuisances)
    far = bounds(model, base.hypothesis)[1][:count] - EDGE
    origins = [base.z]
    stands_in = np.array([n.stands_in for n in model.nuisances])
    if (np.abs(base.z[:count]) >= far)[stands_in & (far > 0.0)].any():
        believed = np.where(stands_in, 0.0, base.z[:count])
        origins.append(np.concatenate([believed, base.z[count:]]))
    if effect.name == LETS_GO:
        seen = [(z, overloads(model, base.hypothesis, z, knobs)) for z in origins]
        return [np.concatenate([z, x]) for z, tried in seen for x in (*tried, starts(knobs)[0])]
    names = [n.name for n in model.nuisances]
    twin = TWINS.get(effect.name)
    if twin not in names:
        return [np.concatenate([z, x]) for z in origins for x in starts(knobs, some)]
    k = names.index(twin)
    away = base.z[k] * model.nuisances[k].deviation / knobs[0].unit
    if twin in AMOUNTS:
        away *= float(model.candidate(base.hypothesis, base.z * 0.0, 0).drive[AMOUNTS[twin]])
    elif model.nuisances[k].unit != knobs[0].parameter.unit:
        away = 0.0
    if knobs[0].parameter.typical < knobs[0].parameter.off:
        away = -away
    sizes = [0.5 * away, away, 1.5 * away, *(away + float(x[0]) for x in starts(knobs, some))]
    tried = []
    for origin in origins:
        z = origin.copy()
        z[k] = 0.0
        tried += [np.append(z, np.clip(size, *knobs[0].bounds)) for size in sizes]
    return tried


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


def worth_fitting(
    ranking: Sequence[tuple[float, str, Floats]], least: int, stretched: Collection[str] = ()
) -> list[tuple[float, str, Floats]]:
    """Those of a ranking that are worth a fit, the best first; ``least`` of them at least.

    ``stretched`` always are, however little one try of them promises.
    """
    most = least + MORE
    more = [row for row in ranking[least:most] if row[0] > PROMISING]
    alike = [row for row in ranking[most : most + ALIKE] if row[0] > LIKE * ranking[0][0]]
    worth = [*ranking[:least], *more, *(alike if len(more) == MORE else [])]
    return worth + [row for row in ranking[len(worth) :] if row[1] in stretched]


def stretched(model: JointModel, base: Fit) -> set[str]:
    """Effects whose own tolerances have gone as far as they may."""
    low, high = bounds(model, base.hypothesis)
    ends = (base.z < low + EDGE) | (base.z > high - EDGE)
    at_end = {
        n.name
        for n, end, least in zip(model.nuisances, ends, low, strict=False)
        if end and least < 0.0
    }
    return {effect for effect, nuisance in TWINS.items() if nuisance in at_end}


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
    weight = huber_weight(residual)
    normal = (tangents * weight[:, None]).T @ tangents + np.diag(prior + 1e-9)

    def left(z: Floats) -> float:
        step = np.linalg.solve(normal, tangents.T @ (weight * z) + prior * moved)
        after = z - tangents @ step
        size = np.abs(after)
        return float(np.sum(np.where(size < CLIP, size**2, 2.0 * CLIP * size - CLIP**2)))

    before = left(residual)

    def rows(hypothesis: Hypothesis, tries: Sequence[Floats]) -> list[Floats]:
        return [
            np.concatenate(
                [
                    whiten(b, base.noise[key[1]], b.value[:, None])[0][:, 0]
                    for key, b in blocks.items()
                ]
            )
            for blocks in model.residuals(hypothesis, tries, which)
        ]

    def tried(hypothesis: Hypothesis, tries: Sequence[Floats]) -> Iterator[tuple[float, Floats]]:
        for x, row in zip(tries, rows(hypothesis, tries), strict=True):
            gain = 0.5 * len(residual) * float(np.log(before / left(row)))
            yield gain + 0.5 * float(np.sum(base.z[:count] ** 2) - np.sum(x[:count] ** 2)), x

    def better(hypothesis: Hypothesis, x: Floats) -> list[Floats]:
        """The same with its sizes scaled as one step of least squares would."""
        k = np.array([count + i for i, q in enumerate(hypothesis.knobs) if not q.parameter.shape])
        k = k[k >= len(base.z)]
        more = x.copy()
        more[k] *= GROWN
        now, then = rows(hypothesis, [x, more])
        slope = (then - now) / (GROWN - 1.0)
        slope -= tangents @ np.linalg.solve(normal, tangents.T @ (weight * slope))
        now = now - tangents @ np.linalg.solve(normal, tangents.T @ (weight * now) + prior * moved)
        bend = float(slope @ (weight * slope))
        if bend <= 0.0:
            return []
        scale = 1.0 - float(slope @ (weight * now)) / bend
        ends = np.array([q.bounds for q in hypothesis.knobs])[k - count]
        scaled = x.copy()
        scaled[k] = np.clip(scaled[k] * min(FARTHER, max(1.0 / FARTHER, scale)), *ends.T)
        return [scaled]

    ranking = []
    for effect in effects:
        knobs = effect_knobs(effect)
        if effect.name in base.hypothesis.effects:
            continue
        hypothesis = base.hypothesis + knobs
        best = (-np.inf, np.append(base.z, np.zeros(len(knobs))))
        every = (limits(knobs[0]),) if effect.name in LIMITS else (SIZES, BETWEEN, FINER)
        for some in every:
            if best[0] < PROMISING and not (some is FINER and times(knobs)):
                tries = vectors_to_try(model, base, effect, knobs, some)
                best = max([best, *tried(hypothesis, tries)], key=lambda pair: pair[0])
        best = max(
            [best, *tried(hypothesis, better(hypothesis, best[1]))], key=lambda pair: pair[0]
        )
        ranking.append((best[0], effect.name, best[1]))
    return sorted(ranking, key=lambda row: -row[0])
