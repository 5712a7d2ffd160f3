"""How fast a joint is when a recording begins: what its first samples alone do not tell.

Where samples are far apart, a joint that rests and is then told to move looks like one that moves
already. So such a recording is begun both ways, with all as it is believed to be, and it rests at
first unless it follows the other beginning plainly better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from busemu.tables import Robot
from sim.robot import PhysicalRobot

from .model import Hypothesis, JointModel, Kind
from .observed import FIRST_S, FIRST_SAMPLES, Observed

SHOWN_S = 0.3  #: of a recording in which a wrong beginning shows; assumed
PLAINLY = 2.0  #: times the squared misfit that a beginning at rest must have, not to be believed


def begun(base: PhysicalRobot, robot: Robot, observed: Sequence[Observed]) -> list[Observed]:
    """Recordings at rest in the beginning, where their first speed is not plainly better."""
    asked = [k for k, one in enumerate(observed) if one.replay.velocity_rad_s and _sparse(one)]
    found = list(observed)
    if not asked:
        return found
    moving = [observed[k] for k in asked]
    resting = [replace(o, replay=replace(o.replay, velocity_rad_s=0.0)) for o in moving]
    on_the_move, at_rest = (_misfits(JointModel(base, robot, some)) for some in (moving, resting))
    for place, k in enumerate(asked):
        if at_rest[place] <= PLAINLY * on_the_move[place]:
            found[k] = resting[place]
    return found


def _sparse(observed: Observed) -> bool:
    """Whether the samples that tell of the first speed take longer than they should."""
    times = observed.position.t_s[observed.position.good]
    return bool(times[FIRST_SAMPLES - 1] - times[0] > FIRST_S)


def _misfits(model: JointModel) -> list[float]:
    """Sum of squares [rad^2] of the first positions of each recording, by what is believed."""
    blocks = model.residuals(Hypothesis(), [np.zeros(len(model.nuisances))], None, [Kind.POSITION])
    found = []
    for r in range(len(model.observed)):
        block = blocks[0].get((r, Kind.POSITION))
        soon = block.t_s < block.t_s[0] + SHOWN_S if block else None
        found.append(float(np.sum(block.value[soon] ** 2)) if block else 0.0)
    return found
