"""The robot's file, its shapes and the URDF made of it."""

from __future__ import annotations

import contextlib
import math
import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest
from sim_rigs import changed

from busemu.tables import Robot, RobotError, load_robot
from sim.robot import read_physics
from sim.shapes import Kind, Part, Shape, pitch_matrix, rpy, spread
from sim.stability import LARGEST
from sim.urdf import urdf
from sim.world import BulletPlant

ASSUMED = "assumed"


def value(number: Any) -> dict[str, Any]:
    return {"value": number, "source": ASSUMED}


def test_urdf_masses_sum_to_those_of_the_file(robot: Robot) -> None:
    root = ET.fromstring(urdf(read_physics(robot)))
    total = sum(float(mass.get("value", "nan")) for mass in root.iter("mass"))
    document = robot.document
    legs = sum(document["link"][s]["mass_kg"]["value"] for s in ("coxa", "femur", "tibia"))
    trunk = document["trunk"]["mass_kg"]["value"] + document["trunk"]["battery_kg"]["value"]
    assert total == pytest.approx(trunk + 6 * legs, rel=1e-12)


def test_a_trunk_load_adds_its_mass(robot: Robot) -> None:
    bare, loaded = read_physics(robot), read_physics(robot, trunk_load_kg=0.33)
    assert loaded.mass_kg - bare.mass_kg == pytest.approx(0.33)


def test_urdf_has_a_joint_for_every_servo_and_no_mesh(robot: Robot) -> None:
    root = ET.fromstring(urdf(read_physics(robot)))
    assert {j.get("name") for j in root.iter("joint")} == {s.joint for s in robot.servos}
    assert not list(root.iter("mesh"))


def test_joint_limits_stay_within_the_servos_300_degrees(robot: Robot) -> None:
    for joint, mount in zip(read_physics(robot).joints, robot.servos, strict=True):
        for end in (joint.lower_rad, joint.upper_rad):
            assert abs(mount.to_servo(end)) <= math.radians(150.0) + 1e-9


def test_marvins_femur_limit_comes_from_the_servo() -> None:
    femur = read_physics(load_robot("marvin")).joints[1]
    assert femur.lower_rad == pytest.approx(math.pi / 2 - math.radians(150.0), abs=1e-5)


def test_inertia_of_a_rod_of_two_boxes_is_that_of_one() -> None:
    whole = Shape(Kind.BOX, (0.2, 0.01, 0.02), (0.1, 0.0, 0.0), Part.FRAME)
    halves = [Shape(Kind.BOX, (0.1, 0.01, 0.02), (x, 0.0, 0.0), Part.FRAME) for x in (0.05, 0.15)]
    one, two = spread(0.5, [whole]), spread(0.5, halves)
    assert two.centre_m == pytest.approx(one.centre_m)
    assert two.inertia_kg_m2 == pytest.approx(one.inertia_kg_m2)
    assert one.inertia_kg_m2[2] == pytest.approx(0.5 * (0.2**2 + 0.01**2) / 12)


def test_principal_axes_rebuild_the_inertia_tensor() -> None:
    shapes = [
        Shape(Kind.CYLINDER, (0.01, 0.1), (0.05, 0.0, 0.02), Part.FRAME, pitch_rad=0.4),
        Shape(Kind.SPHERE, (0.02,), (0.1, 0.03, 0.0), Part.FOOT),
    ]
    body = spread(0.2, shapes)
    masses = 0.2 * np.array([s.volume_m3 for s in shapes]) / sum(s.volume_m3 for s in shapes)
    tensor = np.zeros((3, 3))
    for mass, shape in zip(masses, shapes, strict=True):
        arm = np.array(shape.at_m) - np.array(body.centre_m)
        tensor += mass * (shape.unit_inertia_m2() + arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments, axes = body.principal()
    rebuilt = axes @ np.diag(moments) @ axes.T
    assert rebuilt == pytest.approx(tensor, abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("pitch", [0.0, 0.7, -1.2, math.pi / 2, -math.pi / 2])
def test_rpy_rebuilds_its_rotation(pitch: float) -> None:
    wanted = pitch_matrix(pitch)
    roll, turn, yaw = rpy(wanted)
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(turn), math.sin(turn)
    cy, sy = math.cos(yaw), math.sin(yaw)
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    assert z @ y @ x == pytest.approx(wanted, abs=1e-12)


def test_the_lowest_point_of_a_turned_shape_is_found() -> None:
    box = Shape(Kind.BOX, (0.2, 0.1, 0.02), (0.0, 0.0, 0.1), Part.FRAME, pitch_rad=math.pi / 2)
    assert box.lowest_m == pytest.approx(0.0)


INSANE = {
    "no mass": (("link", "femur", "mass_kg"), None, "mass_kg"),
    "negative mass": (("link", "femur", "mass_kg"), value(-0.008), "-0.008 kg"),
    "no source": (("link", "femur", "mass_kg"), {"value": 0.008}, "source"),
    "empty source": (("link", "femur", "mass_kg"), {"value": 0.008, "source": " "}, "source"),
    "bare number": (("link", "femur", "mass_kg"), 0.008, "source"),
    "millimetres": (("link", "femur", "length_m"), value(60.0), "0.001 to 2.0 m"),
    "text": (("link", "femur", "length_m"), value("long"), "number in m"),
    "not a number": (("supply", "voltage_v"), value(math.nan), "nan V"),
    "wrong kinematics": (("link", "femur", "twist_rad"), value(1.0), "yaw-pitch-pitch"),
    "no rest": (("rest",), None, "[rest]"),
    "no shapes": (("link", "tibia", "shape"), [], "[[link.tibia.shape]]"),
    "unknown shape": (("link", "tibia", "shape", 0, "kind"), "mesh", "box, cylinder, sphere"),
    "misspelt key": (("contact", "frction"), value(1.0), "frction"),
    "misspelt friction": (
        ("drive", "XL-320", "coulom_nm"),
        value(0.02),
        "[drive.XL-320] unknown key coulom_nm (did you mean coulomb_nm?)",
    ),
    "misspelt supply": (("supply", "voltag_v"), value(7.4), "[supply] unknown key voltag_v"),
    "misspelt trunk": (("trunk", "mas_kg"), value(0.3), "[trunk] unknown key mas_kg"),
    "misspelt link": (("link", "tibia", "mas_kg"), value(0.3), "[link.tibia] unknown key mas_kg"),
    "a fourth link": (("link", "tarsus"), {}, "[link] unknown key tarsus"),
    "misspelt leg": (("leg", 0, "yaw"), 2.0, "[leg][0] unknown key yaw"),
    "misspelt rest": (("rest", "coxa"), value(0.1), "[rest] unknown key coxa"),
    "misspelt section": (("contacts",), {}, "unknown key contacts (did you mean contact?)"),
    "a rig's payload": (("payload",), {}, "[payload] is a rig's"),
    "a leg twice": (("leg", 1, "name"), "leg1", "[leg][1] leg leg1 is there twice"),
    "no drive": (("drive", "XL-320"), None, "[drive.XL-320]"),
    "stall below no load": (("drive", "XL-320", "stall_current_a"), value(0.1), "0.1 A"),
    "friction beyond no-load current": (("drive", "XL-320", "coulomb_nm"), value(0.2), "coulomb"),
    "fit far from the data sheet": (
        ("drive", "XL-320", "resistance_ohm"),
        value(35.6),
        "data sheet",
    ),
}


@pytest.mark.parametrize("case", INSANE, ids=str)
def test_insane_parameters_are_refused_with_one_line(case: str) -> None:
    keys, to, says = INSANE[case]
    with pytest.raises(RobotError) as caught:
        read_physics(changed(load_robot("marvin"), *keys, to=to))
    message = str(caught.value)
    assert says in message
    assert "marvin.toml" in message
    assert "\n" not in message


def test_a_servo_at_a_joint_no_leg_has_is_refused() -> None:
    with pytest.raises(RobotError, match=r"leg1\.coxa has no servo"):
        read_physics(changed(load_robot("marvin"), "servo", 0, "joint", to="leg7.coxa"))


def test_a_gear_too_stiff_for_the_step_is_refused() -> None:
    stiff = changed(
        load_robot("marvin"), "drive", "XL-320", "gear_stiffness_nm_rad", to=value(60.0)
    )
    says = r"tibia: gear_stiffness_nm_rad = 60 N m/rad \(at most ([0-9.]+) beside"
    with pytest.raises(RobotError, match=says) as refused:
        BulletPlant(stiff)
    BulletPlant(stiff, steps_per_tick=4).close()
    found = re.search(says, str(refused.value))
    assert found is not None
    most = 0.999 * float(found[1])
    soft = changed(stiff, "drive", "XL-320", "gear_stiffness_nm_rad", to=value(most))
    with contextlib.closing(BulletPlant(soft)) as plant:
        assert plant.stiffness_number > 0.98 * LARGEST


def test_a_gear_damped_too_much_for_the_step_is_refused_with_what_it_bears() -> None:
    damped = changed(
        load_robot("marvin"), "drive", "XL-320", "gear_damping_nm_s_rad", to=value(5.0)
    )
    with pytest.raises(RobotError, match=r"gear_damping_nm_s_rad = 5 N m s/rad \(at most 0\.00"):
        BulletPlant(damped)


def test_the_robots_as_shipped_keep_the_stability_margin(robot: Robot) -> None:
    plant = BulletPlant(robot)
    assert 0.1 < plant.stiffness_number <= LARGEST
    plant.close()
