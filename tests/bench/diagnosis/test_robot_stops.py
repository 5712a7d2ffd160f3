"""Stops that a robot file assumes, and recordings that went past them."""

import math
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from walking_robots import marvin, recorded_walk

from bench.diagnosis.result import Diagnosis, FitSummary
from bench.diagnosis.robot import running as robot_running
from bench.diagnosis.robot.diagnosis import RobotDiagnosis
from bench.diagnosis.robot.replay import course, play
from bench.diagnosis.robot.stops import past_stops
from bench.diagnosis.running import Split
from bench.diagnosis.watch import Watch
from bench.recording import joint_track
from sim.model import read_model

TIGHT_RAD = 0.06  #: of the walk that the stop leaves out


def lowest_coxa():
    """The farthest that any coxa was read [rad]."""
    names = [mount.joint for mount in marvin().servos if mount.joint.endswith(".coxa")]
    return min(float(joint_track(recorded_walk(), n, marvin()).position_rad.min()) for n in names)


def with_stop(lower_rad):
    link = marvin().document["link"]
    coxa = link["coxa"] | {"lower_rad": {"value": lower_rad, "source": "assumed"}}
    return replace(marvin(), document={**marvin().document, "link": link | {"coxa": coxa}})


@pytest.fixture(scope="module")
def tight():
    return with_stop(lowest_coxa() + TIGHT_RAD)


def test_a_robot_within_its_stops_keeps_them():
    assert past_stops(marvin(), [recorded_walk()]) == (marvin(), ())


def test_what_a_zero_may_be_off_is_no_proof():
    near = with_stop(lowest_coxa() + math.radians(0.9))
    assert past_stops(near, [recorded_walk()]) == (near, ())


def test_a_stop_that_was_gone_past_is_farther_away_for_all_legs(tight):
    freed, told = past_stops(tight, [recorded_walk()])
    assert len(told) == 1
    assert told[0].startswith("coxa joints were read at ")
    before, after = read_model(tight).joints, read_model(freed).joints
    moved = [b.name for b, a in zip(before, after, strict=True) if a != b]
    assert moved == [joint.name for joint in after if joint.segment == "coxa"]
    assert all(j.lower_rad < lowest_coxa() for j in after if j.segment == "coxa")
    assert freed.document["link"]["coxa"]["lower_rad"]["source"].startswith("assumed: recordings")


def test_one_damaged_reading_moves_no_stop(tight, monkeypatch):
    """The walk has its few farthest readings taken out but for one."""

    def cut(recording, joint, robot):
        track = joint_track(recording, joint, robot)
        angle = np.maximum(track.position_rad, lowest_coxa() + TIGHT_RAD)
        angle[0] = track.position_rad.min()
        return replace(track, position_rad=angle)

    monkeypatch.setattr("bench.diagnosis.robot.stops.joint_track", cut)
    assert past_stops(tight, [recorded_walk()]) == (tight, ())


def test_a_replay_follows_where_a_stop_held_it(tight):
    told = course(recorded_walk(), marvin())
    names = [mount.joint for mount in marvin().servos]
    rows = [n for n, name in enumerate(names) if name.endswith(".coxa")]

    def apart(robot):
        track = play(read_model(robot), told)
        return max(
            float(np.abs(told.position_rad[n] - track.at(n, told.sample_s[n])).max()) for n in rows
        )

    freed, _ = past_stops(tight, [recorded_walk()])
    assert apart(freed) < 0.5 * TIGHT_RAD < apart(tight)


def test_a_diagnosis_replays_and_writes_the_robot_that_could_move_so(tight, tmp_path, monkeypatch):
    plain = Diagnosis(
        "consistent", (), (), FitSummary(0.01, 0.01, 0.002, True, ("walk",)), (), (), ()
    )
    seen = []

    def diagnosed(robot, *_, **__):
        seen.append(robot)
        return RobotDiagnosis(plain, (), (), ())

    monkeypatch.setattr(robot_running, "diagnose_robot", diagnosed)
    monkeypatch.setattr(robot_running, "write_answers", lambda robot, *_: seen.append(robot))
    monkeypatch.setattr(robot_running, "traces", lambda robot, *_: seen.append(robot) or [])
    parts = Split((recorded_walk(),), ())
    watch = Watch(lambda _: None)
    answers = robot_running.run_robot(tight, parts, tmp_path, date(2026, 1, 2), watch=watch)
    freed, told = past_stops(tight, [recorded_walk()])
    assert [robot.document for robot in seen] == [freed.document] * 3
    assert answers.diagnosis.limits == told
