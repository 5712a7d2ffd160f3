"""A robot as the simulator needs it: a tree of bodies, the servos at its joints, what it stands on.

Hexapods and rigs are the same thing. A hexapod's root is its trunk, free to move; a rig's root is a
base that is fixed to the world. Every other body hangs on one joint, which bears its name, with a
servo on it.

Frames. Root: z up; a hexapod's x is to the right, y forward, the origin at the height of the coxa
axes. A body's frame stands at its joint, turned by ``yaw_rad`` about the parent's z axis at joint
angle 0, and turns with the joint about ``axis``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from busemu.plant import Reading

from .drive.parameters import DriveParameters
from .entries import PhysicsError
from .shapes import MassProperties, Shape, Vector, together

SEGMENTS = ("coxa", "femur", "tibia")
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body and the joint that moves it; ``parent`` is ``None`` on the root."""

    name: str
    parent: str | None
    at_m: Vector  #: the joint's place in the parent's frame
    yaw_rad: float
    axis: Vector  #: of length 1, in the body's own frame
    mass: MassProperties  #: in the body's own frame
    shapes: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Foot:
    """The sphere about a leg's tip; the stiffness is that of the tip alone (infinite: rigid)."""

    radius_m: float
    friction: float  #: times the ground's
    stiffness_n_m: float = math.inf
    damping_n_s_m: float = 0.0
    #: arm at which it rubs where it turns on its spot [m]; two thirds of the patch that touches,
    #: if that presses evenly. Replays have it (:mod:`sim.floating`), PyBullet does not
    turning_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Leg:
    """Where a leg sits on the trunk (trunk frame), how long its links are, and its foot."""

    name: str
    x_m: float
    y_m: float
    yaw_rad: float
    lengths_m: Mapping[str, float]  #: by segment, from joint to joint and to the tip
    foot: Foot

    def foot_m(self, by_segment: Mapping[str, float]) -> Vector:
        """Centre of the foot in the leg's frame [m]: outward, sideways (left), up."""
        coxa, femur, tibia = (self.lengths_m[segment] for segment in SEGMENTS)
        lift = by_segment["femur"]
        shank = lift + by_segment["tibia"]
        reach = coxa + femur * math.cos(lift) + tibia * math.cos(shank)
        turn = by_segment["coxa"]
        up = femur * math.sin(lift) + tibia * math.sin(shank)
        return reach * math.cos(turn), reach * math.sin(turn), up


@dataclass(frozen=True, slots=True)
class Trunk:
    """A free root; its mass includes the battery and any extra load."""

    mass: MassProperties
    shapes: tuple[Shape, ...]

    @property
    def belly_m(self) -> float:
        """Height of its lowest point in the trunk frame [m], negative."""
        return min(shape.lowest_m for shape in self.shapes)


@dataclass(frozen=True, slots=True)
class Contact:
    """What all of a robot's surface has in common."""

    friction: float
    restitution: float


@dataclass(frozen=True, slots=True)
class Ground:
    """The ground under a robot; the world's frame is the ground's, its z axis the normal.

    On a tilted ground gravity leans: ``pitch_rad`` positive rises towards +y (forward),
    ``roll_rad`` positive falls towards +x (right).
    """

    friction: float = 1.0  #: times the foot's
    stiffness_n_m: float = math.inf  #: under one contact
    damping_n_s_m: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    @property
    def gravity_m_s2(self) -> Vector:
        """Gravity in the ground's frame."""
        if self.pitch_rad == 0.0 and self.roll_rad == 0.0:
            return (0.0, 0.0, -GRAVITY_M_S2)
        right = math.sin(self.roll_rad)
        back = -math.sin(self.pitch_rad) * math.cos(self.roll_rad)
        down = -math.cos(self.pitch_rad) * math.cos(self.roll_rad)
        return (GRAVITY_M_S2 * right, GRAVITY_M_S2 * back, GRAVITY_M_S2 * down)


@dataclass(frozen=True, slots=True)
class Supply:
    """What feeds all servos together."""

    voltage_v: float
    resistance_ohm: float


@dataclass(frozen=True, slots=True)
class Payload:
    """A weight fixed to a body (``None``: the trunk); ``at_m`` is its centre in that frame."""

    body: str | None
    at_m: Vector
    mass_kg: float
    inertia_kg_m2: float = 0.0  #: about its own centre, the same about every axis

    @property
    def mass(self) -> MassProperties:
        """Its mass properties in the frame of the body it is fixed to."""
        own = (self.inertia_kg_m2,) * 3
        return MassProperties(self.mass_kg, self.at_m, (*own, 0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint, the servo on it, and how far it can turn.

    ``segment`` is what postures go by: ``coxa``, ``femur`` or ``tibia`` in a leg, else the joint's
    own name; ``leg`` is empty outside legs.
    """

    name: str
    leg: str
    segment: str
    servo_id: int
    direction: int
    zero_rad: float
    lower_rad: float
    upper_rad: float
    drive: DriveParameters


@dataclass(frozen=True, slots=True)
class PhysicalRobot:
    """A robot as the simulator needs it.

    ``bodies``: parents before children. ``joints`` are in the order of the servos in the robot's
    file. ``trunk`` is ``None`` for a rig, whose base is fixed. ``rest_rad`` and ``neutral_rad`` are
    joint angles by segment.
    """

    name: str
    trunk: Trunk | None
    bodies: tuple[Body, ...]
    legs: tuple[Leg, ...]
    joints: tuple[Joint, ...]
    contact: Contact
    supply: Supply
    rest_rad: Mapping[str, float]
    neutral_rad: Mapping[str, float]
    payload: Payload | None = None
    ground: Ground = field(default_factory=Ground)
    reading: Reading = field(default_factory=Reading)

    @property
    def mass_kg(self) -> float:
        """Mass of all that moves [kg]."""
        trunk = 0.0 if self.trunk is None else self.trunk_mass.mass_kg
        return trunk + sum(self.mass_of(body).mass_kg for body in self.bodies)

    @property
    def trunk_mass(self) -> MassProperties:
        """Mass properties of the trunk with what it carries; ``PhysicsError`` for a rig."""
        if self.trunk is None:
            raise PhysicsError(f"{self.name} has no trunk: its base is fixed")
        if self.payload is None or self.payload.body is not None:
            return self.trunk.mass
        return together(self.trunk.mass, self.payload.mass)

    def mass_of(self, body: Body) -> MassProperties:
        """Mass properties of a body with what it carries."""
        if self.payload is None or self.payload.body != body.name:
            return body.mass
        return together(body.mass, self.payload.mass)

    def body(self, name: str) -> Body:
        """A body by its name. Raises :class:`sim.entries.PhysicsError`."""
        for body in self.bodies:
            if body.name == name:
                return body
        known = ", ".join(body.name for body in self.bodies)
        raise PhysicsError(f"{self.name} has no body {name!r}: use one of {known}")

    def with_bodies(self, *changed: Body) -> PhysicalRobot:
        """The robot with some bodies replaced by others of the same names."""
        new = {body.name: body for body in changed}
        return replace(self, bodies=tuple(new.get(body.name, body) for body in self.bodies))

    def clamped(self, limits_rad: Mapping[str, tuple[float, float]]) -> PhysicalRobot:
        """The robot with some joints blocked at narrower limits than their own, by joint name."""
        joints = []
        for joint in self.joints:
            lower, upper = limits_rad.get(joint.name, (joint.lower_rad, joint.upper_rad))
            lower, upper = max(lower, joint.lower_rad), min(upper, joint.upper_rad)
            joints.append(replace(joint, lower_rad=lower, upper_rad=upper))
        return replace(self, joints=tuple(joints))

    def posture(self, by_segment: Mapping[str, float]) -> dict[str, float]:
        """Joint angles [rad] by joint name, with every leg alike."""
        return {joint.name: by_segment[joint.segment] for joint in self.joints}

    def height_m(self, by_segment: Mapping[str, float]) -> float:
        """Height of the trunk frame above flat ground [m], standing or lying, legs all alike."""
        if self.trunk is None:
            return 0.0
        feet = max(leg.foot.radius_m - leg.foot_m(by_segment)[2] for leg in self.legs)
        return max(feet, -self.trunk.belly_m)
