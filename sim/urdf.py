"""URDF text of a robot: one file, pure shapes, no meshes.

Joint names are those of the robot's file (``leg1.coxa``); a link is named ``<joint>.link``; the
root is ``trunk``, or ``base`` where it is fixed. Frames are those of :mod:`sim.tree`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import quoteattr

from .entries import PhysicsError
from .shapes import Array, Kind, MassProperties, Part, Shape, pitch_matrix, rpy
from .tree import Body, Joint, PhysicalRobot

FIXED = MassProperties(1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))  #: it does not move

COLOURS: dict[Part, tuple[float, float, float]] = {
    Part.TRUNK: (0.93, 0.55, 0.13),
    Part.SERVO: (0.16, 0.17, 0.20),
    Part.FRAME: (0.45, 0.62, 0.78),
    Part.FOOT: (0.80, 0.12, 0.14),
}


def urdf(robot: PhysicalRobot) -> str:
    """The whole robot as URDF text.

    Raises :class:`sim.entries.PhysicsError` for a body without mass, which the engine would take
    for one that is fixed.
    """
    joints = {joint.name: joint for joint in robot.joints}
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>"]
    for part, colour in COLOURS.items():
        rgb = " ".join(_number(channel) for channel in colour)
        lines.append(
            f'  <material name="{part.value}"><color rgba="{rgb} 1"/></material>',
        )
    if robot.trunk is None:
        root = "base"
        lines += _link(root, FIXED, ())
    else:
        root = "trunk"
        lines += _link(root, robot.trunk_mass, robot.trunk.shapes)
    for body in robot.bodies:
        parent = root if body.parent is None else f"{body.parent}.link"
        mass = robot.mass_of(body)
        if mass.mass_kg <= 0.0:
            raise PhysicsError(
                f"{robot.name}: body {body.name} has no mass: give it mass_kg, or a payload_kg"
            )
        lines += _joint(joints[body.name], body, parent)
        lines += _link(f"{body.name}.link", mass, body.shapes)
    lines.append("</robot>")
    return "\n".join(lines) + "\n"


def _joint(joint: Joint, body: Body, parent: str) -> Iterator[str]:
    origin = f'xyz="{_triple(body.at_m)}" rpy="0 0 {_number(body.yaw_rad)}"'
    yield f'  <joint name={quoteattr(joint.name)} type="revolute">'
    yield f"    <origin {origin}/>"
    yield f"    <parent link={quoteattr(parent)}/>"
    yield f"    <child link={quoteattr(f'{body.name}.link')}/>"
    yield f'    <axis xyz="{_triple(body.axis)}"/>'
    yield (
        f'    <limit lower="{_number(joint.lower_rad)}" upper="{_number(joint.upper_rad)}" '
        f'effort="{_number(10.0 * joint.drive.data_sheet.stall_torque_nm)}" '
        f'velocity="{_number(10.0 * joint.drive.data_sheet.no_load_velocity_rad_s)}"/>'
    )
    yield '    <dynamics damping="0" friction="0"/>'
    yield "  </joint>"


def _link(name: str, mass: MassProperties, shapes: Sequence[Shape]) -> Iterator[str]:
    moments, axes = mass.principal()
    ixx, iyy, izz = (_number(moment) for moment in moments)
    yield f"  <link name={quoteattr(name)}>"
    yield "    <inertial>"
    yield f'      <origin xyz="{_triple(mass.centre_m)}" rpy="{_triple(rpy(axes))}"/>'
    yield f'      <mass value="{_number(mass.mass_kg)}"/>'
    yield f'      <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>'
    yield "    </inertial>"
    for shape in shapes:
        placed = f'<origin xyz="{_triple(shape.at_m)}" '
        placed += f'rpy="{_triple(rpy(pitch_matrix(shape.pitch_rad)))}"/>'
        geometry = f"<geometry>{_geometry(shape)}</geometry>"
        yield f'    <visual>{placed}{geometry}<material name="{shape.part.value}"/></visual>'
        yield f"    <collision>{placed}{geometry}</collision>"
    yield "  </link>"


def _geometry(shape: Shape) -> str:
    if shape.kind is Kind.BOX:
        return f'<box size="{_triple(shape.size_m)}"/>'
    if shape.kind is Kind.CYLINDER:
        radius, length = (_number(size) for size in shape.size_m)
        return f'<cylinder radius="{radius}" length="{length}"/>'
    return f'<sphere radius="{_number(shape.size_m[0])}"/>'


def _number(value: float) -> str:
    if not math.isfinite(value):
        raise ValueError(f"URDF cannot hold {value}")
    return repr(float(value))


def _triple(values: Sequence[float] | Array) -> str:
    return " ".join(_number(value) for value in values)
