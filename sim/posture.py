"""One joint of an arm as the compiled rollouts see it, under the posture the other joints have.

Gravity's torque about a joint's axis is ``cosine cos q - sine sin q`` in the joint's own angle
``q``, whatever the others do: all that hangs on the joint turns about its axis as one piece. What
the others do stands in the two coefficients. Where the posture is told over time, so is the torque
of all that hangs on the joint for being accelerated, but for the joint's own constant inertia: each
body's mass times the acceleration of its centre, about the axis, and the change of its spin (Newton
and Euler).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .entries import PhysicsError
from .tree import PhysicalRobot

Floats = NDArray[np.float64]

FEWEST = 7  #: rows from which a motion is told


@dataclass(frozen=True, slots=True, eq=False)
class PostureLoad:
    """What hangs on one joint of an arm, in the joint's frame; arrays are of shape (n,)."""

    inertia_kg_m2: float  #: of all that hangs on the joint about its axis, at the mean posture
    cosine_nm: Floats  #: torque of gravity at the joint angle 0
    sine_nm: Floats  #: less the torque of gravity at the joint angle pi/2
    moment_nm: float  #: weight times lever, the mean over time
    moved_nm: Floats  #: torque on the joint of how the arm is accelerated, its own inertia apart

    def torque_nm(self, joint_rad: Floats) -> Floats:
        """Torque of gravity [N m] at the joint's own angles (n,), positive as the joint turns."""
        torque: Floats = self.cosine_nm * np.cos(joint_rad) - self.sine_nm * np.sin(joint_rad)
        return torque


def posture_load(
    robot: PhysicalRobot, joint: str, angles_rad: Floats, step_s: float | None = None
) -> PostureLoad:
    """The load on a joint while an arm has the joint angles ``angles_rad`` (n, joints).

    Columns are in the order of ``robot.joints``. Rows are ``step_s`` [s] apart and smooth; with
    ``None`` they are postures in which the arm stands still, and the joint's own column does not
    matter. Raises :class:`PhysicsError` for a robot with a trunk, or a joint that nothing hangs on.
    """
    if robot.trunk is not None:
        raise PhysicsError(
            f"{robot.name} walks: only a robot on a fixed base has the load its posture says"
        )
    angles = np.atleast_2d(np.asarray(angles_rad, np.float64))
    column = {j.name: k for k, j in enumerate(robot.joints)}
    if angles.shape[1] != len(column):
        raise PhysicsError(f"{robot.name} has {len(column)} joints, not {angles.shape[1]}")
    levers, axis, mass = _levers(robot, joint, angles, column)
    gravity = np.array(robot.ground.gravity_m_s2)
    inertia = _inertia(robot, joint, angles.mean(axis=0, keepdims=True), column)
    if mass <= 0.0 or inertia <= 0.0:
        raise PhysicsError(
            f"{robot.name}: nothing with a mass hangs on {joint}: give its body mass_kg"
        )
    return PostureLoad(
        inertia_kg_m2=inertia,
        cosine_nm=_dot(axis, np.cross(levers, gravity)),
        sine_nm=levers @ gravity,
        moment_nm=float(np.linalg.norm(levers, axis=1).mean() * np.linalg.norm(gravity)),
        moved_nm=_moved(robot, joint, angles, column, inertia, step_s),
    )


def _moved(
    robot: PhysicalRobot,
    joint: str,
    angles: Floats,
    column: dict[str, int],
    inertia: float,
    step_s: float | None,
) -> Floats:
    """Torque on a joint of how all that hangs on it is accelerated, without ``inertia`` of its own.

    0 at the ends, where nobody knows how the arm came to move.
    """
    needed = np.zeros(len(angles))
    if step_s is None or len(angles) < FEWEST:
        return needed
    places = _places(robot, angles, column)
    origin, turned = places[joint]
    axis = turned @ np.array(robot.body(joint).axis)
    for name in _hanging(robot, joint):
        at, way = places[name]
        mass = robot.mass_of(robot.body(name))
        arm = at + way @ np.array(mass.centre_m)
        rate = _rate(_rate(arm, step_s), step_s)
        spun = way @ mass.tensor_kg_m2 @ way.transpose(0, 2, 1)
        momentum = np.einsum("nij,nj->ni", spun, _spin(way, step_s))
        torque = mass.mass_kg * np.cross(arm - origin, rate) + _rate(momentum, step_s)
        needed += _dot(axis, torque)
    own = _rate(_rate(angles[:, column[joint]], step_s), step_s)
    moved = inertia * own - needed
    moved[:2] = moved[-2:] = 0.0
    return moved


def _rate(values: Floats, step_s: float) -> Floats:
    """Rate of change of rows [1/s], by central differences."""
    found: Floats = np.gradient(values, step_s, axis=0)
    return found


def _spin(way: Floats, step_s: float) -> Floats:
    """Angular velocity (n, 3) of rotations (n, 3, 3) [rad/s]."""
    turning = _rate(way, step_s) @ way.transpose(0, 2, 1)
    return np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)


def _levers(
    robot: PhysicalRobot, joint: str, angles: Floats, column: dict[str, int]
) -> tuple[Floats, Floats, float]:
    """First moment of mass off the axis (n, 3) at joint angle 0, the axis (n, 3), the mass."""
    places = _places(robot, angles, column, joint)
    origin, turned = places[joint]
    axis = turned @ np.array(robot.body(joint).axis)
    moment, total = np.zeros_like(origin), 0.0
    for name in _hanging(robot, joint):
        at, way = places[name]
        mass = robot.mass_of(robot.body(name))
        moment += mass.mass_kg * (at + way @ np.array(mass.centre_m) - origin)
        total += mass.mass_kg
    return moment - axis * _dot(axis, moment)[:, None], axis, total


def _inertia(robot: PhysicalRobot, joint: str, angles: Floats, column: dict[str, int]) -> float:
    """Inertia about a joint's axis of all that hangs on it [kg m^2], in one posture (1, joints)."""
    places = _places(robot, angles, column, joint)
    origin, turned = places[joint]
    axis = turned[0] @ np.array(robot.body(joint).axis)
    inertia = 0.0
    for name in _hanging(robot, joint):
        at, way = places[name]
        mass = robot.mass_of(robot.body(name))
        own = way[0].T @ axis
        arm = np.cross(axis, at[0] + way[0] @ np.array(mass.centre_m) - origin[0])
        inertia += float(own @ mass.tensor_kg_m2 @ own + mass.mass_kg * (arm @ arm))
    return inertia


def _hanging(robot: PhysicalRobot, joint: str) -> list[str]:
    """The body of a joint and all that it carries."""
    names = [robot.body(joint).name]
    for body in robot.bodies:  # parents before children
        if body.parent in names:
            names.append(body.name)
    return names


def _places(
    robot: PhysicalRobot, angles: Floats, column: dict[str, int], still: str | None = None
) -> dict[str, tuple[Floats, Floats]]:
    """Origin (n, 3) and rotation (n, 3, 3) of every body's frame in the root's; ``still`` at 0."""
    count = len(angles)
    root = np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
    places: dict[str, tuple[Floats, Floats]] = {}
    for body in robot.bodies:
        at, way = root if body.parent is None else places[body.parent]
        turn = angles[:, column[body.name]] * (body.name != still)
        yaw = _rotation(np.array([0.0, 0.0, 1.0]), np.array([body.yaw_rad]))
        own = _rotation(np.array(body.axis), turn)
        places[body.name] = at + way @ np.array(body.at_m), way @ yaw @ own
    return places


def _rotation(axis: Floats, angle: Floats) -> Floats:
    """Rotations (n, 3, 3) about an axis of length 1 (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    turned: Floats = np.eye(3) + sine * skew + (1.0 - cosine) * (skew @ skew)
    return turned


def _dot(a: Floats, b: Floats) -> Floats:
    product: Floats = np.einsum("ij,ij->i", a, b)
    return product
