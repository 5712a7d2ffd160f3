"""The leg step, and the measures of a step's answer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from experiment_runs import ran

from bench.experiments import EXPERIMENTS
from bench.experiments.experiment import Choice, ExperimentError
from bench.experiments.leg_step import STEP_RAD
from bench.experiments.steps import answer
from bench.recording import Recording
from bench.running import in_process
from busemu.plant import ideal
from busemu.tables import load_robot
from busemu.timing import load_profile


@pytest.fixture(scope="module", params=["marvin", pytest.param("phantomx", marks=pytest.mark.slow)])
def stepped(request, tmp_path_factory):
    return ran("leg-step", request.param, tmp_path_factory.mktemp("step"), Choice(repeats=2))


@pytest.mark.parametrize("damping", [0.3, 0.6])
def test_measures_of_a_second_order_answer_are_those_of_theory(damping):
    t = np.arange(0.0, 3.0, 1e-4)
    fast = 20.0
    own = fast * math.sqrt(1.0 - damping**2)
    rest = np.cos(own * t) + damping * fast / own * np.sin(own * t)
    found = answer(t, 0.2 + 0.5 * (1.0 - np.exp(-damping * fast * t) * rest), 0.2, 0.71, 0.01)
    overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert found.overshoot == pytest.approx(overshoot, rel=1e-3)
    assert found.final_rad == pytest.approx(0.7, abs=1e-6)
    assert found.steady_error_rad == pytest.approx(0.01, abs=1e-6)
    # the envelope 0.5 exp(-damping w t) / sqrt(1 - damping^2) bounds when it settles
    settled = math.log(0.5 / 0.01 / math.sqrt(1.0 - damping**2)) / (damping * fast)
    assert 0.5 * settled < found.settling_s <= settled


def test_an_answer_without_overshoot_has_none():
    t = np.arange(0.0, 2.0, 1e-3)
    found = answer(t, 1.0 - np.exp(-t / 0.1), 0.0, 1.0, 0.01)
    assert found.overshoot < 1e-6
    assert found.rise_s == pytest.approx(0.1 * math.log(9.0), rel=1e-3)
    assert found.settling_s == pytest.approx(0.1 * math.log(100.0), abs=2e-3)


def test_a_joint_that_does_not_move_has_no_rise():
    t = np.arange(0.0, 1.0, 0.01)
    found = answer(t, np.zeros(len(t)), 0.0, 1.0, 0.01)
    assert math.isnan(found.rise_s)
    assert found.steady_error_rad == 1.0


def test_every_joint_steps_up_and_down_in_every_repeat(stepped):
    _, result = stepped
    for part in ("coxa", "femur", "tibia"):
        for outward in (True, False):
            every = result.of(part, outward=outward)
            assert [step.repeat for step in every] == [1, 2]
            for step in every:
                size = abs(step.goal_rad - step.start_rad)
                assert size == pytest.approx(STEP_RAD, abs=result.count_rad)


def test_positions_are_read_as_fast_as_the_bus_allows(stepped):
    _, result = stepped
    robot = load_robot(result.robot)
    session = in_process(robot, ideal(robot), load_profile(robot.timing))
    servo_id = robot.by_joint["leg6.coxa"].servo_id
    session.client.read(servo_id, "present_position")
    before_s = session.clock.now_s()
    session.client.read(servo_id, "present_position")
    assert result.period_s == pytest.approx(session.clock.now_s() - before_s, rel=0.02)


def test_what_is_read_is_the_angle_within_a_count(stepped):
    _, result = stepped
    for part in ("coxa", "femur", "tibia"):
        assert result.sensor_counts(part) < 1.0


def test_joints_overshoot_and_come_to_rest(stepped):
    _, result = stepped
    for step in result.steps:
        assert 0.02 < step.answer.overshoot < 0.5
        assert step.answer.settling_s < 0.4
        assert step.answer.rise_s < step.answer.settling_s
        assert abs(step.answer.steady_error_rad) < 4.0 * result.count_rad


def test_repeats_differ_in_phase_only(stepped):
    recordings, result = stepped
    spread = [
        result.repeatability_counts(part, outward=way)
        for part in ("coxa", "femur", "tibia")
        for way in (True, False)
    ]
    assert 0.0 < max(spread) < 1.0
    assert recordings[0].table != recordings[1].table


def test_recordings_without_a_step_are_refused_in_words(stepped):
    recordings, _ = stepped
    still = Recording.checked(recordings[0].table.slice(0, 0), recordings[0].metadata)
    with pytest.raises(ExperimentError, match="no goal of leg6 jumps"):
        EXPERIMENTS["leg-step"].evaluate([still])
    metadata = {**recordings[0].metadata, "condition": {}}
    with pytest.raises(ExperimentError, match=r"needs leg under \[condition\]"):
        EXPERIMENTS["leg-step"].evaluate([Recording.checked(still.table, metadata)])
