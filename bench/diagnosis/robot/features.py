"""Numbers that a recording and its replays are compared by: means over gait phase, joint by joint.

Long replays with contacts drift apart in where the robot stands, but what its joints do at a phase
of the gait does not. So a recording comes down to the mean of each joint in each bin of the phase;
with the height of the trunk where somebody watched it, and with how much joints shake.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.stepped import TICK_S
from sim.tree import PhysicalRobot

from ..observed import held_at
from .gait import Bins, Phase, commanded_lift, gait_phase
from .leaning import AXES, rows_of
from .regulated import LEVELS, Regulated
from .replay import SETTLE_S, Course, Span, Track, loaded
from .shaking import PHASES, Shaking

Floats = NDArray[np.float64]

CYCLES = 3.0  #: of a gait, in short replays: over fewer, contacts make means rough
APART_S = 1000.0  #: between the joints' times in a block, so that noise remembers none of another
STILL_S = 0.1  #: at the beginning of a recording in which a robot has not moved yet; assumed
STAND_UP_S = 1.0  #: left out of windows of time at the beginning; assumed
#: deviation of samples of a window, below which they show one count; one of a dozen may differ
STILL_COUNTS = 0.3
ALIKE_RAD = 0.01  #: commanded profiles nearer than this are one motion; two counts of a sensor


class RobotKind(enum.Enum):
    """Kinds of a whole robot's residuals."""

    JOINTS = "joints"
    HEIGHT = "height"  #: of the trunk over where it began, where an observer recorded it
    LEAN = "lean"  #: of the trunk about two axes, where somebody recorded it
    VOLTAGE = "voltage"  #: of the supply, where servos' registers of it were read
    SHAKING = "shaking"  #: of joints from sample to sample, as a logarithm
    DUTY = "duty"  #: of laws along recorded angles that hardly change, where loads were read


#: what is compared by its means
MEANS = (
    RobotKind.JOINTS,
    RobotKind.HEIGHT,
    RobotKind.LEAN,
    RobotKind.VOLTAGE,
    RobotKind.DUTY,
)


def by_kind(
    angle_rad: Floats,
    height_m: Floats,
    lean_rad: Floats,
    voltage_v: Floats,
    shaken: Floats,
    duty: Floats,
) -> dict[RobotKind, Floats]:
    """Rows by kind, without channels that nobody watched."""
    found = {RobotKind.JOINTS: angle_rad, RobotKind.SHAKING: shaken, RobotKind.DUTY: duty}
    if len(height_m):
        found[RobotKind.HEIGHT] = height_m
    if len(lean_rad):
        found[RobotKind.LEAN] = lean_rad
    if len(voltage_v):
        found[RobotKind.VOLTAGE] = voltage_v
    return found


class Means(NamedTuple):
    """What a replay comes down to, in rows as :class:`Features` has them."""

    angle_rad: Floats
    height_m: Floats
    lean_rad: Floats
    voltage_v: Floats
    shaken: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """One recording in bins; joint rows are those of ``joint_row`` (rows,) and ``bin`` (rows,).

    ``position_rad`` and ``goal_rad`` are means as recorded, (rows,); ``t_s`` is ascending, with
    the joints :data:`APART_S` apart.
    """

    course: Course
    phase: Phase | None
    bins: tuple[Bins, ...]
    joint_row: NDArray[np.intp]
    bin: NDArray[np.intp]
    t_s: Floats
    count: Floats  #: samples in a row
    position_rad: Floats
    goal_rad: Floats
    stance: NDArray[np.bool_]  #: whether the leg of the row's joint is commanded to stand
    height_bins: Bins | None
    height_m: Floats
    lean_bins: Bins | None
    lean_rad: Floats  #: as rows of :mod:`.leaning`
    voltage_bins: Bins | None
    voltage_v: Floats
    shaking: Shaking
    shaken: Floats  #: as recorded
    regulated: Regulated

    @classmethod
    def of(cls, course: Course, robot: Robot) -> Features:
        """Bin a recording by its own goals."""
        phase = gait_phase(course.goals, robot)
        bins = tuple(_bins(phase, t) for t in course.sample_s)
        full = [np.flatnonzero(b.counts > 0) for b in bins]
        joint_row = np.repeat(np.arange(len(bins)), [len(f) for f in full])
        index = np.concatenate(full)
        times = np.concatenate(
            [j * APART_S + b.t_s[f] for j, (b, f) in enumerate(zip(bins, full, strict=True))]
        )
        goals = [
            held_at(course.goals[mount.joint], t)
            for mount, t in zip(robot.servos, course.sample_s, strict=True)
        ]
        lifted = [
            commanded_lift(course.goals, robot, t)[:, _leg(robot, mount.joint)]
            for mount, t in zip(robot.servos, course.sample_s, strict=True)
        ]

        def rows(values: tuple[Floats, ...] | list[Floats]) -> Floats:
            means = [b.mean(v)[f] for b, v, f in zip(bins, values, full, strict=True)]
            return np.concatenate(means)

        walks = [b.bin >= 0 for b in bins]
        shaking = Shaking.of(
            course.sample_s, course.position_rad, lifted, walks, course.quantum_rad
        )
        seen, lean, volts = course.height, course.lean, course.voltage
        height_bins, lean_bins, voltage_bins = (
            None if watched is None else _bins(phase, watched[0]) for watched in (seen, lean, volts)
        )
        return cls(
            course=course,
            phase=phase,
            bins=bins,
            joint_row=joint_row,
            bin=index,
            t_s=times,
            count=np.concatenate([b.counts[f] for b, f in zip(bins, full, strict=True)]) * 1.0,
            position_rad=rows(course.position_rad),
            goal_rad=rows(goals),
            stance=rows([up.astype(np.float64) for up in lifted]) < 0.5,
            height_bins=height_bins,
            height_m=_mean(height_bins, None if seen is None else _risen(*seen)),
            lean_bins=lean_bins,
            lean_rad=np.empty(0)
            if lean_bins is None or lean is None
            else rows_of([lean_bins.mean(angle) for angle in lean[1].T]),
            voltage_bins=voltage_bins,
            voltage_v=_mean(voltage_bins, None if volts is None else volts[1]),
            shaking=shaking,
            shaken=shaking.rows(course.position_rad),
            regulated=Regulated.of(course, robot, loaded(robot, course.condition)),
        )

    def rows(self, values: tuple[Floats, ...] | list[Floats]) -> Floats:
        """Means of something sampled with the positions, (rows,)."""
        found = np.empty(len(self.bin))
        for j, (bins, value) in enumerate(zip(self.bins, values, strict=True)):
            mine = self.joint_row == j
            found[mine] = bins.mean(value)[self.bin[mine]]
        return found

    @property
    def rounding_rad2(self) -> Floats:
        """Variance of rounding that means keep (rows,), as a joint stands and shows one count."""
        if self.phase is not None:
            return np.zeros(len(self.bin))
        angles = self.course.position_rad
        away = self.rows([q**2 for q in angles]) - self.position_rad**2
        still = away < (STILL_COUNTS * self.course.quantum_rad) ** 2
        return np.where(still, self.course.quantum_rad**2 / 12.0, 0.0)

    @property
    def recorded(self) -> dict[RobotKind, Floats]:
        """Rows as they were recorded, by kind."""
        own = self.position_rad, self.height_m, self.lean_rad, self.voltage_v, self.shaken
        return by_kind(*own, self.regulated.recorded)

    @property
    def size(self) -> int:
        """Joint rows."""
        return len(self.bin)

    @property
    def span(self) -> Span | None:
        """A span of some cycles, with what a replay needs before to settle; or all."""
        if self.phase is None:
            return None
        steady = self.phase.t_s[np.isfinite(self.phase.cycles)]
        start = max(0.0, float(steady[0]) - SETTLE_S)
        end = min(self.course.end_s, float(steady[0]) + CYCLES * self.phase.period_s)
        return start, end

    def steady_square(self, modelled_rad: Sequence[Floats]) -> float:
        """Mean square of recorded less modelled samples that lie in bins [rad^2].

        Before a robot walks it stands up, and may do so in many ways.
        """
        every = zip(self.course.position_rad, modelled_rad, self.bins, strict=True)
        left = np.concatenate([(seen - told)[b.bin >= 0] for seen, told, b in every])
        return float(np.mean(left**2))

    def of_track(self, track: Track) -> Means:
        """Means of a replay, and its shaking."""
        found = np.empty(len(self.bin))
        joints = enumerate(self.course.sample_s)
        shaken = self.shaking.rows([track.at(j, t) for j, t in joints], track.span)
        for j, (bins, t) in enumerate(zip(self.bins, self.course.sample_s, strict=True)):
            mine = self.joint_row == j
            told = bins.within(t, track.span)
            found[mine] = told.mean(track.at(j, t))[self.bin[mine]]
        height, volts = (
            np.empty(0) if bins is None or seen is None else self._watched(bins, seen[0], track, of)
            for bins, seen, of in (
                (self.height_bins, self.course.height, track.height_m - track.rest_m),
                (self.voltage_bins, self.course.voltage, track.voltage_v),
            )
        )
        lean = np.empty(0)
        if self.lean_bins is not None and self.course.lean is not None:
            bins, seen_s = self.lean_bins, self.course.lean[0]
            angles = [self._watched(bins, seen_s, track, of) for of in track.lean_rad.T]
            lean = rows_of(angles)
        return Means(found, height, lean, volts, shaken)

    def _watched(self, bins: Bins, seen_s: Floats, track: Track, value: Floats) -> Floats:
        """Means of what a replay shows now and then, at the instants that somebody looked.

        Of a bin in which nobody did all of it is told: in a repeat somebody may have looked there.
        """
        looks_s, span = track.look_t_s, track.span
        asked = bins.within(seen_s, span).mean(np.interp(seen_s, looks_s, value))
        every = _bins(self.phase, looks_s).within(looks_s, span).mean(value)
        others = np.full(len(asked), np.nan)
        others[: len(every)] = every[: len(asked)]
        return np.where(np.isnan(asked), others, asked)

    def speeds(self, track: Track) -> tuple[Floats, Floats]:
        """How means move with a later instant [rad/s], and with a later turn (rows,)."""
        speed = [
            (track.at(j, t + TICK_S) - track.at(j, t - TICK_S)) / (2.0 * TICK_S)
            for j, t in enumerate(self.course.sample_s)
        ]
        turned = [v * w for v, w in zip(speed, self.course.wait_s, strict=True)]
        return self.rows(speed), self.rows(turned)

    def pressed(self, track: Track, robot: PhysicalRobot) -> Floats:
        """Share of each row's samples at which the foot of its joint's leg pressed (rows,)."""
        legs = [leg.name for leg in robot.legs]
        values = []
        for joint, t in zip(robot.joints, self.course.sample_s, strict=True):
            look = np.searchsorted(track.look_t_s, t, side="right") - 1
            look = np.clip(look, 0, len(track.look_t_s) - 1)
            values.append(track.stands[look, legs.index(joint.leg)].astype(np.float64))
        return self.rows(values)

    def scatter(self, track: Track) -> Floats:
        """Variance of each row's mean residual from its spread between turns [rad^2]."""
        found = np.empty(len(self.bin))
        for j, (bins, t) in enumerate(zip(self.bins, self.course.sample_s, strict=True)):
            residual = self.course.position_rad[j] - track.at(j, t)
            mine = self.joint_row == j
            found[mine] = bins.scatter(residual)[self.bin[mine]]
        return found

    def like(self, other: Features) -> bool:
        """Whether what changes a robot does the same to both: walks, or one motion, of one load."""
        alike = _weights(self.course) == _weights(other.course) and len(self.bin) == len(other.bin)
        return alike and self.shows(other)

    def shows(self, other: Features) -> bool:
        """Whether what changes a robot does much the same to both: walks, or one motion.

        The other may have fewer rows, as it ends sooner.
        """
        rows = self.rows_of(other)
        if rows is None:
            return False
        walk = self.phase is not None and other.phase is not None
        return walk or self._told_like(other, rows[RobotKind.JOINTS])

    def repeats(self, other: Features) -> bool:
        """Whether two recordings are of one motion, walk or not, with one load."""
        return self.like(other) and self._told_like(other, np.arange(len(self.bin)))

    def _told_like(self, other: Features, rows: NDArray[np.intp]) -> bool:
        apart = self.goal_rad[rows] - other.goal_rad
        return bool(np.sqrt(np.mean(apart**2)) < ALIKE_RAD)

    def of_joint(self, joint: int, kind: RobotKind) -> NDArray[np.bool_]:
        """Which rows of a kind are a joint's."""
        rows = {
            RobotKind.JOINTS: self.joint_row,
            RobotKind.HEIGHT: np.full(len(self.height_m), -1),
            RobotKind.LEAN: np.full(len(self.lean_rad), -1),
            RobotKind.VOLTAGE: np.full(len(self.voltage_v), -1),
            RobotKind.SHAKING: np.arange(len(self.shaken)) // len(PHASES),
            RobotKind.DUTY: np.arange(len(self.regulated.recorded)) // LEVELS,
        }
        own: NDArray[np.bool_] = rows[kind] == joint
        return own

    def rows_of(self, other: Features) -> Mapping[RobotKind, NDArray[np.intp]] | None:
        """Which rows of this recording are those of another, by kind; ``None``: not all are here.

        Bins are counted from the beginning, be they of a gait's phase or of time.
        """
        number = np.full((len(self.bins), 1 + max(self.bin.max(), other.bin.max())), -1)
        number[self.joint_row, self.bin] = np.arange(len(self.bin))
        rows = {
            RobotKind.JOINTS: number[other.joint_row, other.bin],
            RobotKind.DUTY: np.arange(len(self.regulated.recorded)),
        }
        for kind, mine, theirs, parts in (
            (RobotKind.HEIGHT, self.height_m, other.height_m, 1),
            (RobotKind.LEAN, self.lean_rad, other.lean_rad, AXES),
            (RobotKind.VOLTAGE, self.voltage_v, other.voltage_v, 1),
            (RobotKind.SHAKING, self.shaken, other.shaken, 1),
        ):
            if bool(len(mine)) != bool(len(theirs)) or len(theirs) > len(mine):
                return None
            if len(theirs):
                part, own = np.arange(len(theirs) // parts), len(mine) // parts
                rows[kind] = np.concatenate([k * own + part for k in range(parts)])
        return rows if rows[RobotKind.JOINTS].min() >= 0 else None


def first_of(
    features: Sequence[Features], alike: Callable[[Features, Features], bool]
) -> tuple[int, ...]:
    """For each recording the first that it is alike."""
    found: list[int] = []
    for r, one in enumerate(features):
        first = next((m for m in sorted(set(found)) if alike(features[m], one)), r)
        found.append(first)
    return tuple(found)


def shown_by(
    features: Sequence[Features], motion: Sequence[int], judging: Collection[int]
) -> tuple[int, ...]:
    """For each recording the motion whose traces and curves are taken for its own.

    Of walks that are fitted their own. Where there is no gait replays are long, and one motion
    stands for all loads: the longest, as an overloaded robot stands for a shorter time.
    """
    fitted = [m for q, m in enumerate(motion) if q not in judging]
    found = []
    for r, own in enumerate(motion):
        others = [m for m in fitted if features[m].shows(features[r])]
        walks = own in fitted and features[r].phase is not None
        found.append(own if walks or not others else max(others, key=lambda m: features[m].size))
    return tuple(found)


def _bins(phase: Phase | None, t_s: Floats) -> Bins:
    return Bins.of_time(t_s, STAND_UP_S) if phase is None else Bins.of_phase(phase, t_s)


def _mean(bins: Bins | None, values: Floats | None) -> Floats:
    return np.empty(0) if bins is None or values is None else bins.mean(values)


def _weights(course: Course) -> tuple[object, ...]:
    words = ("payload_kg", "trunk_load_kg", "supply_v", "support")
    return tuple(course.condition.get(word) for word in words)


def _risen(t_s: Floats, height_m: Floats) -> Floats:
    """Heights over that of the beginning: how high a marker sits on a robot is not known."""
    risen: Floats = height_m - np.mean(height_m[t_s <= t_s[0] + STILL_S])
    return risen


def _leg(robot: Robot, joint: str) -> int:
    names = [str(leg["name"]) for leg in robot.document["leg"]]
    return names.index(joint.split(".", maxsplit=1)[0])
