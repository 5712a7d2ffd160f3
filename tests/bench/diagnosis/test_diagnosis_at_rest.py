"""What the duty of a joint at rest says of a name; what names do beside impossible ones."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import DUTY, MOTIONS, POSITION, logs, model_of

from bench.diagnosis.joint import settling, worth
from bench.diagnosis.joint.fit import Fit
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.search import Gain
from bench.diagnosis.joint.settling import BESIDE, Part, _little
from bench.diagnosis.joint.veto import impossible
from bench.diagnosis.joint.worth import REST_S, register_denies, resting
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.noise import Noise
from bench.diagnosis.observed import Channel
from sim.effects import effect

NOISE = {kind: Noise(1e-3, 0.0, 0.1) for kind in Kind}


@pytest.fixture(autouse=True)
def _stairs(monkeypatch):
    monkeypatch.setitem(MOTIONS, "stairs", lambda t: 0.3 * np.floor(t / 1.5))


def held(registers=(POSITION, DUTY)):
    """A joint that stands still for a second before each step."""
    return model_of(logs(motions=["stairs"], registers=registers, duration_s=4.5))


def with_(model, name=None, **values):
    """The robot as believed, with an effect of some size."""
    z = np.zeros(len(model.nuisances))
    if name is None:
        return Fit(Hypothesis(), z, NOISE, 0.0)
    knobs = effect_knobs(effect(name))
    sizes = [knob.at(values[knob.parameter.name]) for knob in knobs]
    return Fit(Hypothesis(knobs), np.append(z, sizes), NOISE, 0.0)


def test_a_joint_rests_once_neither_goal_nor_angle_has_moved_for_a_while():
    (one,) = held().observed
    times, goals = one.goal
    step_s = float(times[1:][np.diff(goals) != 0.0][0])
    before, after = np.array([step_s - 0.02]), np.array([step_s + 0.9 * REST_S])
    assert resting(one, before).tolist() == [True]
    assert resting(one, after).tolist() == [False]
    assert not resting(one, one.position.t_s[:5]).any()
    samples = one.position
    creeping = replace(samples, value=samples.value + 0.1 * samples.t_s)
    creeps = replace(one, channels={**one.channels, Channel.POSITION: creeping})
    assert not resting(creeps, before).any()
    (moving,) = model_of(logs(motions=["fast"], registers=(POSITION, DUTY))).observed
    assert not resting(moving, moving.position.t_s).any()


@pytest.mark.parametrize(("scale", "denied"), [(0.5, True), (1.0, False)])
def test_a_gain_that_a_joint_at_rest_does_not_have_is_denied(scale, denied, monkeypatch):
    """However much better the duty is in motion with it."""
    model = held()
    monkeypatch.setattr(worth, "mean_square", lambda *_: 1.0)
    gain = with_(model, "gain_error", scale=scale)
    assert register_denies([model], with_(model), gain) is denied
    assert not register_denies([model], gain, with_(model))


def test_a_duty_that_was_read_where_it_is_judged_alone_denies_as_well(monkeypatch):
    model, judge = held(registers=(POSITION,)), held()
    monkeypatch.setattr(worth, "mean_square", lambda *_: 1.0)
    gain = with_(model, "gain_error", scale=0.5)
    assert register_denies([model, judge], with_(model), gain)


def test_without_a_duty_nothing_is_said_of_joints_at_rest():
    model = held(registers=(POSITION,))
    assert not register_denies([model], with_(model), with_(model, "gain_error", scale=0.5))


@pytest.mark.parametrize(("scale", "little"), [(0.3, True), (0.1, False)])
def test_what_impossible_sizes_do_in_its_place_does_not_make_a_name_little(
    scale, little, monkeypatch
):
    model = held()
    without = with_(model, "gain_error", scale=scale)
    assert impossible(model, without) is not little
    monkeypatch.setattr(settling, "explains_little", lambda *_: True)
    monkeypatch.setattr(settling, "shown", lambda *_: False)
    monkeypatch.setattr(settling, "rms_of", lambda _, found: 1.0 if found is None else 0.1)
    monkeypatch.setattr(settling, "rest_of", lambda *_: type("Rest", (), {"structured": True}))
    after = with_(model, "acceleration_limit", limit_rad_s2=3.0)
    gain = Gain("acceleration_limit", after, 100.0, 1.0)
    denied = _little(model, model, None, after, [Part(gain, without, gain)], 1e-3)
    assert (denied is not None and denied.because == BESIDE) is little


@pytest.mark.parametrize(
    ("left_rad", "structured", "shows", "believed"),
    [
        (0.0145, True, False, False),  # half of the squares, and ten times what is no physics
        (0.0120, True, False, True),  # a third of them
        (0.0145, True, True, True),
        (0.0145, False, False, True),
    ],
)
def test_names_that_leave_much_of_a_misfit_are_neighbours_of_what_has_no_name(
    left_rad, structured, shows, believed, monkeypatch
):
    model = held()
    monkeypatch.setattr(settling, "explains_little", lambda *_: False)
    monkeypatch.setattr(settling, "shown", lambda *_: shows)
    monkeypatch.setattr(settling, "rms_of", lambda _, found: left_rad if found else 0.02)
    rest = type("Rest", (), {"structured": structured})
    monkeypatch.setattr(settling, "rest_of", lambda *_: rest)
    after = with_(model, "transport_delay", delay_s=0.01)
    gain = Gain("transport_delay", after, 100.0, 1.0)
    denied = _little(model, model, None, after, [Part(gain, with_(model), gain)], 1e-3)
    assert (denied is None) is believed


def test_what_names_leave_of_a_small_misfit_may_be_two_engines(monkeypatch):
    model = held()
    monkeypatch.setattr(settling, "explains_little", lambda *_: False)
    monkeypatch.setattr(settling, "shown", lambda *_: False)
    monkeypatch.setattr(settling, "rms_of", lambda _, found: 0.003 if found else 0.004)
    monkeypatch.setattr(settling, "rest_of", lambda *_: type("Rest", (), {"structured": True}))
    after = with_(model, "transport_delay", delay_s=0.01)
    gain = Gain("transport_delay", after, 100.0, 1.0)
    parts = [Part(gain, with_(model), gain)]
    assert _little(model, model, None, after, parts, 1e-3) is None
