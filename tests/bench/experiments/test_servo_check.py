"""The servo check, and that its line is the one of the control table and the data sheet."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from experiment_runs import campaign, ran

from bench.experiments import EXPERIMENTS
from bench.experiments.series import cut_at_s, spans_s
from bench.experiments.servo_check import STRAIGHT
from bench.recording import Recording, joint_track
from bench.running import in_process
from busemu.tables import load_robot
from busemu.timing import load_profile
from sim.world import BulletPlant


@pytest.fixture(scope="module", params=["marvin", "phantomx"])
def checked(request, tmp_path_factory):
    return ran("servo-check", request.param, tmp_path_factory.mktemp("check"))


def one_count(result):
    """What one count of the position makes of a slope fitted over the straight part."""
    span_rad = (STRAIGHT[1] - STRAIGHT[0]) * result.sensor.full_error_rad
    return result.sensor.count_rad / span_rad


def test_torque_grows_with_the_error_as_stall_torque_by_full_duty(checked):
    _, result = checked
    assert result.line.slope == pytest.approx(result.expected_slope_nm_rad, rel=one_count(result))
    assert result.line.r2 > 0.99
    # by hand: what the data sheet gives at this voltage, over the error that brings full duty
    sheet = result.sensor.drive.data_sheet
    by_hand = sheet.stall_torque_nm * result.supply_v / sheet.voltage_v
    by_hand /= result.sensor.full_error_rad
    friction = result.sensor.friction_nm / sheet.stall_torque_nm
    punch = result.sensor.law.punch_duty
    assert result.line.slope == pytest.approx(by_hand, rel=friction + punch + one_count(result))


def test_torque_ends_at_the_stall_torque(checked):
    _, result = checked
    assert result.stall_nm == pytest.approx(result.expected_stall_nm, rel=0.02)
    assert (
        np.nanmax(np.abs(result.torque_nm)) < result.expected_stall_nm + result.sensor.friction_nm
    )


def test_the_two_ways_lie_apart_by_friction(checked):
    _, result = checked
    resolution = result.expected_slope_nm_rad * result.sensor.count_rad
    assert result.friction_nm == pytest.approx(result.sensor.friction_nm, abs=0.5 * resolution)


def test_the_load_register_shows_the_position_law(checked):
    _, result = checked
    gain = result.sensor.law.gain_ccw_per_rad
    # a load is up to 130 ms old, 2 to 3 counts of the goal: half of it on either way cancels
    assert result.gain_per_rad == pytest.approx(gain, rel=2.0 * one_count(result))


def test_nothing_shuts_down(checked):
    (recording,), result = checked
    servo_id = recording.robot.by_joint[result.joint].servo_id
    spans = spans_s(recording, "pressing_s")
    assert len(spans) == 2
    assert all(cut_at_s(recording, servo_id, span) is None for span in spans)
    assert result.error_rad.min() < -result.sensor.full_error_rad
    assert result.error_rad.max() > result.sensor.full_error_rad


def test_a_block_that_gives_way_is_told(checked):
    _, result = checked
    assert not any("gave way" in finding for finding in result.findings())
    weak = replace(result, error_rad=np.minimum(result.error_rad, 0.05))
    assert any("only to 0.050 rad on one side" in finding for finding in weak.findings())


@pytest.mark.parametrize("trouble", ["a host that stalls", "a soft servo that lags"])
def test_a_joint_that_only_lags_is_not_taken_for_a_blocked_one(trouble, tmp_path):
    robot = load_robot("marvin")
    plant = BulletPlant(robot, held=True)
    try:
        session = in_process(robot, plant, load_profile(robot.timing))
        stalls = iter([2.0, 2.6, 3.2] if trouble == "a host that stalls" else [])
        due = [next(stalls, math.inf)]

        def stall(run_s):
            if run_s > due[0]:
                session.clock.sleep_until(session.clock.now_s() + 0.15)
                due[0] = next(stalls, math.inf)

        if trouble == "a soft servo that lags":
            session.client.write(robot.by_joint["leg6.coxa"].servo_id, "p_gain", 8)
        (trial,) = campaign("servo-check", "marvin", tmp_path).trials
        found = EXPERIMENTS["servo-check"].run(session, trial, stall)
        recording = session.recording("stalled", "servo-check", **trial.facts(), **found)
    finally:
        plant.close()
    stop_rad = robot.document["link"]["coxa"]["upper_rad"]["value"]
    track = joint_track(recording, "leg6.coxa", robot)
    for start_s, end_s in spans_s(recording, "pressing_s"):
        inside = (track.position_t_s > start_s) & (track.position_t_s < end_s)
        assert np.abs(track.position_rad[inside]).mean() == pytest.approx(stop_rad, abs=0.02)
    result = EXPERIMENTS["servo-check"].evaluate([recording])
    gain = 8 if trouble == "a soft servo that lags" else 32
    per_unit = robot.tables[1].drive["p_gain_duty_per_rad"]
    assert result.sensor.law.gain_ccw_per_rad == pytest.approx(gain * per_unit)
    current_a = result.sensor.drive.data_sheet.stall_current_a
    sag = robot.document["supply"]["resistance_ohm"]["value"] * current_a / result.supply_v
    bound = one_count(result) + sag
    assert result.line.slope == pytest.approx(result.expected_slope_nm_rad, rel=bound)


def test_without_an_observer_the_law_alone_is_found(checked):
    (recording,), result = checked
    names = recording.table["register"].to_pylist()
    bus_only = recording.table.filter([not name.startswith("rig/") for name in names])
    blind = EXPERIMENTS["servo-check"].evaluate([Recording.checked(bus_only, recording.metadata)])
    assert blind.line is None
    assert blind.comparisons() == ()
    assert blind.gain_per_rad == result.gain_per_rad
    assert len(EXPERIMENTS["servo-check"].draw(blind).axes) == 1
    assert len(EXPERIMENTS["servo-check"].draw(result).axes) == 2
