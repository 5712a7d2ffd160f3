"""Locomotion: the gait's phase out of goals, strides, stance errors, self-collision."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from experiment_runs import campaign, quiet, ran

from bench.experiments import EXPERIMENTS
from bench.experiments.experiment import Choice, ExperimentError
from bench.experiments.gait_phase import LIFTED_M, cycles, feet_m, profile
from bench.experiments.noticed import noticed
from bench.experiments.report import document, summary
from busemu.tables import load_robot
from hal.cpg import LocomotionController
from hal.legs import Legs

SECONDS = 6.0


@pytest.fixture(scope="module", params=["marvin", pytest.param("phantomx", marks=pytest.mark.slow)])
def walked(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    return ran("locomotion", request.param, folder, Choice(repeats=2, seconds=SECONDS))


def heights(t, period, duty):
    """A foot that is up after the share ``duty`` of each period."""
    phase = np.mod(t / period, 1.0)
    swing = (phase - duty) / (1.0 - duty)
    return np.where(swing > 0.0, 0.03 * np.sin(math.pi * swing), 0.0)


def test_cycles_are_those_of_the_foot_that_goes_up_and_down():
    t = np.arange(0.0, 10.0, 0.01)
    found = cycles(t, heights(t, 1.5, 0.6))
    assert len(found.end_s) == 5  # touch-downs at 1.5, 3.0, ... 9.0
    assert found.period_s == pytest.approx(1.5, abs=0.01)
    # a foot counts as up once it is higher than LIFTED_M, and as down again below it
    late = math.asin(LIFTED_M / 0.03) / math.pi * 0.4
    assert found.duty_factor == pytest.approx(0.6 + 2.0 * late, abs=0.02)
    phase, stance = found.phase(np.array([1.0, 1.51, 2.0, 2.7, 9.5]))
    assert np.isnan(phase[[0, 4]]).all()
    assert phase[1] < phase[2] < phase[3]
    assert stance.tolist() == [False, True, True, False, False]


def test_cycles_of_the_start_up_do_not_count():
    t = np.arange(0.0, 12.0, 0.01)
    found = cycles(t, np.where(t < 6.0, heights(t, 3.0, 0.6), heights(t, 1.5, 0.6)))
    early_s = math.asin(LIFTED_M / 0.03) / math.pi * 1.2  # below LIFTED_M a foot counts as down
    assert found.touch_down_s == pytest.approx([6.0, 7.5, 9.0, 10.5], abs=early_s + 0.01)


def test_a_foot_that_stays_down_has_no_cycle():
    t = np.arange(0.0, 5.0, 0.01)
    found = cycles(t, np.zeros(len(t)))
    assert math.isnan(found.period_s)
    assert np.isnan(found.phase(t)[0]).all()


def test_a_profile_is_the_mean_over_phase():
    phase = np.array([0.1, 0.1, 0.6, np.nan])
    centres, mean = profile(phase, np.array([1.0, 3.0, 5.0, 100.0]), bins=4)
    assert centres.tolist() == [0.125, 0.375, 0.625, 0.875]
    assert mean[[0, 2]].tolist() == [2.0, 5.0]
    assert np.isnan(mean[[1, 3]]).all()


def test_feet_over_time_are_those_of_the_robots_own_kinematics():
    legs = Legs.of(load_robot("marvin"))
    angles = np.random.default_rng(5).uniform(-1.0, 1.0, (3, 18))
    by_joint = {joint: angles[:, i] for i, joint in enumerate(legs.joints)}
    assert feet_m(legs, by_joint)[1] == pytest.approx(legs.feet_m(angles[1].reshape(6, 3)))


def test_period_and_stride_are_the_gaits(walked):
    _, result = walked
    gait = LocomotionController.of(load_robot(result.robot)).gait
    assert result.period_s == pytest.approx(gait.period_s, abs=gait.cycle_s)
    assert result.duty_factor > gait.duty_factor
    assert result.stride_m(commanded=True) == pytest.approx(gait.stride_m, rel=0.1)
    # joints lag and slip, but what they do is a stride of that kind
    assert 0.8 < result.stride_m(commanded=False) / result.stride_m(commanded=True) < 1.02


def test_the_body_goes_as_far_as_its_feet_push_it(walked):
    _, result = walked
    gait = LocomotionController.of(load_robot(result.robot)).gait
    pushed_m_s = gait.stride_m / (gait.duty_factor * gait.period_s)
    for speed in result.speeds_m_s:
        assert 0.8 * pushed_m_s < speed < 1.02 * pushed_m_s


def test_in_stance_the_load_holds_the_joints_off_their_goals(walked):
    """The femur carries: it stands above its goal, and the trunk hangs lower than commanded."""
    recordings, result = walked
    assert result.stance_error_rad("femur") < -result.count_rad
    for walk in result.walks:
        assert all(course.sag_m > 0.0 for course in walk.legs)
    femur = list(result.courses("femur"))
    true = np.concatenate([course.true_nm[course.stance] for course in femur])
    assert true.mean() < 0.0
    assert len(recordings) == len(result.walks) == 2


def test_torque_from_the_position_error_knows_of_velocity(walked):
    _, result = walked
    for part in ("coxa", "femur", "tibia"):
        with_it = result.rmse_of_stall(part, stance=False)
        assert with_it < result.rmse_of_stall(part, stance=False, static=True)
        assert result.rmse_of_stall(part, stance=True) < 0.1


def test_repeats_start_from_other_states_and_come_to_the_same_walk(walked):
    recordings, result = walked
    first, second = (r.series(1, "goal_position", "write").value for r in recordings)
    assert first.tolist() != second.tolist()
    assert np.ptp(result.speeds_m_s) < 0.05 * np.mean(result.speeds_m_s)


@pytest.mark.parametrize("robot", ["marvin", pytest.param("phantomx", marks=pytest.mark.slow)])
def test_legs_touch_each_other_at_six_times_the_stride_and_not_at_four(robot, tmp_path):
    for v, touch in ((4.0, False), (6.0, True)):
        choice = Choice(repeats=1, seconds=SECONDS, v_left=v, v_right=v)
        recordings, result = ran("locomotion", robot, tmp_path / f"{v}", choice)
        assert (result.self_collision_share > 0.0) is touch
        kinds = noticed(recordings)
        assert bool(kinds) is touch
        for one in kinds:
            legs = {body.partition(".")[0] for body in one.bodies}
            assert len(legs) == 2, one
            assert 0.0 < one.first_s < SECONDS + 2.0
            assert f"self-contact: {' and '.join(one.bodies)}, at" in str(one)
        found = document(EXPERIMENTS["locomotion"], result, recordings)["noticed"]
        assert found == [one.numbers() for one in kinds]
        assert ("noticed self-contact: leg" in summary(result, recordings)) is touch


def test_a_stride_beyond_reach_and_a_walk_too_short_are_refused_in_words(tmp_path):
    with pytest.raises(ExperimentError, match="too long a stride"):
        campaign("locomotion", "marvin", tmp_path, Choice(repeats=1, v_left=40.0))
    with pytest.raises(
        ExperimentError, match=r"--seconds must be at least .* s, so that every leg"
    ):
        campaign("locomotion", "marvin", tmp_path, Choice(repeats=1, seconds=1.0))


def test_a_recording_that_breaks_off_after_a_second_of_walking_is_refused_in_words(tmp_path):
    whole = campaign("locomotion", "marvin", tmp_path, Choice(repeats=1, seconds=SECONDS))
    (trial,) = whole.trials
    short = replace(trial, seconds=3.0, condition=trial.condition | {"seconds": 1.0})
    recordings = replace(whole, trials=(short,)).run(quiet)
    with pytest.raises(ExperimentError, match="record a longer walk"):
        EXPERIMENTS["locomotion"].evaluate(recordings)


def test_the_figure_has_a_column_a_leg_and_the_torque_limit(walked):
    _, result = walked
    figure = EXPERIMENTS["locomotion"].draw(result)
    assert len(figure.axes) == 5 * 6  # path, three joints, torque
    limits = [line for line in figure.axes[-1].get_lines() if line.get_linestyle() == "--"]
    assert {line.get_ydata()[0] for line in limits} == {-0.75, 0.75}
