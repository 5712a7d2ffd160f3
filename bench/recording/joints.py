"""Goals against positions, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot, ServoMount

from .errors import RecordingError
from .recording import Recording, Series
from .rules import READ, WRITE

Floats = NDArray[np.float64]

GOAL, POSITION = "goal_position", "present_position"


@dataclass(frozen=True, slots=True, eq=False)
class JointTrack:
    """What a joint was told and what it did; angles are the joint's own [rad], times the host's.

    Goals are of shape (goals,), positions of shape (samples,); lost replies are left out.
    """

    joint: str
    servo_id: int
    goal_t_s: Floats
    goal_rad: Floats
    position_t_s: Floats
    position_rad: Floats

    def goal_at(self, t_s: Floats) -> Floats:
        """Tell the goal in force at each of ``t_s`` [rad], same shape; NaN before the first."""
        latest = np.searchsorted(self.goal_t_s, t_s, side="right") - 1
        if not len(self.goal_rad):
            return np.full(np.shape(t_s), np.nan)
        return np.where(latest < 0, np.nan, self.goal_rad[np.maximum(latest, 0)])

    @property
    def error_rad(self) -> Floats:
        """Goal in force minus position, for every sample [rad]; NaN before the first goal."""
        return self.goal_at(self.position_t_s) - self.position_rad

    def since(self, t_s: float) -> JointTrack:
        """Move the zero of time to ``t_s``."""
        return JointTrack(
            self.joint,
            self.servo_id,
            self.goal_t_s - t_s,
            self.goal_rad,
            self.position_t_s - t_s,
            self.position_rad,
        )


def joint_track(recording: Recording, joint: str, robot: Robot | None = None) -> JointTrack:
    """Give goals and positions of one joint (``"leg1.femur"``).

    ``robot`` defaults to the one the metadata names. Raises :class:`RecordingError` if there is
    none, if it has no such joint, or if the servo's model is not known.
    """
    mount = _robot(recording, robot).by_joint.get(joint)
    if mount is None:
        known = ", ".join(sorted(_robot(recording, robot).by_joint))
        raise RecordingError(recording.path, f"no joint {joint!r} on the robot: use one of {known}")
    goal = _joint_angles(recording, mount, GOAL, WRITE)
    position = _joint_angles(recording, mount, POSITION, READ)
    return JointTrack(
        joint,
        mount.servo_id,
        goal.t_sample_s,
        goal.value,
        position.t_sample_s,
        position.value,
    )


def _robot(recording: Recording, robot: Robot | None) -> Robot:
    robot = recording.robot if robot is None else robot
    if robot is None:
        raise RecordingError(
            recording.path,
            f"the robot {recording.metadata.get('robot')!r} is not known: name one in the "
            'metadata as robot = "...", a name or the path of a robot file',
        )
    return robot


def _joint_angles(recording: Recording, mount: ServoMount, register: str, op: str) -> Series:
    times, servo_rad = recording.si(mount.servo_id, register, op)
    return Series(times, mount.direction * servo_rad + mount.zero_rad)
