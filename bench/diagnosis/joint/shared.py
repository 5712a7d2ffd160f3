"""What an arm has once, and several of its joints found: one number, and how far to trust it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim.effects import Scope, effect

from ..result import Cause, Estimate, Rival

Interval = tuple[float, float]


def mean(values: Sequence[float], intervals: Sequence[Interval]) -> tuple[float, Interval]:
    """The mean of what several joints found, and its interval of 95 %.

    Weighted by the intervals' squares; where joints differ by more than those allow, the interval
    is wider by as much (Birge's ratio). All is in the unit of the values.
    """
    found = np.array(values)
    half = np.array([max(0.5 * (high - low), 1e-12) for low, high in intervals])
    weight = half**-2.0
    middle = float(weight @ found / weight.sum())
    least = float(weight.sum() ** -0.5)
    # of 95 %, which is 1.96 deviations
    chi2 = 1.96**2 * float(weight @ (found - middle) ** 2) / max(1, len(found) - 1)
    wide = least * max(1.0, chi2**0.5)
    return middle, (middle - wide, middle + wide)


def united(causes: Sequence[Cause], explainable: Mapping[str, float]) -> tuple[Cause, ...]:
    """Causes of several joints, those of one thing as one: a payload hangs on all of them.

    ``explainable`` is every joint's square that could be explained, by which shares count. What
    is as likely as such a cause must be so at every joint.
    """
    once = [name for name in dict.fromkeys(c.effect for c in causes) if of_robot(name)]
    own = [cause for cause in causes if cause.effect not in once]
    for name in once:
        same = [cause for cause in causes if cause.effect == name]
        own.append(_one(same, explainable) if len(same) > 1 else same[0])
    return tuple(own)


def of_robot(name: str) -> bool:
    """Whether a robot has an effect once."""
    return effect(name).scope is Scope.ROBOT


def _one(same: Sequence[Cause], explainable: Mapping[str, float]) -> Cause:
    squares = np.array([sum(explainable[joint] for joint in cause.scope) for cause in same])
    shares = np.array([cause.explained_share for cause in same])
    joints = tuple(joint for cause in same for joint in cause.scope)
    return Cause(
        effect=same[0].effect,
        scope=joints,
        parameters={name: _estimate(same, name) for name in same[0].parameters},
        held_out_gain_nats=sum(cause.held_out_gain_nats for cause in same),
        explained_share=float(squares @ shares / max(float(squares.sum()), 1e-30)),
        probability=max(cause.probability for cause in same),
        indistinguishable_from=tuple(_everywhere(same, joints)),
    )


def _estimate(same: Sequence[Cause], name: str) -> Estimate:
    every = [cause.parameters[name] for cause in same]
    value, interval = mean([one.value for one in every], [one.ci95 for one in every])
    known = effect(same[0].effect).parameter(name)  # as wide as they differ may be beyond that
    interval = max(known.low, interval[0]), min(known.high, interval[1])
    surest = min(every, key=lambda one: one.ci95[1] - one.ci95[0])
    return Estimate(value, interval, surest.unit, surest.state)


def _everywhere(same: Sequence[Cause], joints: tuple[str, ...]) -> list[Rival]:
    """Rivals that every joint has, no likelier than where they are least likely."""
    found = [{rival.effect: rival for rival in cause.indistinguishable_from} for cause in same]
    names = [name for name in found[0] if all(name in one for one in found)]
    return [
        Rival(
            name,
            joints,
            min(one[name].probability for one in found),
            max(one[name].behind_nats for one in found),
        )
        for name in names
    ]
