"""The load on one joint of an arm, against MuJoCo's static torques and against a pendulum's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from engines import MujocoWorld
from sim_rigs import changed

from busemu.tables import load_robot
from sim.entries import PhysicsError
from sim.model import read_model
from sim.one_joint import one_joint_load
from sim.posture import posture_load

POSTURES = 12


def leaning_arm():
    """The arm with a weight in its hand, a yawed joint, and a stand that leans."""
    table = {"name": "ground_tilt", "where": [], "parameters": {}}
    for key, value in (("roll_rad", 0.2), ("pitch_rad", -0.1)):
        table["parameters"][key] = {"value": value, "source": "assumed"}
    leaning = changed(load_robot("arm"), "effect", to=[table])
    robot = read_model(leaning, condition={"payload_kg": 0.1})
    return robot.with_bodies(replace(robot.body("shoulder"), yaw_rad=0.4))


def postures(robot):
    return np.random.default_rng(1).uniform(-2.0, 2.0, (POSTURES, len(robot.joints)))


def in_mujoco(robot, posture):
    """Static torques of gravity [N m] and inertias about the axes [kg m^2], by joint."""
    world = MujocoWorld(robot, step_s=0.001)
    model, data = world.model, world.data
    places = {j.name: int(model.jnt_qposadr[model.joint(j.name).id]) for j in robot.joints}
    for joint, angle in zip(robot.joints, posture, strict=True):
        data.qpos[places[joint.name]] = angle
    mujoco.mj_forward(model, data)
    inertia = np.zeros(model.nv)
    told = {}
    for name, k in places.items():
        mujoco.mj_mulM(model, data, inertia, np.eye(model.nv)[k])
        told[name] = float(-data.qfrc_bias[k]), float(inertia[k])
    return told


@pytest.mark.parametrize(
    "robot", [read_model(load_robot("arm")), leaning_arm()], ids=("plain", "leaning")
)
def test_torque_of_gravity_is_that_of_inverse_dynamics(robot):
    angles = postures(robot)
    expected = [in_mujoco(robot, posture) for posture in angles]
    for column, joint in enumerate(robot.joints):
        told = posture_load(robot, joint.name, angles).torque_nm(angles[:, column])
        static = [by_joint[joint.name][0] for by_joint in expected]
        assert told == pytest.approx(static, abs=1e-9)
    assert max(abs(by_joint["shoulder"][0]) for by_joint in expected) > 0.1


def test_inertia_is_the_diagonal_of_the_mass_matrix():
    robot = leaning_arm()
    for posture in postures(robot):
        for name, (_, inertia) in in_mujoco(robot, posture).items():
            told = posture_load(robot, name, posture[None]).inertia_kg_m2
            assert told == pytest.approx(inertia, rel=1e-9)


def test_the_own_angle_of_the_joint_does_not_matter():
    robot = leaning_arm()
    angles = postures(robot)
    other = angles.copy()
    other[:, 1] += 1.0
    loads = [posture_load(robot, "shoulder", a) for a in (angles, other)]
    assert loads[0].cosine_nm == pytest.approx(loads[1].cosine_nm, abs=1e-12)
    assert loads[0].inertia_kg_m2 == pytest.approx(loads[1].inertia_kg_m2, rel=1e-12)


def test_a_rig_of_one_joint_has_its_pendulum():
    robot = read_model(load_robot("pendulum"))
    told, known = posture_load(robot, robot.joints[0].name, np.zeros((1, 1))), one_joint_load(robot)
    assert told.sine_nm[0] == pytest.approx(known.gravity_nm * np.cos(known.centre_rad))
    assert told.cosine_nm[0] == pytest.approx(known.gravity_nm * np.sin(known.centre_rad))
    assert told.inertia_kg_m2 == pytest.approx(known.inertia_kg_m2)
    assert told.moment_nm == pytest.approx(known.moment_nm)


def test_a_walker_is_refused():
    robot = read_model(load_robot("marvin"))
    with pytest.raises(PhysicsError, match="fixed base"):
        posture_load(robot, robot.joints[0].name, np.zeros((1, len(robot.joints))))


def test_angles_of_other_joints_than_the_robots_are_refused():
    robot = read_model(load_robot("arm"))
    with pytest.raises(PhysicsError, match="3 joints, not 2"):
        posture_load(robot, "elbow", np.zeros((4, 2)))


def moving_in_mujoco(robot, angles, rates, accelerations):
    """What each joint's torque must be beside gravity's [N m], by row (n, joints)."""
    world = MujocoWorld(robot, step_s=0.001)
    model, data = world.model, world.data
    at = [int(model.jnt_qposadr[model.joint(j.name).id]) for j in robot.joints]
    needed = np.zeros_like(angles)
    for row in range(len(angles)):
        data.qpos[at], data.qvel[:] = angles[row], 0.0
        mujoco.mj_forward(model, data)
        still = data.qfrc_bias[at].copy()
        data.qvel[at] = rates[row]
        mujoco.mj_forward(model, data)
        inertia, acceleration = np.zeros(model.nv), np.zeros(model.nv)
        acceleration[at] = accelerations[row]
        mujoco.mj_mulM(model, data, inertia, acceleration)
        needed[row] = inertia[at] + data.qfrc_bias[at] - still
    return needed


@pytest.mark.parametrize(
    "robot", [read_model(load_robot("arm")), leaning_arm()], ids=("plain", "leaning")
)
def test_a_moving_arm_pulls_its_joints_as_inverse_dynamics_has_it(robot):
    step_s = 0.002
    t_s = np.arange(0.0, 0.6, step_s)[:, None]
    pace, lag = np.array([[5.0, 7.0, 9.0]]), np.array([[0.0, 1.0, 2.0]])
    angles = 0.8 * np.sin(pace * t_s + lag)
    rates, accelerations = 0.8 * pace * np.cos(pace * t_s + lag), -(pace**2) * angles
    needed = moving_in_mujoco(robot, angles, rates, accelerations)
    for column, joint in enumerate(robot.joints):
        load = posture_load(robot, joint.name, angles, step_s)
        own = load.inertia_kg_m2 * accelerations[:, column]
        expected = (own - needed[:, column])[3:-3]
        assert load.moved_nm[3:-3] == pytest.approx(expected, abs=2e-3 * np.abs(needed).max())
        assert np.abs(expected).max() > 0.005 * np.abs(needed).max()
        assert not posture_load(robot, joint.name, angles).moved_nm.any()
