"""How fast a joint is when a recording begins: what its first samples alone do not tell.

Where samples are far apart, a joint that rests and is then told to move looks like one that moves
already. So such a recording is begun in several ways, with all as it is believed to be, and it
rests at first unless it follows another beginning plainly better.
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
    """Recordings at rest in the beginning, where no first speed is plainly better."""
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


def _misfits(model: JointModel) -> list[float]:
    """Sum of squares [rad^2] of the first positions of each recording, by what is believed."""
    blocks = model.residuals(Hypothesis(), [np.zeros(len(model.nuisances))], None, [Kind.POSITION])
    found = []
    for r in range(len(model.observed)):
        block = blocks[0].get((r, Kind.POSITION))
        soon = block.t_s < block.t_s[0] + SHOWN_S if block else None
        found.append(float(np.sum(block.value[soon] ** 2)) if block else 0.0)
    return found
