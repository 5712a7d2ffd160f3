"""How a whole robot's model does on recordings: exact replays, compared sample by sample.

A fit goes by traces that add up; what is said of it goes by replays of the very robot that stands
in the model file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.model import Addition

from ..observed import held_at
from ..report.traces import Trace
from .features import Features, RobotKind
from .gait import commanded_lift
from .improved import of_nuisances, where_recorded, with_all
from .model import ENGINES_RAD, RobotModel
from .replay import Course, Track, loaded, play

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reading:
    """How a fit says positions were read: later by so much, by so much of the wait, shown more."""

    late_s: float = 0.0
    turn: float = 0.0
    shown_rad: tuple[float, ...] = ()

    @classmethod
    def of(cls, model: RobotModel, z: Floats) -> Reading:
        """From the nuisances' values."""
        fitted = {n.name: float(x) * n.deviation for n, x in zip(model.nuisances, z, strict=False)}
        joints = [joint.name for joint in model.base.joints]
        return cls(
            fitted.get("sampling", 0.0),
            fitted.get("turn", 0.0),
            tuple(fitted.get(f"reading {joint}", 0.0) for joint in joints),
        )

    def at(self, track: Track, course: Course, joint: int) -> Floats:
        """A replay's angles [rad] as they would have been read."""
        t = course.sample_s[joint] + self.late_s + self.turn * course.wait_s[joint]
        shown = self.shown_rad[joint] if self.shown_rad else 0.0
        return track.at(joint, t) + shown


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """One recording under one model: angles [rad] of every joint as they would have been read."""

    course: Course
    modelled_rad: tuple[Floats, ...]

    @property
    def squares(self) -> tuple[float, int]:
        """Sum of squared deviations [rad^2] and how many samples they are of."""
        apart = [
            recorded - modelled
            for recorded, modelled in zip(self.course.position_rad, self.modelled_rad, strict=True)
        ]
        every = np.concatenate(apart)
        return float(every @ every), len(every)


def rmse_rad(judged: Sequence[Judgement]) -> float:
    """Root mean square over all samples of all joints of some recordings [rad]."""
    sums = np.array([one.squares for one in judged])
    return float(np.sqrt(sums[:, 0].sum() / sums[:, 1].sum()))


def steady_rmse_rad(features: Sequence[Features], judged: Sequence[Judgement]) -> float:
    """The same of the samples in which robots walk: how one stands up before is another matter."""
    each = zip(features, judged, strict=True)
    return float(np.sqrt(np.mean([f.steady_square(one.modelled_rad) for f, one in each])))


def judge(
    model: RobotModel, robot: Robot, z: Floats, added: Sequence[Addition], which: Sequence[int]
) -> list[Judgement]:
    """Replay recordings with a fit's nuisances and with effects beside them."""
    reading = Reading.of(model, z)
    ordinary = of_nuisances(model.base, model.nuisances, z.tolist(), "fitted")
    found = []
    for r in which:
        course = model.features[r].course
        true = with_all(loaded(robot, course.condition), (*added, *ordinary))
        track = play(where_recorded(true, model.nuisances, z.tolist()), course)
        joints = range(len(course.position_rad))
        found.append(Judgement(course, tuple(reading.at(track, course, j) for j in joints)))
    return found


def floor_rad(model: RobotModel, which: Sequence[int]) -> float:
    """What a sound model leaves of samples: rounding, spread of replays, what engines differ by."""
    spread = [float(np.mean(model.spread[model.motion[r]][RobotKind.JOINTS])) for r in which]
    return float(np.sqrt(model.quantum_rad**2 / 12.0 + ENGINES_RAD**2 + np.mean(spread)))


def traces(robot: Robot, before: Sequence[Judgement], after: Sequence[Judgement]) -> list[Trace]:
    """Every joint of every recording that was judged, for the pictures of a report."""
    made = []
    legs = [str(leg["name"]) for leg in robot.document["leg"]]
    for one, other in zip(before, after, strict=True):
        course = one.course
        for j, mount in enumerate(robot.servos):
            t = course.sample_s[j]
            if not len(t):
                continue
            leg = legs.index(mount.joint.split(".", maxsplit=1)[0])
            lifted = commanded_lift(course.goals, robot, t)[:, leg]
            angles = (
                held_at(course.goals[mount.joint], t),
                course.position_rad[j],
                one.modelled_rad[j],
                other.modelled_rad[j],
            )
            goal, measured, was, now = (mount.direction * (a - mount.zero_rad) for a in angles)
            parts = {"stance": ~lifted, "swing": lifted}
            made.append(
                Trace(course.name, course.group, mount.joint, t, goal, measured, was, now, parts)
            )
    return made
