"""The posture an arm had while it was recorded, and the load that gives one of its joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from bench.recording import Recording, RecordingError
from busemu.tables import Robot, ServoMount
from sim.posture import posture_load
from sim.robot import PhysicalRobot
from sim.rollout import Load

Floats = NDArray[np.float64]

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
        columns.append(mount.direction * np.interp(t_s, times, servo) + mount.zero_rad)
    posture: Floats = np.stack(columns, axis=1)
    return posture


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


def arm_load(robot: PhysicalRobot, mount: ServoMount, posture_rad: Floats) -> Load:
    """The load on one servo of an arm, servo frame, as its posture (n, joints) changes."""
    told = posture_load(robot, mount.joint, posture_rad)
    cosine, sine = math.cos(mount.zero_rad), math.sin(mount.zero_rad)
    return Load(
        told.inertia_kg_m2,
        sine_nm=told.cosine_nm * sine + told.sine_nm * cosine,
        cosine_nm=mount.direction * (told.cosine_nm * cosine - told.sine_nm * sine),
        moment_nm=max(told.moment_nm, 1e-9),
    )


def lever_m(base: PhysicalRobot, joint: str) -> float | None:
    """How far a link's centre of mass is from its joint's axis, if the link has a mass."""
    body = next((b for b in base.bodies if b.name == joint), None)
    if body is None or body.mass.mass_kg <= 0.0:
        return None
    return float(np.linalg.norm(np.cross(body.axis, body.mass.centre_m)))
