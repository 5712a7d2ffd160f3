"""What stands where in the arrays of a robot on legs: bodies, what touches the ground, its motion.

Body 0 is the trunk, the others come in the robot's order, parents before children. The velocities'
numbers (dofs): 0 to 2 turn the trunk, 3 to 5 move its frame's origin, then one joint a body. All in
the world's axes, SI. "About the origin" means: about where the trunk's origin is as a step begins.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..drive.fields import Array
from ..shapes import Kind, Shape, pitch_matrix
from ..tree import Body, PhysicalRobot

Integers = NDArray[np.int64]

FREE = 6  #: dofs of the trunk
A_CONTACT = 4  #: rows of a contact
ROWS = 256  #: of contacts and of joints at their stops (one each), at most, in one step

# --- bodies[field, body]
MASS = 0  #: [kg]
CENTRE = 1  #: three: of mass, in the body's frame [m]
INERTIA = 4  #: six: about the centre; xx, yy, zz, xy, xz, yz [kg m^2]
AT = 10  #: three: the joint in the parent's frame [m]
YAW = 13  #: cosine and sine of the frame's turn in the parent's
AXIS = 15  #: three: the joint's, of length 1
LOWER = 18  #: stop of the joint [rad]
UPPER = 19
FRICTION = 20  #: of the body with the ground
STIFFNESS = 21  #: of a contact with the ground [N/m], infinite: rigid
DAMPING = 22  #: [N s/m]
TURNING = 23  #: arm at which a contact of it rubs that turns on its spot [m]
REACH = 24  #: of its farthest point from its frame's origin [m]
BODIES = 25

# --- points[field, point]: what can touch the ground
PLACE = 0  #: three: in the body's frame [m]
RADIUS = 3  #: of the sphere about it, or of the disc [m]
NORMAL = 4  #: three: of a disc, whose lowest point touches; 0 is a sphere
POINTS = 7


class Tree(NamedTuple):
    """A robot's bodies. ``parent`` and ``servo`` (bodies,), ``owner`` (points,): whose each is."""

    bodies: Array
    parent: Integers
    servo: Integers
    points: Array
    owner: Integers
    gravity: Array


class Motion(NamedTuple):
    """Where it all is, and how fast. A point's last impulse [N s] is where the next search begins.

    ``turned`` (3, 3) and ``origin`` (3,): the trunk's frame; ``angle`` (bodies,) of joints, the
    first is none; ``pace`` (dofs,); ``impulse`` (A_CONTACT, points).
    """

    turned: Array
    origin: Array
    angle: Array
    pace: Array
    impulse: Array


class Work(NamedTuple):
    """What one step fills anew."""

    frames: Array  #: (bodies, 3, 3)
    places: Array  #: of the bodies' frames about the origin (bodies, 3)
    screws: Array  #: of unit speed of each joint (bodies, 6)
    inertias: Array  #: mass, mass times centre, tensor about the origin (bodies, 10)
    speeds: Array  #: spatial, turning first (bodies, 6)
    pulls: Array  #: accelerations without the joints', then forces (bodies, 12)
    mass: Array  #: (dofs, dofs), then its factor
    push: Array  #: forces, then accelerations (dofs,)
    rows: Array  #: of contacts, each by the factor's inverse (ROWS, dofs)
    coupling: Array  #: of rows (ROWS, ROWS)
    terms: Array  #: of rows: target speed, softness, free speed, impulse; of contacts
    #: friction and how much more stiffly they would have to be held to slide no more (6, ROWS)
    which: Integers  #: point of a row's contact, or its body's joint's stop as -1 - body (ROWS,)


def tree(robot: PhysicalRobot) -> Tree:
    """A robot on legs as the compiled step reads it."""
    trunk = robot.trunk
    if trunk is None:
        raise ValueError(f"{robot.name} has no trunk: it does not stand on legs")
    order = {joint.name: i for i, joint in enumerate(robot.joints)}
    index = {body.name: i for i, body in enumerate(robot.bodies, 1)}
    bodies = np.zeros((BODIES, len(index) + 1))
    every = [
        (trunk.shapes, robot.trunk_mass),
        *((b.shapes, robot.mass_of(b)) for b in robot.bodies),
    ]
    points = [(i, point) for i, (shapes, _) in enumerate(every) for point in _points(shapes)]
    for i, (_, mass) in enumerate(every):
        bodies[MASS, i] = mass.mass_kg
        bodies[CENTRE : CENTRE + 3, i] = mass.centre_m
        bodies[INERTIA : INERTIA + 6, i] = mass.inertia_kg_m2
        own = [np.linalg.norm(p[:3]) + p[RADIUS] for owner, p in points if owner == i]
        bodies[REACH, i] = max(own, default=0.0)
    for i, body in enumerate(robot.bodies, 1):
        _hang(robot, bodies[:, i], body, order)
    _touch(robot, bodies, index)
    return Tree(
        bodies,
        np.array([-1, *(index[b.parent] if b.parent else 0 for b in robot.bodies)]),
        np.array([-1, *(order[body.name] for body in robot.bodies)]),
        np.array([point for _, point in points]).T.copy(),
        np.array([owner for owner, _ in points]),
        np.array(robot.ground.gravity_m_s2),
    )


def _hang(robot: PhysicalRobot, row: Array, body: Body, order: dict[str, int]) -> None:
    joint = robot.joints[order[body.name]]
    row[AT : AT + 3] = body.at_m
    row[YAW : YAW + 2] = np.cos(body.yaw_rad), np.sin(body.yaw_rad)
    row[AXIS : AXIS + 3] = body.axis
    row[LOWER], row[UPPER] = joint.lower_rad, joint.upper_rad


def _touch(robot: PhysicalRobot, bodies: Array, index: dict[str, int]) -> None:
    """Friction and springs of every body on the ground: those of one are in series."""
    ground = robot.ground
    bodies[FRICTION] = robot.contact.friction * ground.friction
    bodies[STIFFNESS], bodies[DAMPING] = ground.stiffness_n_m, ground.damping_n_s_m
    for leg in robot.legs:
        i, foot = index[f"{leg.name}.tibia"], leg.foot
        bodies[FRICTION, i] = foot.friction * ground.friction
        gives = 1.0 / foot.stiffness_n_m + 1.0 / ground.stiffness_n_m
        bodies[STIFFNESS, i] = 1.0 / gives if gives else math.inf
        bodies[DAMPING, i] += foot.damping_n_s_m
        bodies[TURNING, i] = foot.turning_m


def _points(shapes: tuple[Shape, ...]) -> list[Array]:
    """Corners, ends of cylinders and spheres: all that can be lowest."""
    found = []
    for shape in shapes:
        turn, size, at = pitch_matrix(shape.pitch_rad), shape.size_m, np.array(shape.at_m)
        if shape.kind is Kind.SPHERE:
            found.append(np.array([*at, size[0], 0.0, 0.0, 0.0]))
        elif shape.kind is Kind.CYLINDER:
            for end in (-0.5, 0.5):
                axis = turn[:, 2]
                found.append(np.array([*(at + end * size[1] * axis), size[0], *axis]))
        else:
            for corner in np.ndindex(2, 2, 2):
                arm = turn @ ((np.array(corner) - 0.5) * size)
                found.append(np.array([*(at + arm), 0.0, 0.0, 0.0, 0.0]))
    return found


def motion(of: Tree) -> Motion:
    """A robot's motion, to be filled."""
    count = len(of.parent)
    still = np.zeros(count), np.zeros(FREE + count - 1), np.zeros((A_CONTACT, len(of.owner)))
    return Motion(np.eye(3), np.zeros(3), *still)


def work(of: Tree) -> Work:
    """Room for one step."""
    count = len(of.parent)
    dofs = FREE + count - 1
    return Work(
        np.zeros((count, 3, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 6)),
        np.zeros((count, 10)),
        np.zeros((count, 6)),
        np.zeros((count, 12)),
        np.zeros((dofs, dofs)),
        np.zeros(dofs),
        np.zeros((ROWS, dofs)),
        np.zeros((ROWS, ROWS)),
        np.zeros((6, ROWS)),
        np.zeros(ROWS, np.int64),
    )
