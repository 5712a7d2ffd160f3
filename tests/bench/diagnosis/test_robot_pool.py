import os
import signal
from dataclasses import replace

import numpy as np
import pytest
from walking_robots import marvin, walked

from bench.diagnosis.journal import Journal
from bench.diagnosis.robot import pool as robot_pool
from bench.diagnosis.robot.features import Features
from bench.diagnosis.robot.pool import ROWS, Job, Replays
from bench.diagnosis.sense import DiagnosisError
from sim.entries import PhysicsError

SHORT = Job(0, short=True)


@pytest.fixture(scope="module")
def features():
    return Features.of(walked(), marvin())


def replays(features, folder):
    return Replays(marvin(), [features], (), processes=1, journal=Journal(folder))


@pytest.fixture(scope="module")
def kept(features, tmp_path_factory):
    folder = tmp_path_factory.mktemp("journal")
    with replays(features, folder) as first:
        (outcome,) = first.run([SHORT])
        assert first.count == 1
    return folder, outcome


def test_a_replay_that_was_kept_is_not_run_again_and_is_the_same_to_the_bit(features, kept):
    folder, outcome = kept
    with replays(features, folder) as second:
        (again,) = second.run([SHORT])
        assert second.count == 0
    for name in ROWS:
        assert (getattr(again, name) == getattr(outcome, name)).all()


def test_a_replay_of_another_recording_is_another(features, kept):
    folder, _ = kept
    course = features.course
    other = replace(course, condition=dict(course.condition) | {"trunk_load_kg": 0.1})
    with replays(replace(features, course=other), folder) as second:
        second.run([SHORT])
        assert second.count == 1


def test_where_the_system_gives_no_semaphores_one_process_does_all(features, kept, monkeypatch):
    def denied(*_):
        raise PermissionError("[Errno 13] Permission denied")

    monkeypatch.setattr(robot_pool, "ProcessPoolExecutor", denied)
    with Replays(marvin(), [features], (), processes=2) as alone:
        (outcome,) = alone.run([SHORT])
    assert (outcome.angle_rad == kept[1].angle_rad).all()


def killed(job):
    """Instead of a replay, the process that was to run it is gone."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_process_that_was_killed_is_told_and_what_to_do_about_it(features, monkeypatch):
    monkeypatch.setattr(robot_pool, "_run", killed)
    jobs = [Job(0, trials=((name, 1.0),), short=True) for name in ("one", "other")]
    with (
        Replays(marvin(), [features], (), processes=2) as both,
        pytest.raises(DiagnosisError, match=r"has died .*the same command goes on"),
    ):
        both.run(jobs)
    assert both.count == 0


def test_a_robot_that_there_cannot_be_is_lost_like_one_that_the_engine_cannot_run(
    features, kept, monkeypatch
):
    def none(robot, every, z):
        raise PhysicsError("effect foot_compliance: stiffness_n_m = 199.6 N/m is not within 200")

    monkeypatch.setattr(robot_pool, "with_nuisances", none)
    with Replays(marvin(), [features], (), processes=1) as alone:
        (outcome,) = alone.run([Job(0, nuisances=(1.0,))])
    assert np.isnan(outcome.angle_rad).all()
    assert outcome.angle_rad.shape == kept[1].angle_rad.shape
    assert outcome.shaken.shape == kept[1].shaken.shape
