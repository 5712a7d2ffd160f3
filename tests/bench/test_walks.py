"""A robot's own program, unmodified, over the emulated bus with PyBullet behind it."""

import math

import numpy as np
import pytest

from bench.running import Steering, in_process, walk_in
from busemu.tables import load_robot
from busemu.timing import load_profile
from sim.world import BulletPlant


def walk(name, seconds=6.0, **steering):
    robot = load_robot(name)
    plant = BulletPlant(robot)
    try:
        session = in_process(robot, plant, load_profile(robot.timing), observe_every_s=0.02)
        report, finished = walk_in(session, Steering(seconds, **steering))
        assert finished
        return robot, session, report
    finally:
        plant.close()


def seen(session, name, from_s=0.0):
    series = session.observed.recording(session.metadata("observed", "test")).observed(name)
    return series.value[series.t_sample_s >= from_s]


def columns(session):
    """The columns of the recording, as bytes where they are numbers: NaN compares like the rest."""
    table = session.recording("walk", "test").table
    numbers = {name: table[name].to_numpy().tobytes() for name in ("t_s", "t_reply_s", "raw")}
    return numbers | {name: table[name].to_pylist() for name in ("servo_id", "op", "register")}


@pytest.fixture(scope="module", params=["marvin", "phantomx"])
def walked(request):
    return walk(request.param)


def test_a_robot_walks_forward_and_straight(walked):
    robot, session, _ = walked
    gait = robot.document["gait"]
    strides_m = 6.0 / gait["period_s"] * gait["stride_m"] / gait["duty_factor"]
    ahead_m = seen(session, "mocap/base_y_m")[-1]
    assert ahead_m > 0.6 * strides_m  # the first strides are still finding their rhythm
    assert abs(seen(session, "mocap/base_x_m")[-1]) < 0.15 * ahead_m
    assert abs(seen(session, "mocap/base_yaw_rad")[-1]) < math.radians(8.0)


def test_a_walking_robot_keeps_its_body_up_and_level(walked):
    _, session, _ = walked
    standing = 2.5  # s: after standing up
    end = session.clock.now_s() - 0.2  # before the torque went off
    series = session.observed.recording(session.metadata("o", "t"))
    height = series.observed("mocap/base_z_m")
    upright = (height.t_sample_s > standing) & (height.t_sample_s < end)
    assert np.ptp(height.value[upright]) < 0.02
    assert height.value[upright].min() > 0.05
    for tilt in ("roll", "pitch"):
        values = series.observed(f"mocap/base_{tilt}_rad").value[upright]
        assert np.abs(values).max() < math.radians(5.0)


def test_feet_alternate_in_two_tripods(walked):
    _, session, _ = walked
    observed = session.observed.recording(session.metadata("o", "t"))
    start = session.clock.now_s() - 3.0
    down = {}
    for leg in range(1, 7):
        force = observed.observed(f"contact/leg{leg}_n")
        inside = (force.t_sample_s > start) & (force.t_sample_s < start + 2.8)
        down[leg] = force.value[inside] > 0.05
    for tripod, other in (((1, 3, 6), (2, 4, 5)),):
        assert np.mean(down[tripod[0]] == down[tripod[1]]) > 0.75
        assert np.mean(down[tripod[0]] == down[tripod[2]]) > 0.75
        assert np.mean(down[tripod[0]] != down[other[0]]) > 0.6


def test_the_control_loop_keeps_its_pace(walked):
    robot, _, report = walked
    assert report.missed_deadlines == 0
    assert report.lost_replies == 0
    assert report.cycle_mean_s == pytest.approx(robot.document["gait"]["cycle_s"], rel=1e-3)
    assert not report.alerts


def test_joints_follow_their_goals_within_a_few_degrees(walked):
    _, _, report = walked
    assert len(report.tracking_rms_rad) == 18
    assert max(report.tracking_rms_rad.values()) < math.radians(6.0)
    assert min(report.tracking_rms_rad.values()) > 0.0  # a servo without lag would be a fake


@pytest.mark.slow
def test_unequal_strides_turn_the_robot_towards_the_shorter_side():
    _, session, _ = walk("marvin", 5.0, v_left=1.4, v_right=0.4)
    right_turn = seen(session, "mocap/base_yaw_rad")[-1]
    _, session, _ = walk("marvin", 5.0, v_left=0.4, v_right=1.4)
    left_turn = seen(session, "mocap/base_yaw_rad")[-1]
    assert right_turn < -math.radians(8.0)
    assert left_turn > math.radians(8.0)


def test_two_runs_in_virtual_time_give_the_same_recording_to_the_bit():
    first, second = (walk("marvin", 1.0)[1] for _ in range(2))
    one, two = (columns(s) for s in (first, second))
    assert one == two
    assert len(one["t_s"]) > 8 * 1000


def test_another_seed_starts_another_way():
    first, second = (columns(walk("marvin", 1.0, seed=seed)[1]) for seed in (0, 1))
    assert first["register"] == second["register"]
    assert first["raw"] != second["raw"]


def test_after_a_walk_the_torque_is_off(walked):
    _, session, report = walked
    assert report.torque_left_on == ()
    assert all(servo.memory["torque_enable"] == 0 for servo in session.bus.servos)
