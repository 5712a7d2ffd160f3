"""URDF text of a robot: one file, pure shapes, no meshes.

Joint names are those of the robot's file (``leg1.coxa``); a link is named ``<joint>.link``; the
trunk is ``trunk``. Frames are those of :mod:`sim.robot`: at all angles zero, every link of a leg
has x outward, z up, and the next joint's axis at ``x = length_m``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import quoteattr

from .robot import SEGMENTS, Joint, PhysicalRobot
from .shapes import Array, Kind, Part, Shape, inertial, pitch_matrix, rpy

COLOURS: dict[Part, tuple[float, float, float]] = {
    Part.TRUNK: (0.93, 0.55, 0.13),
    Part.SERVO: (0.16, 0.17, 0.20),
    Part.FRAME: (0.45, 0.62, 0.78),
    Part.FOOT: (0.80, 0.12, 0.14),
}


def urdf(robot: PhysicalRobot) -> str:
    """The whole robot as URDF text."""
    joints = {joint.name: joint for joint in robot.joints}
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>"]
    for part, colour in COLOURS.items():
        rgb = " ".join(_number(channel) for channel in colour)
        lines.append(
            f'  <material name="{part.value}"><color rgba="{rgb} 1"/></material>',
        )
    lines += _link("trunk", robot.trunk.mass_kg, robot.trunk.shapes)
    for leg in robot.legs:
        parent, origin = "trunk", f'xyz="{_triple((leg.x_m, leg.y_m, 0.0))}" '
        origin += f'rpy="0 0 {_number(leg.yaw_rad)}"'
        for segment in SEGMENTS:
            joint = joints[f"{leg.name}.{segment}"]
            link = robot.links[segment]
            lines += _joint(joint, parent, origin)
            parent = f"{joint.name}.link"
            lines += _link(parent, link.mass_kg, link.shapes)
            origin = f'xyz="{_triple((link.length_m, 0.0, 0.0))}" rpy="0 0 0"'
    lines.append("</robot>")
    return "\n".join(lines) + "\n"


def _joint(joint: Joint, parent: str, origin: str) -> Iterator[str]:
    axis = "0 0 1" if joint.segment == "coxa" else "0 -1 0"
    yield f'  <joint name={quoteattr(joint.name)} type="revolute">'
    yield f"    <origin {origin}/>"
    yield f'    <parent link={quoteattr(parent)}/><child link="{joint.name}.link"/>'
    yield f'    <axis xyz="{axis}"/>'
    yield (
        f'    <limit lower="{_number(joint.lower_rad)}" upper="{_number(joint.upper_rad)}" '
        f'effort="{_number(10.0 * joint.drive.data_sheet.stall_torque_nm)}" '
        f'velocity="{_number(10.0 * joint.drive.data_sheet.no_load_velocity_rad_s)}"/>'
    )
    yield '    <dynamics damping="0" friction="0"/>'
    yield "  </joint>"


def _link(name: str, mass_kg: float, shapes: Sequence[Shape]) -> Iterator[str]:
    body = inertial(mass_kg, shapes)
    ixx, iyy, izz = (_number(moment) for moment in body.moments_kg_m2)
    yield f"  <link name={quoteattr(name)}>"
    yield "    <inertial>"
    yield f'      <origin xyz="{_triple(body.centre_m)}" rpy="{_triple(rpy(body.axes))}"/>'
    yield f'      <mass value="{_number(mass_kg)}"/>'
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
