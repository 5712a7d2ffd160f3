"""How a joint is when a recording begins: what its first samples and writes alone do not tell.

Where samples are far apart, a joint that rests and is then told to move looks like one that moves
already. So such a recording is begun in several ways, with all as it is believed to be, and it
rests at first unless it follows another beginning plainly better.

The first goal that a recording has may be new, or have been in force all along. To a servo that
limits how fast its goal moves that is not the same: a new one starts from where the joint is. A
joint that rests aside of its goal, as it would be held there and would not if nothing pushed it,
was held there before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from busemu.tables import Robot
from sim.drive import fields
from sim.effects import effect
from sim.robot import PhysicalRobot

from ..knobs import effect_knobs
from ..observed import FIRST_S, FIRST_SAMPLES, STILL_QUANTA, Observed
from .model import Hypothesis, JointModel, Kind

SHOWN_S = 0.3  #: of a recording in which a wrong beginning shows; assumed
PLAINLY = 2.0  #: times the squared misfit that a beginning at rest must have, not to be believed
#: after the beginning, within which a goal is the first, as buses write before they read; assumed
EARLY_S = 0.004
#: after the beginning, in which a joint that is held rests, and the share of the way to its goal
#: that it may move in it; assumed
RESTS_S, RESTING = 0.1, 0.3
BELIEVED = Hypothesis()
LED = "velocity_limit"  #: an effect that keeps a goal that is new where the joint is, if it is slow


def begun(base: PhysicalRobot, robot: Robot, observed: Sequence[Observed]) -> list[Observed]:
    """Recordings at rest in the beginning, where no first speed is plainly better; and held.

    What rests hangs on its gear, which is twisted from the beginning.
    """
    resting = [
        replace(one, replay=replace(one.replay, rests=one.replay.velocity_rad_s == 0.0))
        for one in _slowed(base, robot, observed)
    ]
    return _held(base, robot, resting)


def _slowed(base: PhysicalRobot, robot: Robot, observed: Sequence[Observed]) -> list[Observed]:
    found = list(observed)
    asked = [k for k, one in enumerate(observed) if one.replay.velocity_rad_s and _sparse(one)]
    if not asked:
        return found
    ways = [
        [_at(observed[k], 0.0) for k in asked],
        [observed[k] for k in asked],
        [_at(observed[k], _first_step(observed[k])) for k in asked],
    ]
    misfits = np.array([_misfits(JointModel(base, robot, way)) for way in ways])
    misfits[1:] *= PLAINLY
    for place, best in enumerate(np.argmin(misfits, axis=0).tolist()):
        found[asked[place]] = ways[best][place]
    return found


def _held(base: PhysicalRobot, robot: Robot, observed: Sequence[Observed]) -> list[Observed]:
    """With goals in force from before, where joints rest as they are held aside of them."""
    found = list(observed)
    aside = {k: goal for k, one in enumerate(observed) if (goal := _aside(one)) is not None}
    if not aside:
        return found
    model = JointModel(base, robot, [observed[k] for k in aside])
    (knob,) = effect_knobs(effect(LED))
    slow = knob.at(knob.parameter.low)
    held, let = (
        _misfits(model, Hypothesis(knobs), sizes, RESTS_S)
        for knobs, sizes in (((), ()), ((knob,), (slow,)))
    )
    for (k, goal), one, other in zip(aside.items(), held, let, strict=True):
        if one < other:
            found[k] = replace(found[k], replay=replace(found[k].replay, held_rad=goal))
    return found


def _aside(observed: Observed) -> float | None:
    """The first goal [rad], if a joint rests at first, and not at it."""
    replay, samples = observed.replay, observed.position
    if replay.start[fields.MODE] != fields.MODE_POSITION or replay.velocity_rad_s != 0.0:
        return None
    times, goals = observed.goal  # the first of them is what the servo had before any write
    goal = float(goals[1 if len(times) > 1 and times[1] < EARLY_S else 0])
    t_s, angle = samples.t_s[samples.good], samples.value[samples.good]
    moved = float(np.ptp(angle[t_s < t_s[0] + RESTS_S]))
    way = abs(goal - float(angle[0]))
    return goal if way > STILL_QUANTA * samples.quantum and moved < RESTING * way else None


def _at(observed: Observed, velocity_rad_s: float) -> Observed:
    return replace(observed, replay=replace(observed.replay, velocity_rad_s=velocity_rad_s))


def _first_step(observed: Observed) -> float:
    """Speed [rad/s] from the first sample to the second."""
    samples = observed.position
    t_s, angle = samples.t_s[samples.good][:2], samples.value[samples.good][:2]
    return float((angle[1] - angle[0]) / (t_s[1] - t_s[0]))


def _sparse(observed: Observed) -> bool:
    """Whether the samples that tell of the first speed take longer than they should."""
    times = observed.position.t_s[observed.position.good]
    return bool(times[FIRST_SAMPLES - 1] - times[0] > FIRST_S)


def _misfits(
    model: JointModel,
    found: Hypothesis = BELIEVED,
    sizes: Sequence[float] = (),
    shown_s: float = SHOWN_S,
) -> list[float]:
    """Sum of squares [rad^2] of the first positions of each recording, by what is believed."""
    z = np.append(np.zeros(len(model.nuisances)), sizes)
    blocks = model.residuals(found, [z], None, [Kind.POSITION])
    sums = []
    for r in range(len(model.observed)):
        block = blocks[0].get((r, Kind.POSITION))
        soon = block.t_s < block.t_s[0] + shown_s if block else None
        sums.append(float(np.sum(block.value[soon] ** 2)) if block else 0.0)
    return sums
