"""Which effects: taken one by one while they gain, and dropped again; what lacks another waits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.effects import Effect, catalogue

from ..knobs import effect_knobs
from ..watch import OutOfTimeError
from .faint import changes_little
from .fit import Fit, fit
from .model import JointModel, Kind
from .remaining import Score
from .screening import screen, stretched, worth_fitting
from .search import (
    HELD_OUT,
    NEEDED,
    NUMBER_NATS,
    Gain,
    Progress,
    beside_others,
    confirm,
    drop,
    held_out,
    inside,
    score_outside,
)
from .valleys import DEEPER, afresh, elsewhere, explore

Floats = NDArray[np.float64]

SURE = 3  #: how many of the screened effects are fitted in a step, at least
EXPLORED = 2  #: of the confirmed that are fitted further
PLAIN = 50.0  #: gain [nats, deflated] that no difference of engines has: however small its trace
PROVISIONAL = 25.0  #: gain [nats, deflated] of an effect that may only lack another beside it
LIKEWISE = 0.1  #: of such a gain that must be there on recordings not used to fit, too
#: effects that pairs are begun with where a search leaves something, and pairs that are fitted
SEEDS, PAIRS = 3, 3
CLOSE = 6.0  #: nats (deflated) by which the second best may be behind, to be asked at all
#: of the squared noise floor that it must take off the mean square of some kind there
RELIEF = 0.04


def grow(
    model: JointModel,
    base: Fit,
    effects: dict[str, Effect],
    say: Progress,
    floors: Mapping[Kind, float],
    most: int = 4,
    ask: Callable[[Fit], None] = lambda _: None,
    begun: Sequence[Gain] = (),
) -> tuple[Fit, list[Gain], list[Gain]]:
    """Take effects one by one while they gain; the fit, those taken, and all that were confirmed.

    ``floors`` are the deviations of every kind that a perfect model would leave. After every step
    effects that no longer gain are dropped. One that gains very much where it is fitted, but not on
    recordings left out, may lack another beside it: then the search goes on, and all that it finds
    is judged together. Where ``say`` is out of time, what was taken until then is given. ``ask`` is
    asked of every step's fit, and may end the search by raising something. ``begun`` is what the
    base has already.
    """
    taken = list(begun)
    confirmed: list[Gain] = []
    now = base
    sure: tuple[Fit, list[Gain]] | None = None
    try:
        for step in range(len(taken), most):
            say(f"step {step + 1}: trying every effect")
            left = [e for n, e in effects.items() if n not in now.hypothesis.effects]
            ranking = screen(model, now, left)
            ranking = worth_fitting(ranking, SURE, stretched(model, now))
            gains = []
            for _, name, start in ranking:
                say(f"step {step + 1}: fitting {name}")
                gains.append(confirm(model, now, effects[name], start))
            gains = further(model, now, ranked(gains), say)
            now, gains = _deepest(model, now, gains)
            confirmed += gains
            chosen = _chosen(model, now, gains, floors, say)
            if chosen is None and sure is None and _promising(model, now, gains, floors):
                sure = now, list(taken)
                chosen = gains[0]
            if chosen is None:
                break
            now = fit(model, chosen.fit.hypothesis, chosen.fit.z, chosen.fit.noise)
            taken.append(chosen)
            say(f"fitting {chosen.effect} from elsewhere")
            now = elsewhere(model, now)
            now, taken = prune(model, now, taken, say)
            ask(now)
        if sure is not None:
            say("all that was found together, on recordings left out")
            now, taken = _together(model, now, taken, floors)
    except OutOfTimeError:
        pass
    if sure is not None and not (taken and all(gain.held_out for gain in taken)):
        now, taken = sure
    return now, taken, confirmed


def paired(
    model: JointModel, confirmed: Sequence[Gain], effects: Mapping[str, Effect], say: Progress
) -> tuple[Fit, list[Gain]] | None:
    """The best pair that does not begin with the effect that a search began with, if there is any.

    Two effects may look most like a third, and nothing found beside that leads to them.
    ``confirmed`` is what that search has confirmed. Where ``say`` is out of time, there is no pair.
    """
    singles = [gain for gain in confirmed if len(gain.fit.hypothesis.effects) == 1]
    pairs = [gain for gain in confirmed if len(gain.fit.hypothesis.effects) == 2]
    led = {name for gain in pairs for name in gain.fit.hypothesis.effects if name != gain.effect}
    seeds = [g for g in ranked(singles) if g.effect in effects and g.effect not in led][:SEEDS]
    rows: dict[frozenset[str], tuple[float, Gain, str, Floats]] = {}
    try:
        for seed in seeds:
            say(f"pairs with {seed.effect}: trying every effect")
            others = [e for name, e in effects.items() if name not in {seed.effect, *led}]
            for nats, name, start in screen(model, seed.fit, others):
                row = (seed.fit.cost - nats, seed, name, start)
                both = frozenset((seed.effect, name))
                rows[both] = min(rows.get(both, row), row, key=lambda one: one[0])
        found: list[tuple[Gain, Gain]] = []
        for _, seed, name, start in sorted(rows.values(), key=lambda row: row[0])[:PAIRS]:
            say(f"fitting {seed.effect} and {name}")
            found.append((seed, confirm(model, seed.fit, effects[name], start)))
    except OutOfTimeError:
        return None
    if not found:
        return None
    seed, beside = min(found, key=lambda pair: pair[1].fit.cost)
    best = beside.fit
    return fit(model, best.hypothesis, best.z, best.noise), [seed, beside]


def _deepest(model: JointModel, now: Fit, gains: Sequence[Gain]) -> tuple[Fit, list[Gain]]:
    """The hypothesis without the best effect, fitted from where that led, and what is gained still.

    A fit may stop in a hollow that any effect's numbers lead out of: no effect has gained that.
    """
    if not gains or gains[0].deflated < NEEDED / 2.0:
        return now, list(gains)
    without, *_ = drop(model, gains[0].fit, gains[0].effect)
    deeper = now.cost - without.cost
    if deeper < DEEPER:
        return now, list(gains)
    return without, ranked([gain.over(model, without) for gain in gains])


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
        if changes_little([model], now, gain.fit, gain.effect, gain.deflated):
            continue
        plainly = gain.deflated > PLAIN
        if not plainly and inside(model, now, gain.fit, floors).relief < RELIEF:
            continue
        say(f"{gain.effect} on recordings left out")
        without = without or score_outside(model, now)
        outside = held_out(without, score_outside(model, gain.fit), floors)
        judged = replace(gain, held_out=outside)
        if _holds(judged):
            return judged
    return None


def _holds(gain: Gain) -> bool:
    """Whether a gain is there on groups left out, too: large enough to be seen, or plain."""
    outside = gain.held_out
    if outside is None:
        return False
    if gain.deflated > PLAIN and gain.outside > LIKEWISE * gain.deflated:
        return True
    return gain.outside > HELD_OUT and outside.relief > RELIEF


def _promising(
    model: JointModel, now: Fit, gains: Sequence[Gain], floors: Mapping[Kind, float]
) -> bool:
    """Whether the best effect gains so much where it is fitted that it may only lack another."""
    return (
        bool(gains)
        and gains[0].deflated > PROVISIONAL
        and inside(model, now, gains[0].fit, floors).relief > RELIEF
        and not changes_little([model], now, gains[0].fit, gains[0].effect, gains[0].deflated)
    )


def _together(
    model: JointModel, now: Fit, taken: Sequence[Gain], floors: Mapping[Kind, float]
) -> tuple[Fit, list[Gain]]:
    """Of a set the effects that gain on groups left out beside the others; the least is left."""
    while taken:
        parts = [(gain, drop(model, now, gain.effect)[0]) for gain in taken]
        checked = beside_others(model, now, parts, floors)
        failing = [gain for gain in checked if not _holds(gain)]
        if not failing:
            return now, checked
        worst = min(failing, key=lambda gain: gain.outside).effect
        now, *_ = drop(model, now, worst)
        taken = [gain for gain in taken if gain.effect != worst]
    return now, []


def further(model: JointModel, base: Fit, gains: Sequence[Gain], say: Progress) -> list[Gain]:
    """Gains with the fits of the best effects of several numbers taken as deep as they go."""
    found = []
    for place, gain in enumerate(gains):
        deeper = gain.fit
        if place < EXPLORED and gain.deflated > NEEDED / 2.0:
            say(f"fitting {gain.effect} further")
            deeper = afresh(model, base, gain.fit, gain.effect)
            deeper = explore(model, deeper, gain.effect)
        found.append(replace(gain, fit=deeper).over(model, base))
    return ranked(found)


def ranked(gains: Sequence[Gain]) -> list[Gain]:
    """Gains on one scale, the best first; of two that are close, the plainer and likelier one.

    Gains of one step are divided by one inflation, the mean of those that gain anything: what is
    compared is how far each follows the same recordings.
    """
    useful = [g.inflation for g in gains if g.nats > 0.0]
    common = float(np.exp(np.mean(np.log(useful)))) if useful else 1.0
    levelled = [replace(g, inflation=max(common, 1.0)) for g in gains]

    def behind(gain: Gain) -> float:
        numbers = len(effect_knobs(catalogue()[gain.effect]))
        return NUMBER_NATS * numbers + gain.unlikely - gain.deflated

    return sorted(levelled, key=behind)


def prune(model: JointModel, now: Fit, taken: list[Gain], say: Progress) -> tuple[Fit, list[Gain]]:
    """Drop effects without which the rest does as well."""
    while len(now.hypothesis.effects) > 1:
        worst: tuple[float, str, Fit] | None = None
        for name in now.hypothesis.effects:
            say(f"doing without {name}")
            without, gain = drop(model, now, name)
            loss = gain.deflated
            if worst is None or loss < worst[0]:
                worst = (loss, name, without)
        assert worst is not None
        if worst[0] >= NEEDED:
            return now, taken
        now = worst[2]
        taken = [gain for gain in taken if gain.effect != worst[1]]
    return now, taken
