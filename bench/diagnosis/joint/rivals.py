"""What a named effect could be instead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim.effects import Effect

from ..result import Rival
from .faint import SURELY, hardly_better
from .fit import EDGE, Fit, prior_cost
from .model import Hypothesis, JointModel
from .screening import screen
from .search import Gain, Progress, confirm, drop
from .valleys import elsewhere
from .veto import PLAINER, SAME_SHARE, SPLIT

TRIED = 3  #: rivals that are fitted in an effect's place
CLOSE = 4.0  #: nats (deflated) within which a rival is not told apart
#: that nothing of the catalogue is the cause: never less than the first; where a gain is faint,
#: more, by the second, fading with the third [nats]. The first is of 133 names of proofs that were
#: opened and were said with 0.93: 130 are true. The others were fitted by eye to 66 names of two of
#: them: true were 2 of 8 below 60 nats, 22 of 30 from 60 to 300, 26 of 28 beyond
NONE_LEAST, NONE_FAINT, FAINT_NATS = 0.03, 0.6, 60.0
#: nats (deflated) that rivals are behind, all of them together, of which each leaves no more than
#: two sound simulations of the joint differ by. With 2, names with such rivals were said with 0.64
#: to 0.70, and 27 of 30 of them in proofs that were opened are true
AS_GOOD = 3.5
#: nats within which a rival is begun from elsewhere. Fits of one hypothesis ended up to 25 apart by
#: where they began, in a case that was opened (0009 of the nineteenth run)
NEAR_NATS = 40.0
DRIVING, BACKDRIVING = "driving", "backdriving"  #: the numbers of what is split
TEMPER = 0.5  #: of gains, when they become probabilities: see docs on power


def rivals(
    model: JointModel,
    now: Fit,
    name: str,
    effects: Mapping[str, Effect],
    known: Sequence[Gain],
    say: Progress,
) -> tuple[float, list[Rival], dict[str, Fit], Fit]:
    """Probability of an effect among all fitted in its place, and those close behind it.

    Also the fits of those close behind, by effect, and the fit without any in its place.
    """
    say(f"what {name} could be instead")
    without, own = drop(model, now, name)
    tried: list[Gain] = []
    if len(now.hypothesis.effects) == 1:  # the search has fitted them already
        tried = [g for g in known if g.fit.hypothesis.effects == (g.effect,) and g.effect != name]
    else:
        others = [
            e for n, e in effects.items() if n != name and n not in without.hypothesis.effects
        ]
        for _, other, start in screen(model, without, others)[:TRIED]:
            tried.append(confirm(model, without, effects[other], start))
        tried += _split(model, name, without, known)
    tried = [_from_elsewhere(model, gain) if _near(own, gain) else gain for gain in tried]
    probability, close = _among(model, own, tried)
    one = SPLIT[name] if passed_on(own) else None  # no experiment tells that from itself
    fits = {gain.effect: gain.fit for gain in tried if gain.effect != one}
    return (
        probability,
        close,
        {r.effect: fits[r.effect] for r in close if r.effect in fits},
        without,
    )


def _split(model: JointModel, name: str, without: Fit, known: Sequence[Gain]) -> list[Gain]:
    """The deepest fit of what a name was split into, beside the others, if a search has made one.

    It was refused as its numbers agree, and so is not among the effects; it may be meant still.
    """
    beside = set(without.hypothesis.effects)
    split = [
        gain.over(model, without)
        for gain in known
        if SPLIT.get(gain.effect) == name
        and set(gain.fit.hypothesis.effects) == beside | {gain.effect}
    ]
    return [max(split, key=lambda gain: gain.nats)] if split else []


def _near(named: Gain, other: Gain) -> bool:
    """Whether another gain is behind by no more than fits of one hypothesis end apart by."""
    return named.nats - other.nats < NEAR_NATS


def _from_elsewhere(model: JointModel, gain: Gain) -> Gain:
    """A rival with the chance that what is named has had: begun from elsewhere as well."""
    fit = elsewhere(model, gain.fit)
    relief = prior_cost(model, gain.fit.z) - prior_cost(model, fit.z)
    nats = gain.nats + gain.fit.cost - fit.cost
    return replace(gain, fit=fit, nats=nats, relief=gain.relief + relief)


def contemporaries(
    model: JointModel, now: Fit, named: Gain, known: Sequence[Gain]
) -> tuple[float, list[Rival], dict[str, Fit], Fit]:
    """As :func:`rivals`, from what was fitted beside an effect when it was taken: nothing new.

    Another name that holds beside it is not what it could be instead.
    """
    before = set(named.fit.hypothesis.effects) - {named.effect}
    tried = [
        g
        for g in known
        if g.effect not in now.hypothesis.effects
        and set(g.fit.hypothesis.effects) == before | {g.effect}
    ]
    without, *_ = drop(model, now, named.effect)
    probability, close = _among(model, named, tried)
    return probability, close, {}, without


def _among(model: JointModel, named: Gain, tried: Sequence[Gain]) -> tuple[float, list[Rival]]:
    """Probability of an effect among some that were fitted in its place, and those close behind.

    A likelihood is sure of whatever repeats. Where two differ by less than engines do, that is no
    more than a hint which of them it is, unless it is more than engines ever made. What is the same
    in other words is no rival.
    """
    tried = [gain for gain in tried if not _in_other_words(gain, named)]
    scale = float(np.exp(np.mean(np.log([g.inflation for g in (named, *tried)]))))
    own = named.counted(scale) - named.unlikely
    behind = {g.effect: own - (g.counted(scale) - g.unlikely) for g in tried}
    for other, plainer in SPLIT.items():  # the same and more, so that it always fits as well
        if plainer == named.effect and other in behind:
            behind[other] = max(behind[other], AS_GOOD)
        pair = {named.effect, other, plainer}
        if len(pair) == 2 and upright(model):
            behind |= {one: min(behind[one], AS_GOOD) for one in pair & set(behind)}
    if passed_on(named) and SPLIT[named.effect] in behind:
        behind[SPLIT[named.effect]] = 0.0
    alike = [
        g.effect
        for g in tried
        if behind[g.effect] > AS_GOOD
        and hardly_better([model], g.fit, named.fit, sure=behind[g.effect] > SURELY)
    ]
    for other in alike:  # together as likely as one
        together = AS_GOOD + float(np.log(len(alike))) / TEMPER
        behind[other] = min(behind[other], together)
    probability, others = chances(own, behind)
    close = [
        Rival(other, (model.observed[0].joint,), others[other], nats)
        for other, nats in behind.items()
        if nats < CLOSE or other in alike
    ]
    return probability, sorted(close, key=lambda r: r.behind_nats)


def upright(model: JointModel) -> bool:
    """Whether gravity does no work on a joint, as it is believed to hang.

    Then nothing comes from outside but inertia, and whether that is a torque from outside, a
    friction of load may count in one engine and not in another.
    """
    none = np.zeros(len(model.nuisances))
    loads = [model.candidate(Hypothesis(), none, r).load for r in range(len(model.observed))]
    return not any(np.any(load.sine_nm) or np.any(load.cosine_nm) for load in loads)


def passed_on(named: Gain) -> bool:
    """Whether a friction that was split in two knows only the torque that comes from outside.

    Friction that grows with what a gear passes on, and with nothing else, is the same both ways:
    many call that by the name of what was split.
    """
    if named.effect not in SPLIT:
        return False
    knobs, count = named.fit.hypothesis.knobs, len(named.fit.hypothesis.knobs)
    numbers = zip(knobs, named.fit.z[-count:].tolist(), strict=True)
    own = {k.parameter.name: k.value(z) for k, z in numbers if k.effect == named.effect}
    return own[DRIVING] < SAME_SHARE * own[BACKDRIVING]


def _in_other_words(gain: Gain, named: Gain) -> bool:
    """Whether a gain is of an effect that holds the named one, and is at the end where it is that.

    A friction that falls from a speed on that no joint reaches falls nowhere.
    """
    if PLAINER.get(gain.effect) != named.effect:
        return False
    knobs = gain.fit.hypothesis.knobs
    numbers = zip(knobs, gain.fit.z[-len(knobs) :].tolist(), strict=True)
    return any(k.parameter.shape and z > k.bounds[1] - EDGE for k, z in numbers)


def chances(own_nats: float, behind_nats: Mapping[str, float]) -> tuple[float, dict[str, float]]:
    """Probability of an effect, and of others that are so far behind it in its place.

    All gains [nats] are deflated. What is left to 1 is that of nothing in the catalogue.
    """
    none = NONE_LEAST + NONE_FAINT * float(np.exp(-max(0.0, own_nats) / FAINT_NATS))
    weights = {o: float(np.exp(-TEMPER * max(0.0, b))) for o, b in behind_nats.items()}
    total = 1.0 + sum(weights.values()) + float(np.exp(-TEMPER * max(0.0, own_nats)))
    total /= 1.0 - none
    return 1.0 / total, {other: weight / total for other, weight in weights.items()}
