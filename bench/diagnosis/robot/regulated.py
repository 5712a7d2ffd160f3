"""What position laws make of the angles that a robot's joints showed, and what loads told of it.

A load register holds the duty that the servo's controller asks for. Along the recorded angles that
is the law alone: no engine, no contact and no motor plays a part, and so a low gain is told from a
weak motor, a low supply and a heavy trunk. It is asked for where a joint stands: what the register
holds is up to a refresh old, and a joint that moves was elsewhere then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.rollout import Batch, Candidate, Load, Replay
from sim.tree import PhysicalRobot

from ..noise import Block, Noise
from .replay import Course

if TYPE_CHECKING:
    from .model import RobotModel

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

STEADY_S = 0.15  #: in which the law's duty must have stayed; loads of an AX-12A are 0.13 s old
STEADY_COUNTS = 2.2  #: of the angle, what it may have moved by then; a count either way
BEGUN_S = 1.0  #: before which a robot stands up; assumed
LEVELS = 2  #: rows of a joint: what is added to a duty differs from what multiplies it
APART_COUNTS = 6.0  #: of the angle that duties must span for that; by fewer, rounding would sort
LEAST_READS = 3  #: below which a joint's loads tell nothing; assumed
NOTHING = Load(1.0, np.zeros(1), np.zeros(1))  #: no load: no law asks for it


@dataclass(frozen=True, slots=True, eq=False)
class Regulated:
    """The laws of a recording's joints; rows are :data:`LEVELS` a joint, of small and large duties.

    A row is the mean duty, in the direction in which the joint's law pushes, of the instants at
    which its load was read. ``recorded`` is NaN where loads tell nothing. ``extra`` is the variance
    of what rounding of angles leaves of it: as long as a joint shows one count, that is one number.
    """

    batch: Batch
    sensed_rad: tuple[Floats, ...]
    joints: tuple[int, ...]  #: of each replay
    parts: tuple[tuple[int, int, Ints, Floats], ...]  #: row, replay, its samples, their signs
    recorded: Floats
    extra: Floats

    @classmethod
    def of(cls, course: Course, robot: Robot, believed: PhysicalRobot) -> Regulated:
        """The laws as believed, along a recording's angles."""
        joints = [j for j, t in enumerate(course.sample_s) if len(t)]
        replays, angles = [], []
        for j in joints:
            order = np.argsort(course.sample_s[j], kind="stable")
            mount = robot.servos[j]
            shown = np.array([mount.to_servo(q) for q in course.position_rad[j][order].tolist()])
            own = course.events[course.events[:, 1] == j][:, [0, 2, 3]]
            times = course.sample_s[j][order]
            replays.append(Replay(course.start[:, j], own, times, float(shown[0])))
            angles.append(shown)
        count = LEVELS * len(course.sample_s)
        none = np.full(count, np.nan)
        batch = Batch(replays, threads=1)
        plain = cls(batch, tuple(angles), tuple(joints), (), none, np.zeros(count))
        return plain._seen(course, believed)

    def _seen(self, course: Course, believed: PhysicalRobot) -> Regulated:
        one = course.quantum_rad
        duty, above, below = (self._duties(believed, x) for x in (0.0, one, -one))
        recorded, extra = self.recorded.copy(), self.extra.copy()
        parts = []
        for k, j in enumerate(self.joints):
            times = self.batch.replays[k].samples
            step = 0.5 * np.abs(above[k] - below[k])
            count = float(np.median(step))
            sure = above[k] * below[k] > 0.0  # a count either way and the law pushes as it does
            good = sure & _steady(times, duty[k], STEADY_COUNTS * count) & (times > BEGUN_S)
            read_s, read = course.duty[j] if course.duty else (np.empty(0), np.empty(0))
            before = np.clip(np.searchsorted(times, read_s, side="right") - 1, 0, None)
            fresh = (read_s - times[before] < STEADY_S) & (read_s >= times[before]) & good[before]
            told = int(fresh.sum()) >= LEAST_READS
            own = before[fresh] if told else np.flatnonzero(good)
            for level, chosen in enumerate(_levels(np.abs(duty[k][own]), APART_COUNTS * count)):
                some, row = own[chosen], LEVELS * j + level
                if not len(some):
                    continue
                sign = np.sign(duty[k][some])
                parts.append((row, k, some, sign))
                if told and len(some) >= LEAST_READS:
                    recorded[row] = float(np.mean(sign * read[fresh][chosen]))
                    runs = 1 + int(np.count_nonzero(np.diff(self.sensed_rad[k][some])))
                    extra[row] = float(np.mean(step[some]) ** 2) / 12.0 / runs
        return replace(self, parts=tuple(parts), recorded=recorded, extra=extra)

    def rows(self, robot: PhysicalRobot) -> Floats:
        """Rows of a robot's laws along the recorded angles; 0 where there is nothing of a row."""
        found = np.zeros(len(self.recorded))
        duties = self._duties(robot)
        for row, k, own, sign in self.parts:
            found[row] = float(np.mean(sign * duties[k][own]))
        return found

    def _duties(self, robot: PhysicalRobot, more_rad: float = 0.0) -> list[Floats]:
        """Duties at the samples, of angles that are so much more."""
        every = [Candidate.of(robot, j, NOTHING, rigid=True) for j in self.joints]
        sensed = [angles + more_rad for angles in self.sensed_rad]
        return self.batch.regulate(every, range(len(every)), sensed)


def _levels(push: Floats, apart: float) -> tuple[NDArray[np.bool_], ...]:
    """Which pushes are small and which are large; all are small that are not far apart."""
    small = np.ones(len(push), bool)
    if len(push) and float(np.ptp(push)) >= apart:
        small = push < 0.5 * float(push.min() + push.max())
    return small, ~small


def _steady(t_s: Floats, duty: Floats, within: float) -> NDArray[np.bool_]:
    """Whether a duty has stayed within a range for so long before each instant."""
    first = np.searchsorted(t_s, t_s - STEADY_S)
    parts: Sequence[Floats] = [duty[a : b + 1] for b, a in enumerate(first.tolist())]
    return np.array([float(np.ptp(part)) <= within for part in parts], bool)


def most_off(model: RobotModel, blocks: Mapping[int, Block], noise: Noise) -> float:
    """How far residuals of duties are off together, where that is most [deviations].

    ``blocks`` are those of recordings by number. Asked of every joint, kind of joint and leg, and
    of all of them.
    """
    rows = [np.flatnonzero(np.isfinite(model.features[r].regulated.recorded)) for r in blocks]
    every = np.concatenate(rows) // LEVELS
    value = np.concatenate([block.value for block in blocks.values()])
    weight = 1.0 / (noise.white**2 + np.concatenate([block.extra for block in blocks.values()]))
    names = [model.base.joints[j].name.split(".") for j in every.tolist()]
    places = [set(), *({word} for own in names for word in own), *(set(own) for own in names)]
    found = [0.0]
    for place in {frozenset(place) for place in places}:
        own = np.array([place <= set(name) for name in names], bool)
        found.append(abs(float(value[own] @ weight[own])) / float(np.sqrt(weight[own].sum())))
    return max(found)
