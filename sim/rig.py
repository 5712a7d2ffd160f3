"""Rigs in a robot file: a tree of joints on a fixed base, ``[[body]]`` by ``[[body]]``.

A pendulum, a leg on a stand, an arm. All frames are parallel to the base's at joint angles zero,
and the base's z is up. ``[payload]`` says where a weight is fixed, ``[rest]`` how the rig lies when
it starts (``<joint>_rad``, 0 where nothing is said).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .entries import Section
from .shapes import MassProperties, Vector, read_shapes, spread
from .tree import Body, Payload

LARGEST_M = 2.0
WHOLE_TURNS_RAD = 20.0 * math.pi


@dataclass(frozen=True, slots=True)
class Rig:
    """What a rig's file says of its bodies; limits and rest by joint name."""

    bodies: tuple[Body, ...]
    payload: Payload | None
    limits_rad: Mapping[str, tuple[float, float]]
    rest_rad: Mapping[str, float]


def read_rig(top: Section) -> Rig:
    """The bodies of a rig; :class:`sim.entries.PhysicsError` for what cannot be true."""
    bodies: list[Body] = []
    limits: dict[str, tuple[float, float]] = {}
    for section in top.sections("body"):
        body = _body(section, [known.name for known in bodies])
        bodies.append(body)
        limits[body.name] = _limits(section)
    payload = _payload(top.section("payload"), limits) if "payload" in top else None
    rest = dict.fromkeys(limits, 0.0)
    if "rest" in top:
        section = top.section("rest")
        section.only(*(f"{name}_rad" for name in rest))
        for name in rest:
            rest[name] = section.number(f"{name}_rad", "rad", *limits[name], default=0.0)
    for name, (lower, upper) in limits.items():
        rest[name] = min(upper, max(lower, rest[name]))
    return Rig(tuple(bodies), payload, limits, rest)


def _body(section: Section, known: list[str]) -> Body:
    section.only(
        "name", "parent", "at_m", "axis", "mass_kg", "com_m", "inertia_kg_m2", "lower_rad",
        "upper_rad", "shape",
    )  # fmt: skip
    name = section.word("name")
    if name in known:
        raise section.fail(f"body {name} is there twice")
    parent = section.word("parent") if "parent" in section else None
    if parent is not None and parent not in known:
        raise section.fail(f"parent {parent!r} is no body above it: {', '.join(known) or 'none'}")
    axis = section.numbers("axis", "(unit vector)", 3, -1.0, 1.0)
    length = math.hypot(*axis)
    if abs(length - 1.0) > 1e-3:
        raise section.fail(f"axis = {list(axis)} has length {length:.4g}: it must be a unit vector")
    x, y, z = axis
    shapes = read_shapes(section) if "shape" in section else ()
    return Body(
        name=name,
        parent=parent,
        at_m=_place(section, "at_m"),
        yaw_rad=0.0,
        axis=(x / length, y / length, z / length),
        mass=_mass(section),
        shapes=shapes,
    )


def _mass(section: Section) -> MassProperties:
    mass = section.number("mass_kg", "kg", 0.0, 20.0)
    if "shape" in section and mass > 0.0:
        found = spread(mass, read_shapes(section))
        centre, moments = found.centre_m, found.inertia_kg_m2
    else:
        centre, moments = (0.0, 0.0, 0.0), (0.0,) * 6
        if mass > 0.0 and "com_m" not in section:
            raise section.fail("needs com_m, or [[body.shape]] to tell where its mass is")
    if "com_m" in section:
        centre = _place(section, "com_m")
    if "inertia_kg_m2" in section:
        xx, yy, zz = section.numbers("inertia_kg_m2", "kg m^2", 3, 0.0, 10.0)
        moments = (xx, yy, zz, 0.0, 0.0, 0.0)
    properties = MassProperties(mass, centre, moments)
    if problem := properties.problem():
        raise section.fail(f"inertia_kg_m2: {problem}")
    return properties


def _limits(section: Section) -> tuple[float, float]:
    lower = section.number("lower_rad", "rad", -WHOLE_TURNS_RAD, WHOLE_TURNS_RAD)
    upper = section.number("upper_rad", "rad", -WHOLE_TURNS_RAD, WHOLE_TURNS_RAD)
    if not lower < upper:
        raise section.fail(f"lower_rad = {lower} rad is not below upper_rad = {upper} rad")
    return lower, upper


def _payload(section: Section, bodies: Mapping[str, object]) -> Payload:
    section.only("body", "at_m", "mass_kg", "inertia_kg_m2")
    return Payload(
        section.word("body", tuple(bodies)),
        _place(section, "at_m"),
        section.number("mass_kg", "kg", 0.0, 20.0),
        section.number("inertia_kg_m2", "kg m^2", 0.0, 10.0, default=0.0),
    )


def _place(section: Section, key: str) -> Vector:
    x, y, z = section.numbers(key, "m", 3, -LARGEST_M, LARGEST_M)
    return x, y, z
