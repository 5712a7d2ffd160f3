"""How much replays of sound robots scatter, which no fit can follow and no finding is of.

Contacts make a little of much: a slightly other start leaves legs elsewhere. A robot that stands
and shifts its weight slips and sticks besides, and at which instant hangs on all tolerances: what
traces of them do not foretell of robots within tolerances is chance as well, but for what fits
take for other tolerances. Most of it lasts: where feet came to stand they press against each
other, and joints are as far off as long as they stay there. Walks do so in every cycle, of which
means over the phase are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

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
#: times as far off as the others of them that a robot is which falls or is overloaded; assumed
FALLEN = 3.0
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


class Chance(NamedTuple):
    """Squares of joint rows that traces do not foretell [rad^2], (rows,): apart, and all along."""

    varying: Floats
    lasting: Floats

    @classmethod
    def none(cls, rows: int) -> Chance:
        """Of a robot that walks, the means of which have it in their scatter."""
        return cls(np.zeros(rows), np.zeros(rows))

    @property
    def total(self) -> Floats:
        """Both together (rows,) [rad^2]."""
        return self.varying + self.lasting

    def sways(self, joint_row: NDArray[np.intp], joints: int, repeats: int) -> Floats:
        """What joints have all along (rows, joints), for one deviation [rad].

        Repeats have it alike, and do not tell it as often as there are of them.
        """
        deviation = np.sqrt(repeats * self.lasting)
        found: Floats = deviation[:, None] * (joint_row[:, None] == np.arange(joints))
        return found


def of_tolerances(model: RobotModel, judging: Collection[int], run: Run) -> list[Chance]:
    """What traces do not foretell of joint rows of robots that stand, nor fits follow.

    Of robots within tolerances that start a little otherwise; fits are made to all recordings that
    are not only ``judging``. By recording: of those of walks nothing.
    """
    standing = [m for m in sorted(set(model.motion)) if model.features[m].phase is None]
    robots = [_within(model, seed) for seed in range(DRAWS)]
    jobs = [
        Job(m, nuisances=tuple(z.tolist()), jitter=j)
        for m in standing
        for j, z in enumerate(robots, 1)
    ]
    found = iter(run(jobs))
    joints = RobotKind.JOINTS
    away = {}
    for m in standing:
        rows = [next(found)[joints] - model.modelled((), z, m)[joints] for z in robots]
        away[m] = np.nan_to_num(rows)
    fitted = {m for r, m in enumerate(model.motion) if r not in judging}
    away = _upright(away)
    left = _followed(model, away, [m for m in standing if m in fitted] or standing)
    chance = {m: _parted(model, m, rows) for m, rows in left.items()}
    pairs = zip(model.motion, model.features, strict=True)
    return [chance.get(m) or Chance.none(len(f.bin)) for m, f in pairs]


def _upright(away: Mapping[int, Floats]) -> dict[int, Floats]:
    """Rows of those replays that are not much farther off than others, by motion.

    A robot that falls, or is overloaded, is not the one that was recorded, which is seen not to.
    """
    stands = np.ones(DRAWS, dtype=bool)
    for rows in away.values():
        square = np.mean(rows**2, axis=1)
        others = (square.sum() - square) / (DRAWS - 1)
        stands &= square <= FALLEN**2 * others
    return {m: rows[stands] if stands.sum() > 1 else rows for m, rows in away.items()}


def _followed(
    model: RobotModel, away: Mapping[int, Floats], fitted: Sequence[int]
) -> dict[int, Floats]:
    """What fits to some motions leave of replays' rows (replays, rows), by motion [rad]."""
    if not fitted:
        return {}
    traces = {m: np.nan_to_num(model.traces[m][RobotKind.JOINTS]) for m in away}
    floor = model.floors()[RobotKind.JOINTS] ** 2
    count = len(model.nuisances)
    known, pulled = np.eye(count), np.zeros((count, len(away[fitted[0]])))
    for m in fitted:
        noise = floor + model.features[m].rounding_rad2 + np.mean(away[m] ** 2, axis=0)
        weighted = traces[m].T / noise
        known += weighted @ traces[m]
        pulled += weighted @ away[m].T
    taken = np.linalg.solve(known, pulled)
    return {m: rows - (traces[m] @ taken).T for m, rows in away.items()}


def _parted(model: RobotModel, m: int, away: Floats) -> Chance:
    """Squares of replays' rows (replays, rows): about each joint's mean, and of those means.

    Joints of one kind share the latter, as few replays tell little of it.
    """
    row, segments = model.features[m].joint_row, [j.segment for j in model.base.joints]
    means = np.zeros_like(away)
    for joint in np.unique(row):
        means[:, row == joint] = away[:, row == joint].mean(axis=1, keepdims=True)
    lasting = np.mean(means**2, axis=0)
    kinds = np.array(segments)[row]
    for kind in set(segments):
        own = kinds == kind
        if own.any():
            lasting[own] = lasting[own].mean()
    varying = np.mean((away - means) ** 2, axis=0)
    return Chance(BOTH * _about(model.features[m], varying), BOTH * lasting)


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
