"""A servo that lets go: seen where a recording breaks with its model, found with its numbers."""

import numpy as np
import pytest
from pendulum_logs import DUTY, POSITION, logs, model_of

from bench.diagnosis.joint.fit import bounds, fit
from bench.diagnosis.joint.intervals import Spread
from bench.diagnosis.joint.limp import LASTING, LETS_GO, breaks_s, overloads, silences
from bench.diagnosis.joint.model import Hypothesis
from bench.diagnosis.joint.screening import screen, vectors_to_try
from bench.diagnosis.joint.search import confirm
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.noise import Block
from sim.effects import effect

TRUTH = {"duty": 0.2, "time_s": 0.3}
LETTING_GO = effect(LETS_GO)
KNOBS = effect_knobs(LETTING_GO)


def block_of(values):
    return Block(0.01 * np.arange(len(values)), values, np.zeros(len(values)))


def noise(size, count, seed=0):
    return size * np.random.default_rng(seed).normal(size=count)


def test_a_recording_breaks_where_it_is_lastingly_far_from_its_model():
    blocks = {r: block_of(noise(0.001, 500, r)) for r in range(3)}
    blocks[1].value[300:] += 0.1
    blocks[2].value[100 : 100 + LASTING - 1] += 0.1  # a transient
    assert breaks_s(blocks) == {1: pytest.approx(3.0)}


@pytest.mark.parametrize(
    "values", [noise(0.001, 500), noise(0.001, LASTING - 1), np.zeros(500), noise(0.1, 500) + 5.0]
)
def test_a_recording_that_is_alike_all_along_does_not_break(values):
    assert breaks_s({0: block_of(values)}) == {}
    assert breaks_s({}) == {}


@pytest.fixture(scope="module")
def limp():
    """A model of recordings in some of which the servo let go, and the believed fit."""
    model = model_of(logs({LETS_GO: TRUTH}, registers=(POSITION,)))
    return model, fit(model, Hypothesis(), np.zeros(len(model.nuisances)))


def test_what_would_trip_where_recordings_break_is_near_the_truth(limp):
    model, _ = limp
    tried = overloads(model, Hypothesis(), np.zeros(len(model.nuisances)), KNOBS)
    values = np.array([[k.value(z) for k, z in zip(KNOBS, x, strict=True)] for x in tried])
    away = np.abs(values / list(TRUTH.values()) - 1.0).max(axis=1)
    assert away.min() < 0.2


def test_a_duty_register_falls_silent_when_its_servo_lets_go_whatever_the_motion_is_off():
    model = model_of(logs({LETS_GO: TRUTH}, registers=(POSITION, DUTY)))
    z = np.zeros(len(model.nuisances))
    z[[n.name for n in model.nuisances].index("payload")] = 2.0
    found = silences(model, Hypothesis(), z)
    assert found
    for at_s, t_s, sizes in found:
        before = (t_s > at_s - TRUTH["time_s"] + 0.02) & (t_s <= at_s)
        assert (sizes[before] > 0.99 * TRUTH["duty"]).all()
        assert not sizes[t_s > at_s].any()


@pytest.mark.parametrize("how", [{}, {"limp_s": 1.0}])
def test_a_duty_that_goes_on_or_that_was_switched_off_is_no_silence(how):
    model = model_of(logs(registers=(POSITION, DUTY), **how))
    assert silences(model, Hypothesis(), np.zeros(len(model.nuisances))) == []


def test_nothing_is_tried_where_no_recording_breaks():
    model = model_of(logs(registers=(POSITION,)))
    assert overloads(model, Hypothesis(), np.zeros(len(model.nuisances)), KNOBS) == []


def test_the_overload_is_found_with_its_numbers(limp):
    model, base = limp
    gain, name, start = screen(model, base, [LETTING_GO, effect("torque_limit")])[0]
    assert name == LETS_GO
    assert gain > 100.0
    found = confirm(model, base, LETTING_GO, start).fit
    values = [k.value(z) for k, z in zip(KNOBS, found.z[len(model.nuisances) :], strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=0.1)


def test_effects_are_tried_with_nuisances_as_believed_where_these_went_as_far_as_they_may(limp):
    model, base = limp
    count = len(model.nuisances)
    assert (np.abs(base.z) >= bounds(model, Hypothesis())[1] - 1e-3).any()
    tried = vectors_to_try(model, base, LETTING_GO, KNOBS)
    stands_in = np.array([n.stands_in for n in model.nuisances])
    assert any((x[:count][stands_in] == 0.0).all() for x in tried)
    near = fit(model, Hypothesis(), np.zeros(count), base.noise, rounds=1, evaluations=0)
    tried = vectors_to_try(model, near, effect("punch"), effect_knobs(effect("punch")))
    assert len(tried) == len({x[count:].tobytes() for x in tried})


def test_a_threshold_that_is_never_reached_is_not_seen_by_steps():
    model = model_of(logs(motions=["slow"], registers=(POSITION,)))
    hypothesis = Hypothesis(KNOBS)
    z = np.append(np.zeros(len(model.nuisances)), [1.0, 0.0])
    still = fit(model, hypothesis, z, rounds=1, evaluations=0)
    own = len(model.nuisances)
    assert not Spread(model, still).seen_by_steps([own])
