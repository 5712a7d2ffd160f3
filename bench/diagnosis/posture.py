"""The posture an arm had while it was recorded, and the load that gives one of its joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from bench.recording import Recording, RecordingError
from busemu.tables import Robot, ServoMount
from sim.posture import posture_load
from sim.robot import PhysicalRobot
from sim.rollout import Load

Floats = NDArray[np.float64]

READS = 6.0  #: reads, or rows if these are farther apart, over which angles are smoothed; assumed
STEP_S = 0.02  #: between the postures of a replay; assumed short against how fast an arm folds


def recorded_posture(
    recording: Recording, robot: Robot, joint: str, origin_s: float, end_s: float
) -> Floats | None:
    """Joint angles [rad] over a replay, (n, joints) in the order of the robot's servos.

    Rows are spread evenly from ``origin_s`` (host) over ``end_s``. ``None`` for a robot of one
    joint; a joint that neither bears ``joint`` nor hangs on it stands at 0 where it was not read.
    Raises :class:`RecordingError` where the position of another servo was not read.
    """
    if len(robot.servos) == 1:
        return None
    t_s = origin_s + np.linspace(0.0, end_s, max(2, 1 + math.ceil(end_s / STEP_S)))
    columns = []
    chain = _chain(robot, joint)
    for mount in robot.servos:
        key = (mount.servo_id, "present_position", "read")
        times, servo = recording.si(*key) if key in recording.by_series else (t_s[:0], t_s[:0])
        if not len(times) and mount.joint not in chain:
            columns.append(np.zeros_like(t_s))
            continue
        if not len(times):
            raise RecordingError(
                recording.path,
                f"present_position of servo {mount.servo_id} ({mount.joint}) was not read: the "
                "load on a joint needs the posture of all; record it, or leave this out",
            )
        angles = mount.direction * np.interp(t_s, times, servo) + mount.zero_rad
        apart_s = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        columns.append(_smooth(angles, apart_s / float(t_s[1] - t_s[0])))
    posture: Floats = np.stack(columns, axis=1)
    return posture


def _smooth(angles: Floats, steps: float) -> Floats:
    """Angles without most of their rounding: cubics over seven reads, ``steps`` rows apart each."""
    window = 2 * math.ceil(READS * max(steps, 1.0) / 2.0) + 1
    if len(angles) < window:
        return angles
    smooth: Floats = savgol_filter(angles, window, 3)
    return smooth


def _chain(robot: Robot, joint: str) -> set[str]:
    """Joints that bear a joint, itself, and those that hang on it."""
    parents = {body["name"]: body.get("parent") for body in robot.document.get("body", ())}
    up = {name: set(_bearing(parents, name)) for name in parents}
    return up.get(joint, set()) | {name for name, bearing in up.items() if joint in bearing}


def _bearing(parents: Mapping[str, str | None], name: str) -> Iterator[str]:
    at: str | None = name
    while at is not None:
        yield at
        at = parents.get(at)


def arm_load(
    robot: PhysicalRobot, mount: ServoMount, posture_rad: Floats, span_s: float | None = None
) -> Load:
    """The load on one servo of an arm, servo frame, as its posture (n, joints) changes.

    The rows are spread over ``span_s`` [s]; with ``None``, or one row, the arm stands still.
    """
    rows = len(posture_rad)
    step_s = None if span_s is None or rows == 1 else span_s / (rows - 1)
    told = posture_load(robot, mount.joint, posture_rad, step_s)
    own = posture_rad[:, [j.name for j in robot.joints].index(mount.joint)]
    # as if what the motion does pulled the joint, as it was recorded, from where it then was
    straight = told.cosine_nm + told.moved_nm * np.cos(own)
    level = told.sine_nm - told.moved_nm * np.sin(own)
    cosine, sine = math.cos(mount.zero_rad), math.sin(mount.zero_rad)
    return Load(
        told.inertia_kg_m2,
        sine_nm=straight * sine + level * cosine,
        cosine_nm=mount.direction * (straight * cosine - level * sine),
        moment_nm=max(told.moment_nm, 1e-9),
    )


def lever_m(base: PhysicalRobot, joint: str) -> float | None:
    """How far a link's centre of mass is from its joint's axis, if the link has a mass."""
    body = next((b for b in base.bodies if b.name == joint), None)
    if body is None or body.mass.mass_kg <= 0.0:
        return None
    return float(np.linalg.norm(np.cross(body.axis, body.mass.centre_m)))
