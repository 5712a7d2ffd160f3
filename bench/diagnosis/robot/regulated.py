"""What position laws make of the angles that a robot's joints showed, and what loads told of it.

A load register holds the duty that the servo's controller asks for. Along the recorded angles that
is the law alone: no engine, no contact and no motor plays a part, and so a low gain is told from a
weak motor, a low supply and a heavy trunk. It is asked for where that hardly changes: what the
register holds is up to a refresh old.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.rollout import Batch, Candidate, Load, Replay
from sim.tree import PhysicalRobot

from ..noise import Block
from .replay import Course

if TYPE_CHECKING:
    from .features import Features
    from .model import RobotModel

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

#: in which the law is told: a goal that moves is ahead of the joint by a cycle's way when it comes
EVERY_S = 0.005
STEADY_S = 0.15  #: in which the law's duty must have stayed; loads of an AX-12A are 0.13 s old
STEADY_COUNTS = 6.0  #: of the angle, that it may be worth between two instants within that
#: of the angle, beyond which a joint must be from where its law pushes the other way: of those that
#: show fewer rounding makes too many
SURE_COUNTS = 2.4
#: of a row: by 0.002 to 0.004 the emulated servos' loads of joints that move slowly, read in every
#: cycle, are larger than the law of the angles that were read; source: measured
DUTY_FLOOR = 0.005
LEVELS = 2  #: rows of a joint: what is added to a duty differs from what multiplies it
APART_COUNTS = 6.0  #: of the angle that duties must span for that; by fewer, rounding would sort
LEAST_READS = 3  #: below which a joint's loads tell nothing; assumed
NOTHING = Load(1.0, np.zeros(1), np.zeros(1))  #: no load: no law asks for it


@dataclass(frozen=True, slots=True, eq=False)
class Regulated:
    """The laws of a recording's joints; rows are :data:`LEVELS` a joint, of small and large duties.

    A row is the mean duty, in the direction in which the joint's law pushes, over a refresh before
    the instants at which its load was read. ``recorded`` is NaN where loads tell nothing. ``extra``
    is the variance of what rounding of angles leaves of it, which is one number as long as a joint
    shows one count, and of duties within a refresh. What these always do is one number as well, as
    loads may be new at the same instant of every cycle.
    """

    batch: Batch
    sensed_rad: tuple[Floats, ...]
    joints: tuple[int, ...]  #: of each replay
    parts: tuple[tuple[int, int, Ints, Floats], ...]  #: row, replay, its instants, their signs
    recorded: Floats
    extra: Floats

    @classmethod
    def of(cls, course: Course, robot: Robot, believed: PhysicalRobot) -> Regulated:
        """The laws as believed, along a recording's angles."""
        joints = [j for j, t in enumerate(course.sample_s) if len(t) and np.ptp(t) > 0.0]
        replays, angles = [], []
        for j in joints:
            order = np.argsort(course.sample_s[j], kind="stable")
            mount = robot.servos[j]
            shown = np.array([mount.to_servo(q) for q in course.position_rad[j][order].tolist()])
            own = course.events[course.events[:, 1] == j][:, [0, 2, 3]]
            read_s = course.sample_s[j][order]
            times = np.arange(read_s[0], read_s[-1], EVERY_S)
            replays.append(Replay(course.start[:, j], own, times, float(shown[0])))
            angles.append(np.interp(times, read_s, shown))
        count = LEVELS * len(course.sample_s)
        none = np.full(count, np.nan)
        batch = Batch(replays, threads=1)
        plain = cls(batch, tuple(angles), tuple(joints), (), none, np.zeros(count))
        return plain._seen(course, believed)

    def _seen(self, course: Course, believed: PhysicalRobot) -> Regulated:
        far = SURE_COUNTS * course.quantum_rad
        plain = self._duties(believed)
        duty, above, below = (self._lately(believed, x) for x in (0.0, far, -far))
        recorded, extra = self.recorded.copy(), self.extra.copy()
        parts = []
        for k, j in enumerate(self.joints):
            times = self.batch.replays[k].samples
            step = 0.5 * np.abs(above[k] - below[k]) / SURE_COUNTS
            count = float(np.median(step))
            sure = above[k] * below[k] > 0.0  # some counts either way and it pushes as it does
            good = sure & _steady(times, plain[k], STEADY_COUNTS * count) & (times > STEADY_S)
            swing = _mean_since(times, plain[k] ** 2) - duty[k] ** 2
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
                    shown = np.round(self.sensed_rad[k][some] / course.quantum_rad)
                    runs = 1 + int(np.count_nonzero(np.diff(shown)))
                    rounding = float(np.mean(step[some]) ** 2) / 12.0 / runs
                    always = float(np.median(swing[some]))
                    extra[row] = rounding + always + float(np.mean(swing[some])) / len(some)
        return replace(self, parts=tuple(parts), recorded=recorded, extra=extra)

    def rows(self, robot: PhysicalRobot) -> Floats:
        """Rows of a robot's laws along the recorded angles; 0 where there is nothing of a row."""
        found = np.zeros(len(self.recorded))
        duties = self._lately(robot)
        for row, k, own, sign in self.parts:
            found[row] = float(np.mean(sign * duties[k][own]))
        return found

    def _lately(self, robot: PhysicalRobot, more_rad: float = 0.0) -> list[Floats]:
        """Means of duties over :data:`STEADY_S` before each instant."""
        return [
            _mean_since(one.samples, duty)
            for one, duty in zip(self.batch.replays, self._duties(robot, more_rad), strict=True)
        ]

    def _duties(self, robot: PhysicalRobot, more_rad: float = 0.0) -> list[Floats]:
        """Duties at each instant, of angles that are so much more."""
        every = [Candidate.of(robot, j, NOTHING, rigid=True) for j in self.joints]
        sensed = [angles + more_rad for angles in self.sensed_rad]
        return self.batch.regulate(every, range(len(every)), sensed)


def with_loads(features: Sequence[Features], repeated: Sequence[int], r: int) -> int:
    """How many recordings with loads repeat what one does, that one among them.

    ``repeated`` has the first of its repeats for each of them.
    """
    loads = [bool(np.isfinite(each.regulated.recorded).any()) for each in features]
    pairs = zip(repeated, loads, strict=True)
    return sum(told and first == repeated[r] for first, told in pairs)


def _levels(push: Floats, apart: float) -> tuple[NDArray[np.bool_], ...]:
    """Which pushes are small and which are large; all are small that are not far apart."""
    small = np.ones(len(push), bool)
    if len(push) and float(np.ptp(push)) >= apart:
        small = push < 0.5 * float(push.min() + push.max())
    return small, ~small


def _mean_since(t_s: Floats, values: Floats) -> Floats:
    total = np.concatenate([[0.0], np.cumsum(values)])
    first, last = np.searchsorted(t_s, t_s - STEADY_S), np.arange(1, len(t_s) + 1)
    mean: Floats = (total[last] - total[first]) / (last - first)
    return mean


def _steady(t_s: Floats, duty: Floats, within: float) -> NDArray[np.bool_]:
    """Whether a duty has stayed within a range for so long before each instant."""
    width = 1 + int(np.searchsorted(t_s, t_s[0] + STEADY_S))
    padded = np.pad(duty, (width - 1, 0), mode="edge")
    steady: NDArray[np.bool_] = np.ptp(sliding_window_view(padded, width), axis=1) <= within
    return steady


def most_off(model: RobotModel, blocks: Mapping[int, Block]) -> tuple[float, str]:
    """How far residuals of duties are off together, where that is most [deviations], and where.

    ``blocks`` are those of recordings by number. Asked of every joint, kind of joint and leg, and
    of all of them (no word).
    """
    rows = [np.flatnonzero(np.isfinite(model.features[r].regulated.recorded)) for r in blocks]
    every = np.concatenate(rows) // LEVELS
    value = np.concatenate([block.value for block in blocks.values()])
    weight = 1.0 / (DUTY_FLOOR**2 + np.concatenate([block.extra for block in blocks.values()]))
    names = [model.base.joints[j].name for j in every.tolist()]
    words = [name.split(".") for name in names]
    places = ["", *(word for own in words for word in own), *names]
    found = [(0.0, "")]
    for place in dict.fromkeys(places):
        own = np.array(
            [place in {"", *each, name} for name, each in zip(names, words, strict=True)]
        )
        off = abs(float(value[own] @ weight[own])) / float(np.sqrt(weight[own].sum()))
        found.append((off, place))
    return max(found, key=lambda pair: pair[0])
