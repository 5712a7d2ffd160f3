"""A joint rests when a recording begins, unless the recording is plainly of one that moves."""

from dataclasses import replace

import numpy as np
import pendulum_logs
import pytest
from pendulum_logs import CONDITION, JOINT, POSITION, logs, recorded, robot

from bench.diagnosis.joint.beginning import begun
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from sim.effects import effect
from sim.model import read_model
from sim.rollout import Batch

SPARSE_S = 0.036  #: of a bus that reads a servo's registers one after another


def begins(pace_s, speed_rad_s, monkeypatch, motion="fast"):
    """The first speed that samples tell of, and the one that is believed [rad/s]."""
    monkeypatch.setattr(pendulum_logs, "REST_S", 0.0)
    made = logs(motions=[motion], speed_rad_s=speed_rad_s, pace_s=pace_s)
    observed = observe(made, robot(), JOINT)
    (believed,) = begun(read_model(robot()), robot(), observed)
    return observed[0].replay.velocity_rad_s, believed.replay.velocity_rad_s


def test_a_joint_that_is_told_to_move_at_once_rests_at_first(monkeypatch):
    told, believed = begins(SPARSE_S, 0.0, monkeypatch)
    assert told > 0.5
    assert believed == 0.0


def test_the_second_goal_of_a_slow_bus_was_not_in_force_before(monkeypatch):
    monkeypatch.setattr(pendulum_logs, "REST_S", 0.0)
    observed = observe(logs(motions=["fast"], pace_s=SPARSE_S), robot(), JOINT)
    (believed,) = begun(read_model(robot()), robot(), observed)
    assert believed.replay.held_rad is None


def test_a_joint_that_moves_in_the_beginning_is_not_at_rest(monkeypatch):
    told, believed = begins(SPARSE_S, -4.0, monkeypatch)
    assert told > 0.0  # of a line through samples that go back and forth
    assert believed < -1.0


def test_what_dense_samples_tell_of_the_first_speed_is_believed(monkeypatch):
    told, believed = begins(0.002, 4.0, monkeypatch)
    assert believed == told == pytest.approx(4.0, rel=0.25)


def test_a_joint_that_rests_is_not_asked_about(monkeypatch):
    monkeypatch.setattr("bench.diagnosis.joint.beginning.JointModel", None)
    (observed,) = observe(logs(motions=["slow"]), robot(), JOINT)
    (found,) = begun(read_model(robot()), robot(), [observed])
    assert found.replay.rests
    assert found.replay.held_rad is None
    assert found.replay.velocity_rad_s == observed.replay.velocity_rad_s == 0.0


GOAL_RAD, FIRST_RAD = 0.7, 0.5


def aside(monkeypatch, *, held, limit_rad_s=None, seconds=1.0):
    """A goal that never changes, and a joint that is aside of it in the beginning."""
    monkeypatch.setitem(pendulum_logs.MOTIONS, "still", lambda _: GOAL_RAD)
    draft = recorded("still", {POSITION: None}, seconds, CONDITION, "still")
    (told,) = observe([draft], robot(), JOINT)
    real = JointModel(read_model(robot()), robot(), [told])
    knobs = effect_knobs(effect("velocity_limit")) if limit_rad_s else ()
    z = np.append(np.zeros(len(real.nuisances)), [k.at(limit_rad_s) for k in knobs])
    one = real.candidate(Hypothesis(knobs), z, 0)
    first = FIRST_RAD if held is None else held
    start = replace(told.replay, position_rad=first, held_rad=GOAL_RAD if held else None)
    angle = Batch([start], 1).run([one], [0])[0][:, 0]
    (seen,) = observe(
        [recorded("still", {POSITION: angle}, seconds, CONDITION, "still")], robot(), JOINT
    )
    (found,) = begun(read_model(robot()), robot(), [seen])
    return found.replay


def at_rest(monkeypatch):
    """Where the goal holds the joint."""
    monkeypatch.setattr(pendulum_logs, "REST_S", 0.0)
    monkeypatch.setitem(pendulum_logs.MOTIONS, "still", lambda _: GOAL_RAD)
    (told,) = observe(
        [recorded("still", {POSITION: None}, 4.0, CONDITION, "still")], robot(), JOINT
    )
    real = JointModel(read_model(robot()), robot(), [told])
    one = real.candidate(Hypothesis(), np.zeros(len(real.nuisances)), 0)
    start = replace(told.replay, position_rad=GOAL_RAD)
    return float(Batch([start], 1).run([one], [0])[0][-1, 0])


def test_a_joint_that_rests_aside_of_its_goal_was_held_there_before(monkeypatch):
    rest = at_rest(monkeypatch)
    assert abs(rest - GOAL_RAD) > 0.02
    for limit in (None, 1.0):
        begins = aside(monkeypatch, held=rest, limit_rad_s=limit)
        assert begins.held_rad == pytest.approx(GOAL_RAD, abs=0.001)
        assert begins.rests


@pytest.mark.parametrize("limit_rad_s", [3.0, 0.5])
def test_a_joint_that_sets_out_for_its_goal_was_not(limit_rad_s, monkeypatch):
    assert aside(monkeypatch, held=None, limit_rad_s=limit_rad_s).held_rad is None
