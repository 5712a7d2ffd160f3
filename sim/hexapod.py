"""Hexapods in a robot file: ``[trunk]``, ``[[leg]]``, ``[link]``, ``[contact]``, ``[rest]``.

All legs are alike. Leg: x outward along ``yaw_rad``, z up. Coxa turns about +z; femur and tibia
pitch, positive lifts the foot; all angles zero is a leg stretched out level. The foot is a sphere
about the tibia's tip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from .entries import Section
from .shapes import Kind, Part, Shape, Vector, read_shapes, spread
from .tree import SEGMENTS, Body, Contact, Foot, Leg, Trunk

UP: Vector = (0.0, 0.0, 1.0)
#: arm at which a foot rubs as it turns, over its radius; assumed: half of that of a foot of which
#: all touches and presses evenly
TURNING = 1.0 / 3.0
LIFTING: Vector = (0.0, -1.0, 0.0)  #: an axis about which positive lifts what points outward


@dataclass(frozen=True, slots=True)
class Link:
    """One link of every leg, as the file has it."""

    length_m: float
    mass_kg: float
    shapes: tuple[Shape, ...]
    lower_rad: float  #: geometric limits of the joint that moves it
    upper_rad: float


@dataclass(frozen=True, slots=True)
class Hexapod:
    """What a hexapod's file says of its bodies; ``limits_rad`` by joint name."""

    trunk: Trunk
    bodies: tuple[Body, ...]
    legs: tuple[Leg, ...]
    contact: Contact
    limits_rad: Mapping[str, tuple[float, float]]
    rest_rad: Mapping[str, float]
    neutral_rad: Mapping[str, float]


def read_hexapod(top: Section, trunk_load_kg: float) -> Hexapod:
    """The bodies of a hexapod; :class:`sim.entries.PhysicsError` for what cannot be true."""
    if "payload" in top:
        raise top.section("payload").fail(
            "is a rig's: a hexapod carries an effect named payload, or that of a --world"
        )
    contact, foot = _contact(top.section("contact"))
    top.section("link").only(*SEGMENTS)
    links = {name: _link(top.section("link").section(name), name) for name in SEGMENTS}
    limits = {name: (link.lower_rad, link.upper_rad) for name, link in links.items()}
    lengths = MappingProxyType({name: link.length_m for name, link in links.items()})
    legs: list[Leg] = []
    for row in top.sections("leg"):
        leg = _leg(row, lengths, foot)
        if leg.name in [known.name for known in legs]:
            raise row.fail(f"leg {leg.name} is there twice")
        legs.append(leg)
    rest = top.section("rest")
    rest.only(*(f"{segment}_rad" for segment in SEGMENTS))
    neutral = top.section("gait").section("neutral")
    return Hexapod(
        trunk=_trunk(top.section("trunk"), trunk_load_kg),
        bodies=tuple(body for leg in legs for body in _limb(leg, links)),
        legs=tuple(legs),
        contact=contact,
        limits_rad={f"{leg.name}.{name}": both for leg in legs for name, both in limits.items()},
        rest_rad={s: rest.number(f"{s}_rad", "rad", *limits[s]) for s in SEGMENTS},
        neutral_rad={s: neutral.plain(s, "rad", *limits[s]) for s in SEGMENTS},
    )


def tip_shape(foot: Foot, tibia_m: float) -> Shape:
    """The sphere of a foot at the end of a tibia of some length."""
    return Shape(Kind.SPHERE, (foot.radius_m,), (tibia_m, 0.0, 0.0), Part.FOOT)


def _limb(leg: Leg, links: Mapping[str, Link]) -> tuple[Body, ...]:
    bodies = []
    parent, at, yaw = None, (leg.x_m, leg.y_m, 0.0), leg.yaw_rad
    for segment in SEGMENTS:
        link = links[segment]
        shapes = link.shapes
        if segment == "tibia":
            shapes = (*shapes, tip_shape(leg.foot, link.length_m))
        name = f"{leg.name}.{segment}"
        axis = UP if segment == "coxa" else LIFTING
        bodies.append(Body(name, parent, at, yaw, axis, spread(link.mass_kg, shapes), shapes))
        parent, at, yaw = name, (link.length_m, 0.0, 0.0), 0.0
    return tuple(bodies)


def _trunk(section: Section, load_kg: float) -> Trunk:
    section.only("outline", "mass_kg", "battery_kg", "shape")
    mass = section.number("mass_kg", "kg", 0.001, 50.0)
    mass += section.number("battery_kg", "kg", 0.0, 20.0, default=0.0)
    shapes = read_shapes(section)
    return Trunk(spread(mass + load_kg, shapes), shapes)


def _contact(section: Section) -> tuple[Contact, Foot]:
    section.only("foot_radius_m", "foot_turning_m", "friction", "restitution")
    friction = section.number("friction", "(ratio)", 0.0, 3.0)
    radius = section.number("foot_radius_m", "m", 0.001, 0.1)
    restitution = section.number("restitution", "(ratio)", 0.0, 1.0)
    turning = section.number("foot_turning_m", "m", 0.0, 0.1, default=TURNING * radius)
    return Contact(friction, restitution), Foot(radius, friction, turning_m=turning)


def _leg(section: Section, lengths_m: Mapping[str, float], foot: Foot) -> Leg:
    section.only("name", "x_m", "y_m", "yaw_rad")
    return Leg(
        section.word("name"),
        section.plain("x_m", "m", -2.0, 2.0),
        section.plain("y_m", "m", -2.0, 2.0),
        section.plain("yaw_rad", "rad", -2.0 * math.pi, 2.0 * math.pi),
        lengths_m,
        foot,
    )


def _link(section: Section, name: str) -> Link:
    section.only("length_m", "twist_rad", "mass_kg", "lower_rad", "upper_rad", "shape")
    twist = section.number("twist_rad", "rad", -math.pi, math.pi, default=0.0)
    wanted = math.pi / 2.0 if name == "coxa" else 0.0
    if abs(twist - wanted) > 1e-3:
        raise section.fail(f"twist_rad = {twist}: only yaw-pitch-pitch legs are known ({wanted})")
    lower = section.number("lower_rad", "rad", -math.pi, 0.0)
    upper = section.number("upper_rad", "rad", 0.0, math.pi)
    if not lower < upper:
        raise section.fail(f"lower_rad = {lower} rad is not below upper_rad = {upper} rad")
    return Link(
        section.number("length_m", "m", 0.001, 2.0),
        section.number("mass_kg", "kg", 1e-4, 20.0),
        read_shapes(section),
        lower,
        upper,
    )
