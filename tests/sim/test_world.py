"""Robots in the physics engine: geometry, forces, energy, stability."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pybullet
import pytest
from sim_rigs import LAWS, changed, hold, stand

from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from sim.drive import fields
from sim.robot import SEGMENTS, read_physics
from sim.tree import GRAVITY_M_S2
from sim.world import BulletPlant, World

Make = Callable[..., BulletPlant]
LEVEL = (0.0, 0.0, 0.0, 1.0)


def dh(theta: float, a: float, alpha: float) -> np.ndarray:
    """One Denavit-Hartenberg step, d = 0, as in the thesis's table."""
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def test_feet_are_where_the_denavit_hartenberg_table_puts_them(robot: Robot) -> None:
    physical = read_physics(robot)
    world = World(physical, step_s=0.001, held=True)
    rng = np.random.default_rng(11)
    for _ in range(20):
        angles = {j.name: float(rng.uniform(j.lower_rad, j.upper_rad)) for j in physical.joints}
        base = (0.1, -0.2, 0.7)
        world.place(base, LEVEL, angles)
        feet = world.feet()
        for leg in robot.document["leg"]:
            frame = dh(leg["yaw_rad"], 0.0, 0.0)
            frame[:3, 3] = np.array([leg["x_m"], leg["y_m"], 0.0]) + base
            for segment in SEGMENTS:
                link = robot.document["link"][segment]
                alpha = link.get("twist_rad", {"value": 0.0})["value"]
                angle = angles[f"{leg['name']}.{segment}"]
                frame = frame @ dh(angle, link["length_m"]["value"], alpha)
            assert feet[leg["name"]] == pytest.approx(frame[:3, 3], abs=2e-6)
    world.close()


def test_the_plant_measures_angles_in_the_servos_frame(robot: Robot, make: Make) -> None:
    plant = make(robot)
    for servo in robot.servos:
        joint = plant.robot.rest_rad[servo.joint.split(".")[1]]
        assert plant.sample(servo.servo_id).position_rad == pytest.approx(servo.to_servo(joint))


def test_a_free_body_answers_an_impulse_by_its_inverse_mass(robot: Robot) -> None:
    world = World(read_physics(robot), step_s=1e-4)
    joints = read_physics(robot).joints
    rng = np.random.default_rng(3)
    pose = {j.name: float(rng.uniform(-0.2, 0.2)) for j in joints}
    velocity, twice, position = np.zeros(18), np.zeros(18), np.zeros(18)
    for i in (0, 7, 17):
        for sign, into in ((1.0, velocity), (-1.0, twice)):
            world.place((0.0, 0.0, 1.0), LEVEL, pose)
            torque = np.zeros(18)
            torque[i] = sign * 1e-3
            world.step(torque)
            world.read(position, into)
        world.place((0.0, 0.0, 1.0), LEVEL, pose)
        wanted = world.inverse_mass()[:, i] * 1e-3 * 1e-4
        assert 0.5 * (velocity - twice) == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())
    world.close()


def test_the_engine_takes_the_inertia_of_the_shapes(robot: Robot) -> None:
    physical = read_physics(robot)
    world = World(physical, step_s=0.001, held=True)
    mass = np.linalg.inv(world.inverse_mass())
    tibia = physical.body("leg1.tibia").mass
    about_centre = tibia.inertia_kg_m2[1]
    arm = math.hypot(tibia.centre_m[0], tibia.centre_m[2])
    for i, joint in enumerate(physical.joints):
        if joint.segment == "tibia":
            assert mass[i, i] == pytest.approx(about_centre + tibia.mass_kg * arm**2, rel=1e-6)
    world.close()


def test_a_robot_in_the_air_falls_freely(robot: Robot) -> None:
    physical = read_physics(robot)
    world = World(physical, step_s=0.001)
    world.place((0.0, 0.0, 2.0), LEVEL, physical.posture(physical.neutral_rad))
    for _ in range(300):
        world.step(np.zeros(18))
    fallen = 2.0 - world.base()[0][2]
    world.close()
    assert fallen == pytest.approx(0.5 * GRAVITY_M_S2 * 0.3**2, rel=0.004)


@pytest.mark.parametrize(("share", "slides"), [(0.8, False), (1.25, True)])
def test_a_standing_robot_slides_where_friction_ends(
    robot: Robot, make: Make, share: float, slides: bool
) -> None:
    model = robot.document["contact"]["friction"]
    slippery = changed(robot, "contact", "friction", to={**model, "value": 0.2})
    plant = make(slippery)
    stand(plant, slippery, 3.0)
    slope = math.atan(share * 0.2)
    down, aside = math.cos(slope) * GRAVITY_M_S2, math.sin(slope) * GRAVITY_M_S2
    pybullet.setGravity(aside, 0.0, -down, physicsClientId=plant.world._client)
    before = plant.observe()["mocap/base_x_m"]
    plant.advance(4.0)
    assert (plant.observe()["mocap/base_x_m"] - before > 0.1) == slides


def test_both_robots_stand_at_neutral_under_their_own_weight(robot: Robot, make: Make) -> None:
    plant = make(robot)
    plant.advance(0.5)
    assert plant.observe()["contact/trunk_n"] > 0.0  # it lies
    stand(plant, robot, 4.0)
    seen = plant.observe()
    height = plant.robot.height_m(plant.robot.neutral_rad)
    assert seen["mocap/base_z_m"] == pytest.approx(height, abs=0.1 * height)
    assert abs(seen["mocap/base_roll_rad"]) < 0.02
    assert abs(seen["mocap/base_pitch_rad"]) < 0.02
    assert seen["contact/trunk_n"] == 0.0
    assert seen["contact/self_n"] == 0.0
    for servo in robot.servos:
        state = plant.sample(servo.servo_id)
        goal = servo.to_servo(plant.robot.neutral_rad[servo.joint.split(".")[1]])
        assert abs(state.position_rad - goal) < 0.1
        assert abs(state.duty) < 0.6  # well below saturation


def test_the_feet_of_a_standing_robot_carry_its_weight(robot: Robot, make: Make) -> None:
    plant = make(robot, trunk_load_kg=0.1)
    stand(plant, robot, 4.0)
    forces = []
    for step in range(100):
        plant.advance(4.0 + 0.001 * (step + 1))
        seen = plant.observe()
        forces.append(sum(seen[f"contact/{leg.name}_n"] for leg in plant.robot.legs))
    weight = plant.robot.mass_kg * GRAVITY_M_S2
    assert np.mean(forces) == pytest.approx(weight, rel=0.01)


def test_the_position_error_of_a_loaded_joint_follows_from_its_torque(make: Make) -> None:
    robot = load_robot("marvin")
    plant = make(robot)
    stand(plant, robot, 4.0)
    drive = plant.robot.joints[0].drive
    for servo in robot.servos:
        state = plant.sample(servo.servo_id)
        goal = servo.to_servo(plant.robot.neutral_rad[servo.joint.split(".")[1]])
        per_rad = LAWS["marvin"]["gain_cw_per_rad"] * drive.torque_constant_nm_a
        per_rad *= state.voltage_v / drive.resistance_ohm
        slack = drive.friction.coulomb_nm + per_rad * drive.sensor_step_rad
        assert abs(state.torque_nm - per_rad * (goal - state.position_rad)) < slack


def frictionless(robot: Robot) -> Robot:
    model = robot.document["bus"]["servo_model"]
    zero = {"value": 0.0, "source": "assumed"}
    for key in ("coulomb_nm", "viscous_nm_s_rad"):
        robot = changed(robot, "drive", model, key, to=zero)
    return robot


def links_energy_j(world: World) -> float:
    """Kinetic and potential energy of the moving links, from the engine's own states."""
    total = 0.0
    on = {"physicsClientId": world._client}
    for link in range(18):
        info = pybullet.getDynamicsInfo(world._body, link, **on)
        state = pybullet.getLinkState(world._body, link, 1, 1, **on)
        turn = np.array(pybullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
        spin = turn.T @ np.array(state[7])
        total += 0.5 * info[0] * float(np.dot(state[6], state[6]))
        total += 0.5 * float(np.dot(info[2], spin**2)) + info[0] * GRAVITY_M_S2 * state[0][2]
    return total


def energy_j(plant: BulletPlant) -> float:
    """Links, rotors and gears of a held robot."""
    states, params = plant.bank.states, plant.bank.params
    position, velocity = np.zeros(18), np.zeros(18)
    plant.world.read(position, velocity)
    direction = np.array([j.direction for j in plant.robot.joints])
    zero = np.array([j.zero_rad for j in plant.robot.joints])
    twist = states[fields.ROTOR_POSITION] - direction * (position - zero)
    rotors = 0.5 * params[fields.ROTOR_INERTIA] * states[fields.ROTOR_VELOCITY] ** 2
    gears = 0.5 * params[fields.GEAR_STIFFNESS] * twist**2
    return links_energy_j(plant.world) + float(np.sum(rotors + gears))


def test_swinging_legs_with_torque_off_gain_no_energy(robot: Robot, make: Make) -> None:
    swinging = frictionless(robot)
    for key, angle in (("femur_rad", -0.4), ("tibia_rad", -0.3)):
        swinging = changed(swinging, "rest", key, to={"value": angle, "source": "assumed"})
    plant = make(swinging, held=True)
    start = energy_j(plant)
    highest = moved = 0.0
    for step in range(1, 2001):
        plant.advance(0.001 * step)
        kinetic = 0.5 * float(
            plant.bank.params[fields.ROTOR_INERTIA] @ plant.bank.states[fields.ROTOR_VELOCITY] ** 2
        )
        moved = max(moved, kinetic)
        highest = max(highest, energy_j(plant) - start)
        if any(
            not j.lower_rad + 0.02 < angle < j.upper_rad - 0.02
            for j, angle in angles(plant, plant.robot.joints)
        ):
            break  # a stop takes energy out: the free swing is over
    assert step > 100
    assert moved > 0.005
    assert highest < 0.02 * moved


def angles(plant: BulletPlant, joints: tuple) -> list[tuple]:
    seen = plant.observe()
    return [(j, seen[f"rig/{j.name}_rad"]) for j in joints]


@pytest.mark.parametrize("held", [True, False])
def test_random_goals_for_5_s_blow_nothing_up(robot: Robot, make: Make, held: bool) -> None:
    plant = make(robot, held=held)
    rng = np.random.default_rng(7)
    fastest = max(j.drive.data_sheet.no_load_velocity_rad_s for j in plant.robot.joints)
    for period in range(50):
        for servo, joint in zip(robot.servos, plant.robot.joints, strict=True):
            goal = servo.to_servo(float(rng.uniform(joint.lower_rad, joint.upper_rad)))
            law = DriveCommand(torque_enable=True, goal_position_rad=goal, **LAWS[robot.name])
            plant.command(servo.servo_id, law)
        for part in range(10):
            plant.advance(0.1 * period + 0.01 * (part + 1))
            states = plant.bank.states
            assert np.abs(states[fields.ROTOR_VELOCITY]).max() < 2.0 * fastest
            seen = plant.observe()
            assert 0.0 < seen["mocap/base_z_m"] < 0.6
            for joint, angle in angles(plant, plant.robot.joints):
                assert joint.lower_rad - 0.1 < angle < joint.upper_rad + 0.1


def test_steps_of_1_ms_are_converged_to_half_a_count(robot: Robot, make: Make) -> None:
    smooth = robot
    model = robot.document["bus"]["servo_model"]
    smooth = changed(
        robot, "drive", model, "sensor_step_rad", to={"value": 0.0, "source": "assumed"}
    )

    def run(steps_per_tick: int) -> np.ndarray:
        plant = make(smooth, held=True, steps_per_tick=steps_per_tick)
        rows = []
        for k, posture in enumerate(
            ({"coxa": 0.3, "femur": 0.6, "tibia": -1.6}, {"coxa": -0.2, "femur": 0.2, "tibia": -1})
        ):
            hold(plant, smooth, posture)
            for step in range(100):
                plant.advance(0.5 * k + 0.005 * (step + 1))
                rows.append([plant.sample(s.servo_id).position_rad for s in smooth.servos])
        return np.array(rows)

    fine = run(8)
    error = {k: float(np.abs(run(k) - fine).max()) for k in (1, 2, 4)}
    assert error[1] < 0.5 * math.radians(300 / 1024)
    assert error[1] > error[2] > error[4]


def test_a_leg_pushed_into_another_is_felt_as_self_contact(make: Make) -> None:
    robot = load_robot("marvin")
    plant = make(robot, held=True)
    for servo in robot.servos:
        leg, segment = servo.joint.split(".")
        joint = {"coxa": 0.0, "femur": 0.0, "tibia": -0.5}[segment]
        if segment == "coxa":
            joint = {"leg1": 1.0, "leg5": -1.0}.get(leg, 0.0)
        law = DriveCommand(
            torque_enable=True, goal_position_rad=servo.to_servo(joint), **LAWS["marvin"]
        )
        plant.command(servo.servo_id, law)
    highest = 0.0
    for step in range(100):
        plant.advance(0.01 * (step + 1))
        highest = max(highest, plant.observe()["contact/self_n"])
    assert highest > 0.05


def test_a_held_trunk_stays_and_its_feet_touch_nothing(robot: Robot, make: Make) -> None:
    plant = make(robot, held=True)
    before = plant.observe()
    hold(plant, robot, {"coxa": 0.0, "femur": -0.5, "tibia": -0.5})
    plant.advance(0.5)
    after = plant.observe()
    assert after["mocap/base_z_m"] == before["mocap/base_z_m"] == pytest.approx(0.5)
    assert all(after[f"contact/{leg.name}_n"] == 0.0 for leg in plant.robot.legs)


def test_base_angles_are_nose_up_right_down_and_heading(make: Make) -> None:
    world = make(load_robot("marvin")).world
    half = math.sin(0.05), math.cos(0.05)
    for axis, key in ((0, "pitch"), (1, "roll"), (2, "yaw")):
        quaternion = [0.0, 0.0, 0.0, half[1]]
        quaternion[axis] = half[0]
        world.place((0.0, 0.0, 0.5), tuple(quaternion), {})
        seen = world.observe()
        assert seen[f"mocap/base_{key}_rad"] == pytest.approx(0.1)
        assert seen["mocap/base_z_m"] == pytest.approx(0.5)


def test_a_supply_too_weak_makes_the_robot_sag(make: Make) -> None:
    robot = load_robot("phantomx")
    weak = changed(robot, "supply", "resistance_ohm", to={"value": 2.0, "source": "assumed"})
    heights, volts = [], []
    for each in (robot, weak):
        plant = make(each)
        stand(plant, each, 4.0)
        heights.append(plant.observe()["mocap/base_z_m"])
        volts.append(plant.sample(1).voltage_v)
    assert volts[1] < volts[0] - 1.0
    assert heights[1] < heights[0]


def test_stronger_rotors_do_not_change_the_stance(make: Make) -> None:
    robot = load_robot("marvin")
    plant = make(robot)
    heavy = plant.bank.params
    heavy[fields.ROTOR_INERTIA] *= 2.0
    stand(plant, robot, 4.0)
    other = make(replace(robot))
    stand(other, robot, 4.0)
    a, b = plant.observe()["mocap/base_z_m"], other.observe()["mocap/base_z_m"]
    assert a == pytest.approx(b, abs=0.002)
