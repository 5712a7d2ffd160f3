"""The torque analysis: a longer lever, torques from joint data, an overloaded femur."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from experiment_runs import campaign, ran

from bench.experiments import EXPERIMENTS
from bench.experiments.experiment import ExperimentError
from bench.experiments.position_error import TorqueSensor
from bench.experiments.weighing import DUTY, PAST_FRICTION, TRUE


@pytest.fixture(scope="module", params=["marvin", pytest.param("phantomx", marks=pytest.mark.slow)])
def analysed(request, tmp_path_factory):
    """No load and the largest, a repeat each."""
    folder = tmp_path_factory.mktemp("torque")
    return ran(
        "torque-analysis", request.param, folder, only=lambda trial: "load1" not in trial.name
    )


def test_loads_are_those_of_the_thesis(tmp_path):
    for robot, loads in (("phantomx", [0.0, 0.33, 0.66]), ("marvin", [0.0, 0.092, 0.184])):
        trials = campaign("torque-analysis", robot, tmp_path).trials
        assert [trial.trunk_load_kg for trial in trials] == loads


def test_a_longer_lever_takes_more_torque(analysed):
    _, result = analysed
    (femur,) = result.of("femur", 0.0)
    early = np.abs(femur.true_nm[femur.t_s < 0.5]).mean()
    late = np.abs(femur.true_nm[femur.t_s > femur.t_s[-1] - 0.5]).mean()
    assert late > 2.0 * early
    assert late < result.stall_at_nm


def test_torque_comes_out_of_joint_data_within_two_counts(analysed):
    recordings, result = analysed
    for part in ("femur", "tibia"):
        for load_kg, recording in zip(result.loads_kg, recordings, strict=True):
            joint = f"{result.leg}.{part}"
            sensor = TorqueSensor.of_recording(recording, recording.robot, joint)
            counts = 2.0 * sensor.count_rad  # one of the goal, one of the position
            bound = sensor.slope_nm_rad(sensor.drive.data_sheet.voltage_v) * counts
            error = result.rmse_of_stall(part, load_kg, past_friction=True) * result.stall_nm
            assert error < bound
            assert error < result.rmse_of_stall(part, load_kg) * result.stall_nm


def test_a_loaded_femur_shuts_down_a_second_after_it_stalls_and_gives_way(analysed):
    recordings, result = analysed
    unloaded, loaded = result.loads_kg
    assert result.shut_down(unloaded) == 0
    assert result.shut_down(loaded) == 1
    (femur,) = result.of("femur", loaded)
    joint = recordings[1].robot.by_joint[femur.joint]
    allowed_s = recordings[1].robot.tables[joint.servo_id].drive["overload_s"]
    sensor = TorqueSensor.of_recording(recordings[1], recordings[1].robot, femur.joint)
    full = np.abs(femur.goal_rad - femur.position_rad) >= sensor.full_error_rad
    assert femur.shut_down_s - femur.t_s[full][0] >= allowed_s
    after = femur.t_s > femur.shut_down_s + 0.5
    assert np.abs(femur.true_nm[after]).max() < 0.2 * result.stall_nm
    assert not any(c.shut_down_s > 0.0 for c in result.of("tibia", loaded))


def test_loads_and_voltages_of_the_legs_it_stands_on_are_recorded(analysed):
    recordings, result = analysed
    for recording in recordings:
        servo = recording.robot.by_joint[f"{result.leg}.femur"].servo_id
        for register in ("present_load", "present_voltage"):
            assert len(recording.si(servo, register, "read").value) > 50


def test_stands_on_three_legs(analysed):
    recordings, _ = analysed
    condition = recordings[0].metadata["condition"]
    assert set(condition["supporting"]) in ({"leg1", "leg3", "leg6"}, {"leg2", "leg4", "leg5"})
    assert condition["supporting"][-1] in ("leg5", "leg6")  # the middle one
    assert not set(condition["supporting"]) & set(condition["lifted"])


def test_feet_carry_the_load_when_torques_are_true(analysed):
    _, result = analysed
    for load_kg in result.loads_kg:
        assert result.recovered_kg(load_kg, TRUE) == pytest.approx(load_kg, abs=0.002)


def test_the_load_comes_out_of_joint_data_within_two_percent_of_the_weight(analysed):
    _, result = analysed
    for load_kg in result.loads_kg:
        (weighed,) = result.weighed(load_kg)
        error = abs(result.recovered_kg(load_kg, PAST_FRICTION) - load_kg)
        assert error < 0.02 * (weighed.own_kg + load_kg)
        assert error < abs(result.recovered_kg(load_kg, DUTY) - load_kg)


def test_the_load_is_among_the_numbers_with_the_error_of_every_joint(analysed):
    _, result = analysed
    for numbers, load_kg in zip(result.numbers()["weighing"], result.loads_kg, strict=True):
        assert numbers["true_load_kg"] == load_kg
        errors = numbers["rmse_of_stall"][PAST_FRICTION]
        assert len(errors) == 9
        assert 0.0 < max(errors.values()) < 0.06


def _said(recording, **condition):
    facts = {**recording.metadata["condition"], **condition}
    kept = {key: value for key, value in facts.items() if value is not None}
    return dataclasses.replace(recording, metadata={**recording.metadata, "condition": kept})


def test_recordings_that_tell_no_span_are_not_weighed(analysed):
    recordings, _ = analysed
    experiment = EXPERIMENTS["torque-analysis"]
    result = experiment.evaluate([_said(each, weighing_s=None) for each in recordings])
    assert result.weighings == ()
    assert result.numbers()["weighing"] == []
    assert len(experiment.draw(result).axes) == 4


def test_three_legs_must_be_named_to_weigh_on(analysed):
    recordings, _ = analysed
    two = [_said(each, supporting=["leg1", "leg6"]) for each in recordings]
    with pytest.raises(ExperimentError, match=r"supporting.*must name 3 legs"):
        EXPERIMENTS["torque-analysis"].evaluate(two)


def test_the_figure_has_the_thesiss_four_panels_and_the_load(analysed):
    _, result = analysed
    figure = EXPERIMENTS["torque-analysis"].draw(result)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    motion, load = "tibia: the motion (grey: goal)", "load on the trunk, by what the feet carry"
    assert sorted(titles) == sorted([motion, "coxa", "femur", "tibia", load])
