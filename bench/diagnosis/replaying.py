"""Recordings replayed through robot files as they are: how far each is from what was recorded.

Nothing is fitted. One joint is replayed as a diagnosis does it, under the recorded voltage where
that was read often; a robot that walks as a whole, from where its recording begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.recording import Recording
from busemu.tables import Robot
from sim.model import read_model

from .joint.beginning import begun
from .joint.gear import with_spring
from .joint.left import runs_away
from .joint.model import Hypothesis, JointModel, Kind
from .observed import held_at, observe, stuck
from .robot.judging import Reading
from .robot.replay import course, loaded, play
from .robot.running import walks
from .sense import DiagnosisError

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """One joint in one recording and what robot files make of its goals; arrays of shape (n,).

    Angles are the servo's own [rad], at the instants of its samples [s since the replay began].
    ``goal_rad`` is NaN where no goal is an angle; ``modelled_rad`` has a row for each robot file.
    """

    recording: str
    joint: str
    t_s: Floats
    goal_rad: Floats
    measured_rad: Floats
    modelled_rad: tuple[Floats, ...]

    @property
    def left_rad(self) -> Floats:
        """Recorded less modelled, shape (robot files, n)."""
        return self.measured_rad - np.stack(self.modelled_rad)


@dataclass(frozen=True, slots=True)
class Misfit:
    """How far some samples are from a model [rad]."""

    mean_absolute: float
    rms: float
    largest: float
    samples: int

    @classmethod
    def of(cls, some: Iterable[Replayed], which: int) -> Misfit:
        """All samples of some replays under one of the robot files."""
        left = np.abs(np.concatenate([one.left_rad[which] for one in some]))
        rms = float(np.sqrt(np.mean(left**2)))
        return cls(float(np.mean(left)), rms, float(np.max(left)), len(left))


def replay(
    robots: Sequence[Robot], recordings: Sequence[Recording], say: Callable[[str], None]
) -> list[Replayed]:
    """Replay what was recorded through each robot file, joint by joint in the order of the first.

    Joints that were not read, and such as stand still whatever they are told, are left out. Raises
    :class:`DiagnosisError` for robot files of different joints, for recordings of one name, for a
    gear that no replay can carry and where nothing is left,
    :class:`bench.recording.RecordingError` and :class:`sim.entries.PhysicsError`.
    """
    first = robots[0]
    names = [recording.name for recording in recordings]
    if twice := [name for name in names if names.count(name) > 1]:
        raise DiagnosisError(f"two recordings are named {twice[0]!r}: give them one by one")
    for other in robots[1:]:
        if [(m.joint, m.servo_id) for m in other.servos] != [
            (m.joint, m.servo_id) for m in first.servos
        ]:
            raise DiagnosisError(
                f"{other.path}: its joints are not those of {first.path}: compare files of one "
                "robot"
            )
    way = _walk if walks(first) else _joints
    made = []
    for robot in robots:
        say(f"replaying through {robot.path}")
        made.append(way(robot, recordings))
    if not made[0]:
        raise DiagnosisError("no joint moves as it is told in these recordings: is torque on?")
    return [
        Replayed(
            one.recording,
            one.joint,
            one.t_s,
            one.goal_rad,
            one.measured_rad,
            tuple(other[key].modelled_rad[0] for other in made),
        )
        for key, one in made[0].items()
    ]


def _joints(robot: Robot, recordings: Sequence[Recording]) -> dict[tuple[str, str], Replayed]:
    """Every joint of a rig or an arm, each on its own, with the gear that its file has."""
    base = read_model(robot)
    made = {}
    for joint in base.joints:
        some = [o for o in observe(recordings, robot, joint.name, needed=False) if not stuck(o)]
        some = begun(base, robot, some)
        if not some:
            continue
        model = with_spring(JointModel(base, robot, some))
        believed = np.zeros(len(model.nuisances))
        left = model.residuals(Hypothesis(), [believed], kinds=(Kind.POSITION,))[0]
        if runs_away(left):
            raise DiagnosisError(
                f"{robot.path}: the gear of {joint.name} is too stiff for so light a load, and "
                "replays run away: soften it, or tell what hangs on the joint"
            )
        for r, observed in enumerate(some):
            t_s, goal, measured = observed.motion
            modelled = measured - left[r, Kind.POSITION].value
            made[observed.name, joint.name] = Replayed(
                observed.name, joint.name, t_s, goal, measured, (modelled,)
            )
    return made


def _walk(robot: Robot, recordings: Sequence[Recording]) -> dict[tuple[str, str], Replayed]:
    """Every joint of a whole robot, which stands up and walks as it was told."""
    made = {}
    for recording in recordings:
        told = course(recording, robot)
        track = play(loaded(robot, told.condition), told)
        for j, mount in enumerate(robot.servos):
            t_s = told.sample_s[j]
            angles = (
                held_at(told.goals[mount.joint], t_s),
                told.position_rad[j],
                Reading().at(track, told, j),
            )
            goal, measured, modelled = (
                mount.direction * (angle - mount.zero_rad) for angle in angles
            )
            made[told.name, mount.joint] = Replayed(
                told.name, mount.joint, t_s, goal, measured, (modelled,)
            )
    return made
