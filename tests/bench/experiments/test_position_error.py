"""Torque from position error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.experiments.motion import moving
from bench.experiments.position_error import TorqueSensor, last_way
from bench.running import in_process
from busemu.tables import load_robot
from busemu.timing import load_profile
from sim.world import BulletPlant

GRAVITY_M_S2 = 9.81
BOTH = pytest.mark.parametrize("name", ["marvin", "phantomx"])


def sensor_of(name, joint):
    robot = load_robot(name)
    mount = robot.by_joint[joint]
    return TorqueSensor.of(robot, mount, mount.registers)


@BOTH
def test_full_duty_begins_at_the_error_that_the_registers_give(name):
    sensor = sensor_of(name, "leg1.femur")
    counts = math.ceil(sensor.full_error_rad / sensor.count_rad)
    errors = np.array([counts, counts - 2, -counts, 0]) * sensor.count_rad
    full, below, negative, none = sensor.duty(errors)
    assert full == pytest.approx(1.0, abs=1e-3)  # 1023 of 1023, in hundredths of a percent
    assert 0.9 < below < full
    assert negative == pytest.approx(-full)
    assert none == 0.0


@pytest.mark.parametrize("joint", ["leg1.femur", "leg6.femur"])
def test_torque_pulls_towards_the_goal_however_the_servo_is_mounted(joint):
    sensor = sensor_of("phantomx", joint)
    errors = np.array([0.1, -0.1, np.nan])
    torques = sensor.torque_nm(errors, 11.1)
    assert torques[0] > 0.0 > torques[1]
    assert math.isnan(torques[2])


@BOTH
def test_torque_at_full_duty_is_the_stall_torque_at_the_voltage(name):
    sensor = sensor_of(name, "leg1.coxa")
    rated = sensor.drive.data_sheet.voltage_v
    far = np.array([2.0 * sensor.full_error_rad])
    assert sensor.torque_nm(far, rated)[0] == pytest.approx(sensor.stall_nm, rel=2e-3)
    assert sensor.torque_nm(far, 0.8 * rated)[0] < 0.85 * sensor.stall_nm
    no_load = sensor.drive.data_sheet.no_load_velocity_rad_s
    assert sensor.torque_nm(far, rated, no_load)[0] == pytest.approx(0.0, abs=1e-3)


def test_registers_change_the_law():
    robot = load_robot("marvin")
    mount = robot.by_joint["leg1.coxa"]
    error = np.array([0.05])
    stiff = TorqueSensor.of(robot, mount, {"p_gain": 64, "punch": 0}).duty(error)
    soft = TorqueSensor.of(robot, mount, {"p_gain": 32, "punch": 0}).duty(error)
    assert stiff[0] == pytest.approx(2.0 * soft[0])


def test_the_last_way_changes_only_after_a_turn_that_is_deep_enough():
    positions = np.array([0.0, 0.5, 1.0, 2.0, 1.5, 2.5, 1.0, 0.0, 0.5, 2.0])
    expected = [0, 0, 1, 1, 1, 1, -1, -1, -1, 1]
    assert last_way(positions, 1.0).tolist() == expected
    assert last_way(np.empty(0), 1.0).size == 0


def centre_of_mass_m(robot, link):
    """x and z of a link's centre of mass, its mass spread evenly over the shapes of the file."""
    document = robot.document
    weights, places = [], []
    for shape in document["link"][link]["shape"]:
        size = shape["size_m"]["value"]
        assert shape["kind"] == "box"
        weights.append(math.prod(size))
        places.append((shape["at_m"]["value"][0], shape["at_m"]["value"][2]))
    if link == "tibia":
        weights.append(4.0 / 3.0 * math.pi * document["contact"]["foot_radius_m"]["value"] ** 3)
        places.append((document["link"]["tibia"]["length_m"]["value"], 0.0))
    return np.average(places, axis=0, weights=weights)


def gravity_nm(robot, femur_rad, tibia_rad):
    """Torque that holds a leg up at its femur: the weights of femur and tibia on their arms."""
    links = robot.document["link"]
    knee_m = links["femur"]["length_m"]["value"] * math.cos(femur_rad)
    total = 0.0
    for link, from_m, pitch in (
        ("femur", 0.0, femur_rad),
        ("tibia", knee_m, femur_rad + tibia_rad),
    ):
        x, z = centre_of_mass_m(robot, link)
        arm_m = from_m + x * math.cos(pitch) - z * math.sin(pitch)
        total += GRAVITY_M_S2 * links[link]["mass_kg"]["value"] * arm_m
    return total


@BOTH
def test_static_torque_is_m_g_l_within_the_resolution(name):
    """A leg stretched out level, come to from above and from below: friction cancels."""
    robot = load_robot(name)
    voltage_v = robot.document["supply"]["voltage_v"]["value"]
    plant = BulletPlant(robot, held=True)
    sensor = sensor_of(name, "leg6.femur")
    torques, expected, true = [], [], []
    try:
        session = in_process(robot, plant, load_profile(robot.timing))
        with moving(session, ["leg6.femur", "leg6.tibia"], lambda _: None) as motion:
            for start in (0.4, -0.4):
                motion.go({"leg6.femur": start, "leg6.tibia": 0.0}, 1.5)
                motion.go({"leg6.femur": 0.0}, 2.0, smooth=False)
                motion.hold(1.0)
                femur, tibia = motion.cycle({})
                torques.append(sensor.torque_nm(np.array([-femur]), voltage_v)[0])
                expected.append(gravity_nm(robot, femur, tibia))
                true.append(plant.observe()["rig/leg6.femur_nm"])
    finally:
        plant.close()
    resolution = sensor.slope_nm_rad(voltage_v) * sensor.count_rad
    assert true == pytest.approx(expected, rel=0.02)
    assert min(expected) > 1.5 * resolution  # else this would say nothing
    assert np.mean(torques) == pytest.approx(np.mean(expected), abs=resolution)
