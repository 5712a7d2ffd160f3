"""What a search over a whole robot found, as named causes with intervals, chances and rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..joint.confidence import NORMAL, estimate, state
from ..joint.rivals import AS_GOOD, CLOSE, chances
from ..result import Cause, Estimate, Rival
from .effects import Placed
from .features import RobotKind
from .fit import RobotFit
from .gains import RobotFindings, RobotGain
from .model import RobotModel
from .search import RobotSearch

#: share of a number's distance from its off value by which two engines differ about it, one
#: deviation: RMS over eight sizes in opened cases, which were 6 to 26 % off where intervals from
#: scatter alone were 3 to 6 % wide and held none of them
ENGINES_SHARE = 0.14
#: share of a value by which fits of a gain or a supply end apart besides, one deviation, where no
#: register shows either: what tolerances of motors and masses take of it is chance then. RMS of
#: eight such sizes in opened cases was 6.8 %, of which 3.7 % were told; of six whose servos'
#: voltages were read it was 1.2 %
ENDS_SHARE = 0.057
SLOPE = 0.01  #: of a knob, to either side
#: such effects, and channels that show them
SHOWN_BY = {
    "gain_error": {RobotKind.VOLTAGE, RobotKind.DUTY},
    "supply_voltage": {RobotKind.VOLTAGE},
}
#: how often names are true, by their very effect, that would be said with so much: of 88 names of
#: eighteen opened proofs 70 would have been said with 0.25 to 0.9, evenly, and 55 of them are true,
#: however little; all 18 with more. Nobody has seen what is true of those with less
SAID = (0.0, 0.25, 0.9, 1.0)
TRUE = (0.0, 0.7, 0.9, 1.0)
#: springs in series under every foot: joints see their sum. What of it a fit prefers hangs on the
#: damping that the catalogue assumes of each
SERIES = {
    "foot_compliance@all": "ground_compliance@all",
    "ground_compliance@all": "foot_compliance@all",
}


def scope_of(placed: Placed, model: RobotModel) -> tuple[str, ...]:
    """Joints, legs or bodies that an effect is at; none named is all of its kind."""
    return placed.where or tuple(sorted(placed.effect.places(model.base)))


def cause_of(
    search: RobotSearch,
    found: RobotFindings,
    gain: RobotGain,
    after: RobotFit,
    explained: float,
    held_out: float,
) -> Cause:
    """A cause from what was taken; rivals are those that were fitted in its place."""
    model = search.model
    placed = model.placed[gain.name]
    probability, close = _rivals(model, found, gain)
    return Cause(
        effect=placed.effect.name,
        scope=scope_of(placed, model),
        parameters={placed.parameter.name: number_of(search, after, gain.name)},
        held_out_gain_nats=held_out,
        explained_share=explained,
        probability=probability,
        indistinguishable_from=tuple(close),
    )


def chance_of(model: RobotModel, found: RobotFindings, gain: RobotGain) -> float:
    """Probability of an effect by likelihoods among all that could be in its place."""
    return _rivals(model, found, gain)[0]


def _rivals(model: RobotModel, found: RobotFindings, gain: RobotGain) -> tuple[float, list[Rival]]:
    """Probability of an effect among all that could be in its place, and those close behind it."""
    kind = model.placed[gain.name].effect.name
    behind: dict[str, tuple[float, str]] = {}

    def seen(name: str, nats: float) -> None:
        other = model.placed[name].effect.name
        if other != kind and (other not in behind or nats < behind[other][0]):
            behind[other] = nats, name

    fitted = _step(found, gain)
    for each in fitted:
        seen(each.name, gain.ahead_of(each))
    known = {each.name for each in fitted}
    alike = found.alike.get(gain.name, ())
    tried = known | {name for name, _ in alike}
    for name, cosine in alike:
        if name not in known:  # what is left of a trace beside another is not taken by it
            seen(name, gain.deflated * (1.0 - cosine**2))
    if gain.name in SERIES and SERIES[gain.name] in tried:
        seen(SERIES[gain.name], AS_GOOD)
    return rivals_of(model, gain.deflated, behind)


def rivals_of(
    model: RobotModel, own_nats: float, behind: Mapping[str, tuple[float, str]]
) -> tuple[float, list[Rival]]:
    """Probability of an effect that gains so much, and the others close behind it, nearest first.

    ``behind`` has, by effect, how much less it gains [nats] and its name at a place.
    """
    own, others = chances(own_nats, {other: nats for other, (nats, _) in behind.items()})
    close = [
        Rival(other, scope_of(model.placed[name], model), others[other], nats)
        for other, (nats, name) in behind.items()
        if nats < CLOSE
    ]
    return own, sorted(close, key=lambda rival: rival.behind_nats)


def as_measured(cause: Cause) -> Cause:
    """A cause with a probability as often true as names said with it; its rivals share the rest.

    What likelihoods and their rivals say is too modest: fits of one hypothesis end far apart, and
    more than that decides which of two is named.
    """
    probability = float(np.interp(cause.probability, SAID, TRUE))
    left = (1.0 - probability) / (1.0 - cause.probability) if cause.probability < 1.0 else 1.0
    rivals = (replace(r, probability=left * r.probability) for r in cause.indistinguishable_from)
    return replace(cause, probability=probability, indistinguishable_from=tuple(rivals))


def close_rivals(model: RobotModel, found: RobotFindings, gain: RobotGain) -> list[RobotGain]:
    """Effects of other kinds that were fitted in its place and are close behind."""
    kind = model.placed[gain.name].effect.name
    return [
        each
        for each in _step(found, gain)
        if model.placed[each.name].effect.name != kind and gain.ahead_of(each) < CLOSE
    ]


def _step(found: RobotFindings, gain: RobotGain) -> Sequence[RobotGain]:
    """All that was fitted in the step in which an effect was taken."""
    return next((step for step in found.tried if any(g is gain for g in step)), ())


def number_of(search: RobotSearch, fit: RobotFit, name: str) -> Estimate:
    """A number with its interval from the sandwich variance, and whether the data pins it.

    The interval has what engines differ by in it: no scatter among recordings shows that.
    """
    model = search.model
    believed, sandwich = search.sight.covariances(fit)
    k = len(fit.nuisances) + fit.names.index(name)
    knob = model.placed[name].knob
    z = float(fit.z[k])
    scatter = float(np.sqrt(max(sandwich[k, k], believed[k, k])))
    deviation = float(np.hypot(scatter, ENGINES_SHARE * z))
    shown_by = SHOWN_BY.get(model.placed[name].effect.name)
    if shown_by is not None and shown_by.isdisjoint(model.floors()):
        slope = (knob.value(z + SLOPE) - knob.value(z - SLOPE)) / (2.0 * SLOPE)
        deviation = float(np.hypot(deviation, ENDS_SHARE * knob.value(z) / slope))
    others = [*(n.name for n in model.nuisances), *fit.names]
    ends = [z + side * NORMAL * deviation for side in (-1, 1)]
    return estimate(knob, z, ends, state(fit.z, k, scatter, knob, believed, others))
