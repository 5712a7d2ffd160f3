"""Which names hold: a search, and what is taken back of what it found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sim.effects import Effect

from .fit import Fit, block_rms
from .model import JointModel, Kind
from .search import HARM, Gain, Progress, drop, grow, inside
from .veto import BEHIND, objection
from .watch import Watch

WORSE = 1.2  #: times the mean square on recordings left out that takes a name back
HARMFUL = "it makes recordings that were not used to fit worse"
BETTER = "it explains far less than a cause that cannot be named"


@dataclass(frozen=True, slots=True)
class Denied:
    """A name that is taken back, why, and the gain [nats] that another must have in its place."""

    gain: Gain
    because: str
    needed: float = 0.0


@dataclass(frozen=True, slots=True)
class Settled:
    """A fit, the names that hold, all that was confirmed, and what may be named at all."""

    after: Fit
    taken: Sequence[Gain]
    confirmed: Sequence[Gain]
    effects: Mapping[str, Effect]
    rejected: Sequence[Mapping[str, Any]]


def settle(
    model: JointModel,
    judge: JointModel | None,
    before: Fit,
    effects: Mapping[str, Effect],
    floors: Mapping[Kind, float],
    watch: Watch,
) -> Settled:
    """Search, and take names back until nothing speaks against those that are left.

    ``judge`` has the recordings that were not used to fit, if there are any. After the first name
    that is taken back there is a second search without it; then names are only taken back.
    """
    rejected: list[Mapping[str, Any]] = []
    needed = 0.0
    after, taken, confirmed = grow(model, before, dict(effects), watch, floors)
    while True:
        denied = _objected(model, after, taken, effects, needed)
        if denied is None and judge is not None:
            denied = _denied(model, judge, after, taken, floors, watch.tell)
        if denied is None:
            return Settled(after, taken, confirmed, effects, rejected)
        needed = max(needed, denied.needed)
        name = denied.gain.effect
        rejected.append(
            {"effect": name, "gain_nats": float(denied.gain.deflated), "because": denied.because}
        )
        effects = {other: e for other, e in effects.items() if other != name}
        if len(rejected) == 1 and watch.stopped is None:
            after, taken, confirmed = grow(model, before, dict(effects), watch, floors)
        else:
            after, *_ = drop(model, after, name)
            taken = [gain for gain in taken if gain.effect != name]


def _objected(
    model: JointModel,
    after: Fit,
    taken: Sequence[Gain],
    effects: Mapping[str, Effect],
    needed: float,
) -> Denied | None:
    """A name that something speaks against, or that explains far less than one taken back."""
    for gain in taken:
        if (why := objection(model, after, gain, effects)) is not None:
            return Denied(gain, why, BEHIND * gain.deflated)
    if taken and taken[0].deflated < needed:
        return Denied(taken[-1], BETTER)
    return None


def _denied(
    model: JointModel,
    judge: JointModel,
    after: Fit,
    taken: Sequence[Gain],
    floors: Mapping[Kind, float],
    say: Progress,
) -> Denied | None:
    """The effect that does most harm to recordings that were not used to fit, if any does."""
    harms = []
    for gain in taken:
        say(f"{gain.effect} on recordings that were not used to fit")
        without, *_ = drop(model, after, gain.effect)
        harm = inside(judge, without, after, floors).harm
        squares = [
            block_rms(judge.residuals(f.hypothesis, [f.z])[0], Kind.POSITION) ** 2
            for f in (without, after)
        ]
        if harm > HARM and squares[1] > WORSE * squares[0]:
            harms.append((harm, gain))
    if not harms:
        return None
    return Denied(max(harms, key=lambda pair: pair[0])[1], HARMFUL)
