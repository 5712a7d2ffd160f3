"""Pure shapes: boxes, cylinders and spheres, from which every link is made.

As in the thesis (Nguyenova, 2019), a link is a compound of pure shapes, its mass is spread evenly
over their volume, and its inertia follows from them. Overlaps count twice, so shapes of a link
should touch rather than overlap.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .entries import Section

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Moments = tuple[float, float, float, float, float, float]


class Kind(enum.Enum):
    """The pure shapes, and the meaning of their ``size_m``."""

    BOX = "box"  #: full lengths along x, y, z
    CYLINDER = "cylinder"  #: radius, length along z
    SPHERE = "sphere"  #: radius

    @property
    def sizes(self) -> int:
        """How many lengths the shape has."""
        return {Kind.BOX: 3, Kind.CYLINDER: 2, Kind.SPHERE: 1}[self]


class Part(enum.Enum):
    """What a shape stands for; decides its colour in pictures and nothing else."""

    TRUNK = "trunk"
    SERVO = "servo"
    FRAME = "frame"
    FOOT = "foot"


@dataclass(frozen=True, slots=True)
class Shape:
    """One pure shape in the frame of its link.

    ``at_m`` is its centre; ``pitch_rad`` turns it about the link's -y axis, so that positive lifts
    its x axis, like a femur or tibia joint.
    """

    kind: Kind
    size_m: tuple[float, ...]
    at_m: tuple[float, float, float]
    part: Part
    pitch_rad: float = 0.0

    @property
    def volume_m3(self) -> float:
        """Volume [m^3]."""
        s = self.size_m
        if self.kind is Kind.BOX:
            return s[0] * s[1] * s[2]
        if self.kind is Kind.CYLINDER:
            return math.pi * s[0] ** 2 * s[1]
        return 4.0 / 3.0 * math.pi * s[0] ** 3

    @property
    def lowest_m(self) -> float:
        """Height of its lowest point in the link's frame [m]."""
        s, sin, cos = self.size_m, abs(math.sin(self.pitch_rad)), abs(math.cos(self.pitch_rad))
        if self.kind is Kind.BOX:
            reach = 0.5 * (s[0] * sin + s[2] * cos)
        elif self.kind is Kind.CYLINDER:
            reach = 0.5 * s[1] * cos + s[0] * sin
        else:
            reach = s[0]
        return self.at_m[2] - reach

    def unit_inertia_m2(self) -> Array:
        """Inertia about its own centre for a mass of 1 kg, in the link's axes: shape (3, 3)."""
        s = self.size_m
        if self.kind is Kind.BOX:
            x, y, z = s[0] ** 2, s[1] ** 2, s[2] ** 2
            diagonal = [(y + z) / 12.0, (x + z) / 12.0, (x + y) / 12.0]
        elif self.kind is Kind.CYLINDER:
            across = s[0] ** 2 / 4.0 + s[1] ** 2 / 12.0
            diagonal = [across, across, s[0] ** 2 / 2.0]
        else:
            diagonal = [0.4 * s[0] ** 2] * 3
        turn = pitch_matrix(self.pitch_rad)
        return np.asarray(turn @ np.diag(diagonal) @ turn.T)


@dataclass(frozen=True, slots=True)
class MassProperties:
    """Mass, centre of mass and inertia about it, all in the frame of a body.

    ``inertia_kg_m2`` is the tensor's xx, yy, zz, xy, xz, yz.
    """

    mass_kg: float
    centre_m: Vector
    inertia_kg_m2: Moments

    @property
    def tensor_kg_m2(self) -> Array:
        """Inertia about the centre of mass: shape (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.inertia_kg_m2
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def principal(self) -> tuple[Array, Array]:
        """Principal moments [kg m^2], and their axes as the columns of a right-handed rotation."""
        tensor = self.tensor_kg_m2
        if np.allclose(tensor, np.diag(np.diag(tensor)), rtol=0.0, atol=1e-9 * np.trace(tensor)):
            return np.diag(tensor).copy(), np.eye(3)
        moments, axes = np.linalg.eigh(tensor)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] = -axes[:, 0]
        return moments, axes

    def problem(self) -> str | None:
        """What is wrong with it, or ``None``: two moments must sum to the third or more."""
        if self.mass_kg == 0.0:
            return None if not any(self.inertia_kg_m2) else "an inertia without a mass"
        a, b, c = np.sort(self.principal()[0]).tolist()
        if a < 0.0 or a + b < c * (1.0 - 1e-6):
            return (
                f"principal moments {a:.4g}, {b:.4g} and {c:.4g} kg m^2 belong to no rigid body: "
                "none may be negative, or more than the sum of the other two"
            )
        return None


def pitch_matrix(pitch_rad: float) -> Array:
    """Rotation about -y: positive lifts the x axis. Shape (3, 3)."""
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def spread(mass_kg: float, shapes: Sequence[Shape]) -> MassProperties:
    """Spread a mass evenly over the volume of a compound."""
    volumes = np.array([shape.volume_m3 for shape in shapes])
    masses = mass_kg * volumes / volumes.sum()
    at = np.array([shape.at_m for shape in shapes])
    centre = masses @ at / mass_kg
    tensor = np.zeros((3, 3))
    for mass, shape, arm in zip(masses, shapes, at - centre, strict=True):
        tensor += mass * (shape.unit_inertia_m2() + arm @ arm * np.eye(3) - np.outer(arm, arm))
    return _properties(mass_kg, centre, tensor)


def together(*parts: MassProperties) -> MassProperties:
    """Several bodies of one frame as one; parts without mass count for nothing."""
    heavy = [part for part in parts if part.mass_kg > 0.0]
    if len(heavy) < 2:
        return heavy[0] if heavy else parts[0]
    mass = sum(part.mass_kg for part in heavy)
    at = [np.array(part.centre_m) for part in heavy]
    centre = sum((p.mass_kg * c for p, c in zip(heavy, at, strict=True)), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for part, place in zip(heavy, at, strict=True):
        arm = place - centre
        tensor += part.tensor_kg_m2
        tensor += part.mass_kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return _properties(mass, centre, tensor)


def _properties(mass_kg: float, centre: Array, tensor: Array) -> MassProperties:
    x, y, z = centre.tolist()
    xx, yy, zz = np.diag(tensor).tolist()
    off = (float(tensor[0, 1]), float(tensor[0, 2]), float(tensor[1, 2]))
    return MassProperties(mass_kg, (x, y, z), (xx, yy, zz, *off))


def rpy(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] of a rotation matrix in URDF's convention (fixed axes x, y, z)."""
    pitch = math.asin(max(-1.0, min(1.0, -float(rotation[2, 0]))))
    if abs(rotation[2, 0]) > 1.0 - 1e-12:  # roll and yaw turn about the same axis: use yaw alone
        return 0.0, pitch, math.atan2(-float(rotation[0, 1]), float(rotation[1, 1]))
    roll = math.atan2(float(rotation[2, 1]), float(rotation[2, 2]))
    yaw = math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
    return roll, pitch, yaw


def read_shapes(section: Section) -> tuple[Shape, ...]:
    """The ``[[shape]]`` entries of a section; at least one must be there."""
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
