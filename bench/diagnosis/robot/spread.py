"""How much replays of sound robots scatter, which no fit can follow and no finding is of.

Contacts make a little of much: a slightly other start leaves legs elsewhere. A robot that stands
and shifts its weight slips and sticks besides, and at which instant hangs on all tolerances: what
traces of them do not foretell of robots within tolerances is chance as well. Walks do so in every
cycle, of which means over the phase are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .curves import Rows
from .features import Features, RobotKind
from .gait import around
from .nuisances import replayable
from .pool import Job

if TYPE_CHECKING:
    from .model import RobotModel

Floats = NDArray[np.float64]
Run = Callable[[Sequence[Job]], list[Rows]]

JITTERS = 3  #: replays with a slightly other start, for the spread of replays
DRAWS = 4  #: robots within tolerances, of one that stands
WITHIN = 0.5  #: deviations of tolerances that they have, as fits come nearer than priors; assumed
BOTH = 2.0  #: the robot and its model each do otherwise
APART = 4  #: windows by which what slips may do so sooner or later; a second, assumed


def of_starts(plain: Mapping[int, Rows], run: Run) -> dict[int, Rows]:
    """Variance of replays that start a little otherwise, by motion."""
    jobs = [Job(m, jitter=j, short=True) for m in plain for j in range(1, JITTERS + 1)]
    found = run(jobs)
    spread = {}
    for i, (m, own) in enumerate(plain.items()):
        some = found[i * JITTERS : (i + 1) * JITTERS]
        spread[m] = {
            kind: np.nan_to_num(np.mean([(rows[kind] - base) ** 2 for rows in some], axis=0))
            for kind, base in own.items()
        }
    return spread


def of_tolerances(model: RobotModel, motions: Sequence[int], run: Run) -> dict[int, Floats]:
    """Mean square of joint rows that traces do not foretell, of motions without a gait [rad^2]."""
    standing = [m for m in motions if model.features[m].phase is None]
    robots = [_within(model, seed) for seed in range(DRAWS)]
    jobs = [Job(m, nuisances=tuple(z.tolist())) for m in standing for z in robots]
    found = iter(run(jobs))
    joints = RobotKind.JOINTS
    spread = {}
    for m in standing:
        away = [next(found)[joints] - model.modelled((), z, m)[joints] for z in robots]
        square = np.mean(np.nan_to_num(np.square(away)), axis=0)
        spread[m] = BOTH * _about(model.features[m], square)
    return spread


def _within(model: RobotModel, seed: int) -> Floats:
    random = np.random.default_rng([seed, 53])
    low, high = np.array([nuisance.ends for nuisance in model.nuisances]).T
    z = np.clip(WITHIN * random.standard_normal(len(low)), low, high)
    return replayable(model.nuisances, z)


def _about(features: Features, square: Floats) -> Floats:
    """Means with the windows before and after, joint by joint."""
    found = np.empty_like(square)
    for joint in np.unique(features.joint_row):
        own = features.joint_row == joint
        found[own] = around(square[own], APART) / around(np.ones(int(own.sum())), APART)
    return found
