"""Servo check and leg step on rigs, which are robots without legs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from experiment_runs import campaign, quiet, ran

from bench.experiments import EXPERIMENTS
from bench.experiments.experiment import Choice, ExperimentError
from bench.experiments.rigs import CLAMP_RAD, clamp_rad, steps_rad
from bench.experiments.servo_check import PAST, STRAIGHT
from busemu.tables import load_robot
from sim.robot import read_physics

RIGS = ("pendulum", "marvin-leg", "arm", "xl330-pendulum", "sts3215-lever")


@pytest.mark.parametrize("rig", RIGS)
def test_the_first_joint_of_a_rig_is_checked_against_its_control_table(rig, tmp_path):
    recordings, result = ran("servo-check", rig, tmp_path)
    robot = load_robot(rig)
    assert result.joint == robot.servos[0].joint
    span_rad = (STRAIGHT[1] - STRAIGHT[0]) * result.sensor.full_error_rad
    count = result.sensor.count_rad / span_rad
    assert result.gain_per_rad == pytest.approx(result.sensor.law.gain_ccw_per_rad, rel=2.0 * count)
    sag = robot.document["supply"]["resistance_ohm"]["value"]
    sag *= result.sensor.drive.data_sheet.stall_current_a / result.supply_v
    assert result.line.slope == pytest.approx(result.expected_slope_nm_rad, rel=count + sag)
    assert result.stall_nm == pytest.approx(result.expected_stall_nm, rel=0.02 + sag)
    assert result.comparisons() == ()  # the thesis has no rigs
    low, high = recordings[0].metadata["condition"]["blocked_rad"]
    assert high - low == pytest.approx(2.0 * CLAMP_RAD)


def test_another_joint_of_a_rig_is_checked_where_it_is_wanted(tmp_path):
    _, result = ran("servo-check", "arm", tmp_path, Choice(repeats=1, joint="elbow"))
    assert result.joint == "elbow"
    assert result.stall_nm == pytest.approx(result.expected_stall_nm, rel=0.02)


@pytest.mark.parametrize("rig", RIGS)
def test_every_joint_of_a_rig_steps_out_and_back(rig, tmp_path):
    _, result = ran("leg-step", rig, tmp_path)
    names = [joint.name for joint in read_physics(load_robot(rig)).joints]
    assert list(result.parts) == names
    steps = steps_rad(load_robot(rig), 0.4)
    for name in names:
        start, goal = steps[name]
        (out,) = result.of(name, outward=goal > start)
        (back,) = result.of(name, outward=goal < start)
        assert out.goal_rad == pytest.approx(goal, abs=result.count_rad)
        assert back.goal_rad == pytest.approx(start, abs=result.count_rad)
        assert abs(np.ptp(out.position_rad)) > 0.3
    assert result.comparisons() == ()
    figure = EXPERIMENTS["leg-step"].draw(result)
    assert [axes.get_title(loc="left") for axes in figure.axes[: len(names)]] == names


def test_a_leg_on_a_stand_steps_as_on_its_robot(tmp_path):
    _, alone = ran("leg-step", "marvin-leg", tmp_path / "leg")
    _, whole = ran("leg-step", "marvin", tmp_path / "robot")
    for part in ("coxa", "femur", "tibia"):
        one, other = (
            np.mean([s.answer.rise_s for way in (True, False) for s in r.of(part, outward=way)])
            for r in (alone, whole)
        )
        assert one == pytest.approx(other, rel=0.1)


@pytest.mark.parametrize("name", ["torque-analysis", "locomotion"])
def test_what_needs_legs_says_so_of_a_rig(name, tmp_path):
    with pytest.raises(ExperimentError, match=f"{name} needs a robot that walks.*use servo-check"):
        campaign(name, "pendulum", tmp_path)


def test_a_joint_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    wrong = Choice(repeats=1, joint="wrist")
    with pytest.raises(ExperimentError, match="no joint wrist: use --joint base or --joint should"):
        campaign("servo-check", "arm", tmp_path, wrong)
    with pytest.raises(ExperimentError, match="use --leg, not --joint"):
        campaign("servo-check", "marvin", tmp_path, wrong)


def test_a_clamp_leaves_the_goal_room_for_full_duty():
    robot = load_robot("pendulum")
    low, high = clamp_rad(robot, "arm", PAST)
    assert (low, high) == pytest.approx((-CLAMP_RAD, CLAMP_RAD))
    with pytest.raises(ExperimentError, match=r"arm: its servo turns from -2\.\d+ to 2\.\d+ rad"):
        clamp_rad(robot, "arm", 16.0)


def test_a_rig_that_is_served_has_no_block_and_is_told_so(tmp_path):
    wanted = campaign("servo-check", "pendulum", tmp_path)
    with pytest.raises(ExperimentError, match="no block to press against: leave --port away"):
        replace(wanted, port="/dev/pts/99").run(quiet)


@pytest.mark.parametrize("name", ["servo-check", "leg-step"])
def test_a_person_is_told_what_a_rig_will_do(name, tmp_path):
    (trial,) = campaign(name, "arm", tmp_path).trials
    words = EXPERIMENTS[name].preparation(load_robot("arm"), trial)
    assert "arm goes to where its file has it at rest" in words
    assert "leg" not in words
