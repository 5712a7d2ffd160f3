"""Which experiment is proposed where a cause has rivals."""

import json
from statistics import NormalDist

import numpy as np
import pytest
from pendulum_logs import logs, model_of

from bench.diagnosis.joint import next_experiment as proposing
from bench.diagnosis.joint.faint import ONCE, SHARED
from bench.diagnosis.joint.fit import Fit, estimate_noise, linearise
from bench.diagnosis.joint.floor import engines_rad
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.next_experiment import (
    GAINS,
    adapted,
    information,
    menu,
    most_telling,
    next_experiments,
    told_by,
)
from bench.diagnosis.knobs import effect_knobs
from bench.motions import MOTIONS as MENU
from sim.effects import effect


@pytest.fixture(scope="module")
def small():
    return model_of(logs(motions=["slow"]))


def fit_at(model, name, z):
    knobs = effect_knobs(effect(name))
    vector = np.append(np.zeros(len(model.nuisances)), z)
    hypothesis = Hypothesis(knobs)
    blocks = model.residuals(hypothesis, [vector])[0]
    return Fit(hypothesis, vector, estimate_noise(model, blocks), 0.0)


def test_the_menu_has_every_motion_at_every_gain(small):
    plans = [choice.plan for choice in menu(small)]
    assert {plan.motion.name for plan in plans} == set(MENU)
    assert len(plans) == len(MENU) * len(GAINS)
    for choice in menu(small):
        t = choice.observed.replay.events[:, 0]
        assert (np.diff(t) >= 0.0).all()


def test_an_experiment_is_proposed_for_every_rival_and_tells_its_power(small):
    named, other = fit_at(small, "dead_zone", 2.0), fit_at(small, "transport_delay", 2.0)
    (one,) = next_experiments(small, named, {"transport_delay": other}, 1.0)
    assert set(one.separates) == {"dead_zone", "transport_delay"}
    assert 0.9 < one.power <= 1.0
    json.dumps(one.arguments, allow_nan=False)
    assert next_experiments(small, named, {}, 1.0) == []


def test_what_is_the_same_is_told_apart_by_nothing(small):
    named = fit_at(small, "dead_zone", 2.0)
    (one,) = next_experiments(small, named, {"dead_zone": named}, 1.0)
    assert one.power == pytest.approx(0.5)


def test_less_certain_data_has_less_power(small):
    named, other = fit_at(small, "dead_zone", 0.3), fit_at(small, "dead_zone", 0.25)
    sure, unsure = (
        next_experiments(small, named, {"punch": other}, inflation)[0].power
        for inflation in (1.0, 25.0)
    )
    assert 0.5 <= unsure < sure


def test_a_rival_follows_as_far_as_recordings_let_it():
    apart, tangent = np.array([3.0, 4.0, 0.0]), np.array([[3.0], [4.0], [0.0]])
    assert adapted(apart, tangent, np.array([[1e12]])) == pytest.approx(5.0)
    assert adapted(apart, tangent, np.array([[1e-9]])) == pytest.approx(0.0, abs=1e-3)
    # where both know as much, half way is best: a quarter of the square here, a quarter there
    assert adapted(apart, tangent, np.array([[25.0]])) == pytest.approx(5.0 / np.sqrt(2.0))
    assert adapted(apart, np.array([[0.0], [0.0], [1.0]]), np.eye(1)) == pytest.approx(5.0)


def test_first_comes_what_tells_all_rivals_apart_then_what_is_better_for_one():
    apart = {"backlash": [1.0, 4.5, 2.0], "dead_zone": [4.0, 0.5, 2.0], "punch": [5.0, 4.6, 4.6]}
    first, *more = most_telling(apart)
    assert first[:2] == (2, ("backlash", "dead_zone", "punch"))
    assert first[2] == pytest.approx(0.8413447)  # of two deviations
    assert [one[:2] for one in more] == [(1, ("backlash",)), (0, ("dead_zone",)), (0, ("punch",))]
    assert more[0][2] > first[2]


def test_what_recordings_say_of_a_fit_is_added_to_what_was_believed(small):
    found = fit_at(small, "dead_zone", 2.0)
    known = information(small, found)
    own = np.diag(known)
    assert (own[:-1] >= 1.0).all()
    assert own[:-1].min() == pytest.approx(1.0)  # of what a motion does not show
    assert own[-1] > 25.0
    with_more = model_of(logs(motions=["slow", "fast"]))
    assert np.diag(information(with_more, found))[-1] > own[-1]


def test_it_is_the_rival_that_follows_what_is_named(small, monkeypatch):
    named, other = fit_at(small, "dead_zone", 2.0), fit_at(small, "transport_delay", 2.0)
    moved, held = [], []

    def watched(model, hypothesis, *rest):
        moved.append(hypothesis)
        return linearise(model, hypothesis, *rest)

    def measured(apart, tangents, known):
        held.append(known)
        return adapted(apart, tangents, known)

    monkeypatch.setattr(proposing, "linearise", watched)
    monkeypatch.setattr(proposing, "adapted", measured)
    next_experiments(small, named, {"transport_delay": other}, 1.0)
    assert set(moved) == {other.hypothesis}
    assert np.array(held) == pytest.approx(np.array([information(small, other)] * len(held)))


def test_an_experiment_for_several_rivals_is_no_surer_than_the_best_for_one(small):
    named, less = fit_at(small, "dead_zone", 2.0), fit_at(small, "dead_zone", 1.9)
    other = fit_at(small, "transport_delay", 2.0)
    rivals = {"less": less, "transport_delay": other}
    first, *_ = next_experiments(small, named, rivals, 1.0)
    assert set(first.separates) == {"dead_zone", "transport_delay"}
    alone = [next_experiments(small, named, {n: fit}, 1.0)[0].power for n, fit in rivals.items()]
    assert 0.5 < first.power <= min(alone) < max(alone)


def test_two_that_differ_by_less_than_sound_simulations_do_are_hardly_told_apart(
    small, monkeypatch
):
    named, other = fit_at(small, "dead_zone", 2.0), fit_at(small, "transport_delay", 2.0)
    enough = told_by(small)
    assert enough[Kind.POSITION] == pytest.approx(engines_rad(small) * np.sqrt(ONCE))
    powers = []
    for times in (1.0, 1000.0):
        some = {kind: times * rms for kind, rms in enough.items()}
        monkeypatch.setattr(proposing, "told_by", lambda _, some=some: some)
        powers.append(next_experiments(small, named, {"transport_delay": other}, 1.0)[0].power)
    assert 0.5 < powers[1] < 0.7 < powers[0]


def test_the_more_groups_there_are_the_more_another_must_show():
    some = model_of(logs(motions=["slow", "fast", "steps"]))
    assert told_by(some)[Kind.POSITION] == pytest.approx(engines_rad(some) * np.sqrt(4 * SHARED))


def test_what_it_costs_a_rival_to_follow_counts_and_no_way_makes_it_farther(small, monkeypatch):
    named, other = fit_at(small, "dead_zone", 0.3), fit_at(small, "dead_zone", 0.25)
    held = np.zeros((len(other.z), len(other.z)))
    monkeypatch.setattr(proposing, "information", lambda *_: held)
    monkeypatch.setattr(proposing, "told_by", lambda _: dict.fromkeys(Kind, 1e-9))
    monkeypatch.setattr(proposing, "menu", lambda model: menu(model)[:1])

    def square(step, inflation=1.0):
        way = np.append(np.zeros(len(small.nuisances)), step)
        monkeypatch.setattr(proposing, "follows", lambda *_: way)
        (one,) = next_experiments(small, named, {"other": other}, inflation)
        return (2.0 * NormalDist().inv_cdf(one.power)) ** 2

    free = square(0.025)
    assert 0.0 < free < square(0.0)
    assert square(-0.2) == square(0.0)
    held[-1, -1] = 0.5 * free / 0.025**2
    assert square(0.025) == pytest.approx(1.5 * free)
    assert square(0.025, 4.0) == pytest.approx(1.5 * free / 4.0)
