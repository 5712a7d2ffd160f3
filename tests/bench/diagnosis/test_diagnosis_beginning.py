"""A joint rests when a recording begins, unless the recording is plainly of one that moves."""

import pendulum_logs
import pytest
from pendulum_logs import JOINT, logs, robot

from bench.diagnosis.beginning import begun
from bench.diagnosis.observed import observe
from sim.model import read_model

SPARSE_S = 0.036  #: of a bus that reads a servo's registers one after another


def begins(pace_s, speed_rad_s, monkeypatch, motion="fast"):
    """The first speed that samples tell of, and the one that is believed [rad/s]."""
    monkeypatch.setattr(pendulum_logs, "REST_S", 0.0)
    monkeypatch.setattr(pendulum_logs, "PACE_S", pace_s)
    observed = observe(logs(motions=[motion], speed_rad_s=speed_rad_s), robot(), JOINT)
    (believed,) = begun(read_model(robot()), robot(), observed)
    return observed[0].replay.velocity_rad_s, believed.replay.velocity_rad_s


def test_a_joint_that_is_told_to_move_at_once_rests_at_first(monkeypatch):
    told, believed = begins(SPARSE_S, 0.0, monkeypatch)
    assert told > 0.5
    assert believed == 0.0


def test_a_joint_that_moves_in_the_beginning_is_not_at_rest(monkeypatch):
    told, believed = begins(SPARSE_S, -4.0, monkeypatch)
    assert told > 0.0  # of a line through samples that go back and forth
    assert believed < -1.0


def test_what_dense_samples_tell_of_the_first_speed_is_believed(monkeypatch):
    told, believed = begins(0.002, 4.0, monkeypatch)
    assert believed == told == pytest.approx(4.0, rel=0.25)


def test_a_joint_that_rests_is_not_asked_about(monkeypatch):
    monkeypatch.setattr("bench.diagnosis.beginning.JointModel", None)
    observed = observe(logs(motions=["slow"]), robot(), JOINT)
    assert begun(read_model(robot()), robot(), observed) == observed
