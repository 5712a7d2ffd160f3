"""The physical part of a robot file: trunk, legs, links, contact, drives.

Frames. Trunk: x to the right, y forward, z up, origin at the height of the coxa axes. Leg: x
outward along ``yaw_rad``, z up. Coxa turns about +z; femur and tibia pitch, positive lifts the
foot; all angles zero is a leg stretched out level. The foot is a sphere about the tibia's tip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from busemu.tables import Robot

from .drive.parameters import DriveParameters, read_drive
from .entries import PhysicsError, Section
from .reading import Reading
from .shapes import Kind, Part, Shape

SEGMENTS = ("coxa", "femur", "tibia")
SERVO_RANGE_RAD = math.radians(
    150.0
)  #: either side of the centre; source: e-manual, AX-12A, XL-320


@dataclass(frozen=True, slots=True)
class Link:
    """One link of a leg; all legs are alike."""

    name: str
    length_m: float
    mass_kg: float
    shapes: tuple[Shape, ...]
    lower_rad: float  #: geometric limits of the joint that moves it
    upper_rad: float


@dataclass(frozen=True, slots=True)
class Leg:
    """Where a leg sits on the trunk (trunk frame)."""

    name: str
    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Trunk:
    """The body; ``mass_kg`` includes the battery and any extra load."""

    mass_kg: float
    shapes: tuple[Shape, ...]

    @property
    def belly_m(self) -> float:
        """Height of its lowest point in the trunk frame [m], negative."""
        return min(shape.lowest_m for shape in self.shapes)


@dataclass(frozen=True, slots=True)
class Contact:
    """Feet and ground."""

    foot_radius_m: float
    friction: float
    restitution: float


@dataclass(frozen=True, slots=True)
class Supply:
    """What feeds all servos together."""

    voltage_v: float
    resistance_ohm: float


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint, the servo on it, and how far it can turn."""

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

    ``joints`` are in the order of the servos in the robot's file; ``rest_rad`` and ``neutral_rad``
    are joint angles by segment.
    """

    name: str
    trunk: Trunk
    legs: tuple[Leg, ...]
    links: Mapping[str, Link]
    joints: tuple[Joint, ...]
    contact: Contact
    supply: Supply
    rest_rad: Mapping[str, float]
    neutral_rad: Mapping[str, float]
    reading: Reading = field(default_factory=Reading)

    @property
    def mass_kg(self) -> float:
        """Mass of the whole robot [kg]."""
        return self.trunk.mass_kg + len(self.legs) * sum(k.mass_kg for k in self.links.values())

    def posture(self, by_segment: Mapping[str, float]) -> dict[str, float]:
        """Joint angles [rad] by joint name, with every leg alike."""
        return {joint.name: by_segment[joint.segment] for joint in self.joints}

    def foot_m(self, by_segment: Mapping[str, float]) -> tuple[float, float, float]:
        """Centre of the foot in the leg's frame [m]: outward, sideways (left), up."""
        coxa, femur, tibia = (self.links[segment].length_m for segment in SEGMENTS)
        lift = by_segment["femur"]
        shank = lift + by_segment["tibia"]
        reach = coxa + femur * math.cos(lift) + tibia * math.cos(shank)
        turn = by_segment["coxa"]
        up = femur * math.sin(lift) + tibia * math.sin(shank)
        return reach * math.cos(turn), reach * math.sin(turn), up

    def height_m(self, by_segment: Mapping[str, float]) -> float:
        """Height of the trunk frame above flat ground [m], standing or lying, legs all alike."""
        feet = self.contact.foot_radius_m - self.foot_m(by_segment)[2]
        return max(feet, -self.trunk.belly_m)


def read_physics(robot: Robot, *, trunk_load_kg: float = 0.0) -> PhysicalRobot:
    """The physical part of a robot file.

    ``trunk_load_kg`` is added to the trunk, spread evenly (the thesis's torque experiment). Raises
    :class:`PhysicsError` with one line when anything is missing or cannot be true.
    """
    if not 0.0 <= trunk_load_kg <= 20.0:
        raise PhysicsError(f"trunk_load_kg = {trunk_load_kg} kg is not within 0 to 20 kg")
    top = Section(robot.path, "", robot.document)
    contact = _contact(top.section("contact"))
    links = {name: _link(top.section("link").section(name), name) for name in SEGMENTS}
    tip = Shape(Kind.SPHERE, (contact.foot_radius_m,), (links["tibia"].length_m, 0, 0), Part.FOOT)
    tibia = links["tibia"]
    links["tibia"] = Link(
        "tibia",
        tibia.length_m,
        tibia.mass_kg,
        (*tibia.shapes, tip),
        tibia.lower_rad,
        tibia.upper_rad,
    )
    legs = tuple(_leg(row) for row in top.sections("leg"))
    supply = top.section("supply")
    rest = top.section("rest")
    neutral = top.section("gait").section("neutral")
    return PhysicalRobot(
        name=robot.name,
        trunk=_trunk(top.section("trunk"), trunk_load_kg),
        legs=legs,
        links=MappingProxyType(links),
        joints=_joints(robot, legs, links),
        contact=contact,
        supply=Supply(
            supply.number("voltage_v", "V", 1.0, 50.0),
            supply.number("resistance_ohm", "ohm", 0.0, 5.0),
        ),
        rest_rad={s: rest.number(f"{s}_rad", "rad", -math.pi, math.pi) for s in SEGMENTS},
        neutral_rad={s: neutral.plain(s, "rad", -math.pi, math.pi) for s in SEGMENTS},
    )


def _trunk(section: Section, load_kg: float) -> Trunk:
    mass = section.number("mass_kg", "kg", 0.001, 50.0)
    mass += section.number("battery_kg", "kg", 0.0, 20.0, default=0.0)
    return Trunk(mass + load_kg, _shapes(section))


def _contact(section: Section) -> Contact:
    section.only("foot_radius_m", "friction", "restitution")
    return Contact(
        foot_radius_m=section.number("foot_radius_m", "m", 0.001, 0.1),
        friction=section.number("friction", "(ratio)", 0.0, 3.0),
        restitution=section.number("restitution", "(ratio)", 0.0, 1.0),
    )


def _leg(section: Section) -> Leg:
    return Leg(
        section.word("name"),
        section.plain("x_m", "m", -2.0, 2.0),
        section.plain("y_m", "m", -2.0, 2.0),
        section.plain("yaw_rad", "rad", -2.0 * math.pi, 2.0 * math.pi),
    )


def _link(section: Section, name: str) -> Link:
    twist = section.number("twist_rad", "rad", -math.pi, math.pi, default=0.0)
    wanted = math.pi / 2.0 if name == "coxa" else 0.0
    if abs(twist - wanted) > 1e-3:
        raise section.fail(f"twist_rad = {twist}: only yaw-pitch-pitch legs are known ({wanted})")
    lower = section.number("lower_rad", "rad", -math.pi, 0.0)
    upper = section.number("upper_rad", "rad", 0.0, math.pi)
    if not lower < upper:
        raise section.fail(f"lower_rad = {lower} is not below upper_rad = {upper}")
    return Link(
        name,
        section.number("length_m", "m", 0.001, 2.0),
        section.number("mass_kg", "kg", 1e-4, 20.0),
        _shapes(section),
        lower,
        upper,
    )


def _shapes(section: Section) -> tuple[Shape, ...]:
    return tuple(_shape(row) for row in section.sections("shape"))


def _shape(section: Section) -> Shape:
    section.only("kind", "part", "size_m", "at_m", "pitch_rad")
    kind = Kind(section.word("kind", tuple(k.value for k in Kind)))
    x, y, z = section.numbers("at_m", "m", 3, -2.0, 2.0)
    return Shape(
        kind=kind,
        size_m=section.numbers("size_m", "m", kind.sizes, 1e-4, 2.0),
        at_m=(x, y, z),
        part=Part(section.word("part", tuple(p.value for p in Part))),
        pitch_rad=section.number("pitch_rad", "rad", -math.pi, math.pi, default=0.0),
    )


def _joints(robot: Robot, legs: tuple[Leg, ...], links: Mapping[str, Link]) -> tuple[Joint, ...]:
    drives = Section(robot.path, "", robot.document).section("drive")
    wanted = {f"{leg.name}.{segment}" for leg in legs for segment in SEGMENTS}
    missing = sorted(wanted - set(robot.by_joint))
    foreign = sorted(set(robot.by_joint) - wanted)
    if missing or foreign:
        what = f"joint {missing[0]} has no servo" if missing else f"no leg has {foreign[0]}"
        raise PhysicsError(f"{robot.path}: [[servo]] {what}: each joint of each leg needs one")
    models = {mount.model for mount in robot.servos}
    known = {model: read_drive(drives.section(model)) for model in sorted(models)}
    joints = []
    for mount in robot.servos:
        leg, segment = mount.joint.split(".")
        ends = sorted(mount.to_joint(side * SERVO_RANGE_RAD) for side in (-1.0, 1.0))
        lower = max(ends[0], links[segment].lower_rad)
        upper = min(ends[1], links[segment].upper_rad)
        if not lower < upper:
            raise PhysicsError(
                f"{robot.path}: [[servo]] id {mount.servo_id}: zero_rad = {mount.zero_rad} rad "
                f"leaves {mount.joint} no range within {ends[0]:.3f} to {ends[1]:.3f} rad"
            )
        joints.append(
            Joint(
                mount.joint,
                leg,
                segment,
                mount.servo_id,
                mount.direction,
                mount.zero_rad,
                lower,
                upper,
                known[mount.model],
            )
        )
    return tuple(joints)
