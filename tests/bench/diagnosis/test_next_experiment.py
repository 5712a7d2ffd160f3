"""Which experiment is proposed where a cause has rivals."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pendulum_logs import logs, model_of

from bench.diagnosis.joint import next_experiment as proposing
from bench.diagnosis.joint.faint import SHARED
from bench.diagnosis.joint.fit import Fit, estimate_noise, fit
from bench.diagnosis.joint.floor import engines_rad
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.next_experiment import (
    ASKED,
    BOLDER,
    GAINS,
    SURE,
    Contest,
    adapted,
    follows,
    information,
    menu,
    most_telling,
    next_experiments,
    told_by,
)
from bench.diagnosis.joint.rivals import CLOSE
from bench.diagnosis.knobs import effect_knobs
from bench.motions import MOTIONS as MENU
from sim.drive import fields
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
    choices = menu(small)
    as_loaded = [c for c in choices if (c.plan.payload_kg, c.plan.payload_at_m) == (0.15, 0.1)]
    assert {choice.plan.motion.name for choice in as_loaded} == set(MENU)
    assert len(as_loaded) == len(MENU) * len(GAINS)
    for choice in choices:
        t = choice.observed.replay.events[:, 0]
        assert (np.diff(t) >= 0.0).all()


def test_no_experiment_goes_beyond_what_the_joint_may(small):
    """Bolder than what was recorded each time, it would be there after a few."""
    free = {choice.plan.motion.amplitude_rad for choice in menu(small)}
    held = JointModel(small.base.clamped({"arm": (-1.3, 1.1)}), small.robot, small.observed)
    for choice in menu(held):
        moves = choice.plan.motion
        assert moves.amplitude_rad < min(free)
        assert moves.center_rad - moves.amplitude_rad >= -1.3
        assert moves.center_rad + moves.amplitude_rad <= 1.1
    tight = JointModel(small.base.clamped({"arm": (-0.5, 0.5)}), small.robot, small.observed)
    (reached,) = {choice.plan.motion.amplitude_rad for choice in menu(tight)}
    assert reached == pytest.approx(min(free) / BOLDER), "where it was, it may go"


def held_at(choice, model):
    """Duty [1] that holds the arm away from where it hangs, from the experiment's own replay."""
    with_duty = Hypothesis()
    z = np.zeros(len(model.nuisances))
    return np.abs(model.of([choice.observed]).duty(with_duty, z, 0)[1][-1])


def test_a_weight_may_hang_elsewhere_or_not_at_all(small):
    held = [c for c in menu(small) if c.plan.motion.name == "hold"]
    gain = small.observed[0].registers.get("position_p_gain")
    held = [c for c in held if c.plan.registers.get("position_p_gain") == gain]
    (before,) = [c for c in held if (c.plan.payload_kg, c.plan.payload_at_m) == (0.15, 0.1)]
    (nearer,) = [c for c in held if (c.plan.payload_kg, c.plan.payload_at_m) == (0.15, 0.05)]
    (off,) = [c for c in held if c.plan.payload_kg == 0.0]
    duty = [held_at(choice, small) for choice in (before, nearer, off)]
    assert duty[0] > 1.2 * duty[1] > 1.4 * duty[2] > 0.0


def test_a_weight_that_was_off_need_not_be_taken_off(small):
    off, on = (
        replace(small.observed[0], condition={"payload_kg": kg, "payload_at_m": 0.08})
        for kg in (0.0, 0.2)
    )
    choices = menu(small.of([off, on]))
    plans = {(c.plan.payload_kg, c.plan.payload_at_m) for c in choices}
    assert plans == {(0.0, 0.08), (0.2, 0.08), (0.2, 0.04)}
    assert len(choices) == len(MENU) * (2 * len(GAINS) + 1)


def test_a_rig_without_a_weight_has_none_to_hang_elsewhere(small):
    bare = small.of([replace(small.observed[0], condition={"payload_kg": 0.0})])
    assert len(menu(bare)) == len(MENU) * len(GAINS)


@pytest.fixture(scope="module")
def wide():
    """A joint that does not answer within a margin of 0.015 rad, seen in one slow motion."""
    model = model_of(logs({"dead_zone": {"margin_rad": 0.015}}, motions=["slow"], noise_rad=1e-4))

    def fitted(name):
        hypothesis = Hypothesis(effect_knobs(effect(name)))
        start = np.append(np.zeros(len(model.nuisances)), np.ones(len(hypothesis.knobs)))
        return fit(model, hypothesis, start)

    names = ("dead_zone", "transport_delay", "coulomb_friction")
    return SimpleNamespace(model=model, **{name: fitted(name) for name in names})


def test_an_experiment_is_proposed_for_every_rival_and_tells_its_power(wide):
    rivals = {"transport_delay": wide.transport_delay}
    (one,) = next_experiments(wide.model, wide.dead_zone, rivals, 1.0)
    assert set(one.separates) == {"dead_zone", "transport_delay"}
    assert 0.9 < one.power <= 1.0
    json.dumps(one.arguments, allow_nan=False)
    assert next_experiments(wide.model, wide.dead_zone, {}, 1.0) == []


@pytest.mark.slow
def test_what_is_the_same_is_told_apart_by_nothing(wide):
    (one,) = next_experiments(wide.model, wide.dead_zone, {"dead_zone": wide.dead_zone}, 1.0)
    assert one.power < 0.65


@pytest.mark.slow
def test_less_certain_data_has_less_power(wide, monkeypatch):
    monkeypatch.setattr(proposing, "menu", lambda model: menu(model)[:4])
    rivals = {"transport_delay": wide.transport_delay}
    sure, unsure = (
        next_experiments(wide.model, wide.dead_zone, rivals, inflation)[0].power
        for inflation in (1.0, 1e6)
    )
    assert 0.5 <= unsure < 0.6 < sure


def test_a_rival_follows_as_far_as_recordings_let_it():
    apart, tangent = np.array([3.0, 4.0, 0.0]), np.array([[3.0], [4.0], [0.0]])
    assert adapted(apart, tangent, np.array([[1e12]])) == pytest.approx(5.0)
    assert adapted(apart, tangent, np.array([[1e-9]])) == pytest.approx(0.0, abs=1e-3)
    # where both know as much, half way is best: a quarter of the square here, a quarter there
    assert adapted(apart, tangent, np.array([[25.0]])) == pytest.approx(5.0 / np.sqrt(2.0))
    assert adapted(apart, np.array([[0.0], [0.0], [1.0]]), np.eye(1)) == pytest.approx(5.0)
    # and what has gone half way already is where it stays
    way = follows(0.5 * apart, tangent, np.array([[25.0]]), np.array([0.5]))
    assert way == pytest.approx(np.zeros(1))


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


def contest(model, named, other, known=None, inflation=1.0):
    imagined = model.of([choice.observed for choice in menu(model)[:3]])
    known = information(model, other) if known is None else known
    return Contest(model, imagined, named, other, known, inflation)


def test_what_two_make_of_a_joint_that_is_let_go_tells_nothing(small):
    """It falls from where it was, and comes to rest elsewhere if friction is a little more."""
    named, other = fit_at(small, "coulomb_friction", 3.0), fit_at(small, "dead_zone", 0.0)
    ramp = next(c.observed for c in menu(small) if c.plan.motion.name == "slow_ramp")
    off = np.insert(ramp.replay.events, 1, [0.001, fields.ENABLED, 0.0], axis=0)
    limp = replace(ramp, replay=replace(ramp.replay, events=off))
    everything = information(small, other) * 1e6  # the rival cannot follow
    driven, falling = (
        Contest(small, small.of([one]), named, other, everything, 1.0) for one in (ramp, limp)
    )
    (ours,), (theirs,) = (
        falling.imagined.residuals(fit.hypothesis, [fit.z]) for fit in (named, other)
    )
    assert np.abs(ours[0, Kind.POSITION].value - theirs[0, Kind.POSITION].value).max() > 0.02
    assert falling.promised(0) < 0.5 < 2.0 < driven.promised(0)
    assert falling.fitted(0) < 0.5


def test_an_experiment_is_imagined_as_what_is_named_has_it(small):
    named, other = fit_at(small, "dead_zone", 2.0), fit_at(small, "transport_delay", 2.0)
    held = contest(small, named, other)
    as_recorded = small.of([held.shown(r) for r in range(3)])
    (own,) = as_recorded.residuals(named.hypothesis, [named.z])
    assert max(np.abs(block.value).max() for block in own.values()) < 1e-9
    (theirs,) = as_recorded.residuals(other.hypothesis, [other.z])
    assert max(np.abs(block.value).max() for block in theirs.values()) > 1e-3


def test_a_rival_follows_in_an_experiment_unless_it_is_held(small):
    named, other = fit_at(small, "dead_zone", 2.0), fit_at(small, "dead_zone", 1.0)
    count = len(other.z)
    (held, still) = contest(small, named, other, 1e9 * np.eye(count))._followed(0)
    (free, left) = contest(small, named, other, 1e-6 * np.eye(count))._followed(0)
    assert held == pytest.approx(other.z, abs=1e-2)
    assert free[-1] == pytest.approx(2.0, abs=0.2)
    assert left < 0.1 * still
    # what it costs to go there counts
    own = 5.0 * np.diag(np.arange(count) == count - 1) + 1e-6 * np.eye(count)
    (way, cost) = contest(small, named, other, own)._followed(1)
    assert cost > 2.5 * (way[-1] - 1.0) ** 2 > 1.0


def test_a_rival_stays_where_every_step_would_take_it_farther_off(small, monkeypatch):
    named, other = fit_at(small, "dead_zone", 2.0), fit_at(small, "dead_zone", 1.9)
    astray = np.append(np.zeros(len(small.nuisances)), -1.8)
    monkeypatch.setattr(proposing, "follows", lambda *_: astray)
    (z, _) = contest(small, named, other)._followed(0)
    assert z == pytest.approx(other.z)


def test_contests_know_what_recordings_say_of_their_rival(wide, monkeypatch):
    held = []

    class Watched(Contest):
        def promised(self, r):
            held.append((self.other, self.known))
            return 0.0

        def fitted(self, r):
            return 0.0

    monkeypatch.setattr(proposing, "Contest", Watched)
    next_experiments(wide.model, wide.dead_zone, {"delay": wide.transport_delay}, 1.0)
    assert {id(other) for other, _ in held} == {id(wide.transport_delay)}
    assert held[0][1] == pytest.approx(information(wide.model, wide.transport_delay))


def test_recordings_that_there_are_hold_a_rival_that_is_fitted_to_another(wide):
    less = replace(wide.dead_zone, z=wide.dead_zone.z.copy())
    less.z[-1] = 0.0
    same = contest(wide.model, wide.dead_zone, wide.dead_zone).fitted(0)
    # of a joint without a margin, recordings of one with it say that it is none
    assert same < 0.3
    assert contest(wide.model, less, wide.dead_zone).fitted(0) > same + 1.0


def test_what_recordings_cost_a_rival_that_has_followed_counts(wide, monkeypatch):
    less, gone = (replace(wide.dead_zone, z=wide.dead_zone.z.copy()) for _ in range(2))
    less.z[-1], gone.z[-1] = 0.0, 0.01
    monkeypatch.setattr(proposing, "told_by", lambda _: dict.fromkeys(Kind, 1e-9))
    monkeypatch.setattr(proposing, "least_squares", lambda *_: gone.z)
    held = contest(wide.model, less, wide.dead_zone)
    costs = [held._cost(wide.model, z) for z in (wide.dead_zone.z, gone.z)]
    assert costs[1] - costs[0] > 10.0
    assert held.fitted(0) ** 2 > 2.0 * (costs[1] - costs[0])


def test_deviations_are_those_of_nats_or_of_what_can_be_seen_whichever_is_less(monkeypatch):
    enough = {Kind.POSITION: 0.002, Kind.VOLTAGE: 0.1}
    monkeypatch.setattr(proposing, "told_by", lambda _: enough)
    held = Contest(None, None, None, None, None, 2.0)

    def apart(position, voltage):
        sizes = {Kind.POSITION: position, Kind.VOLTAGE: voltage}
        return {(0, kind): SimpleNamespace(value=np.array([x, -x])) for kind, x in sizes.items()}

    assert held._deviations(9.0, apart(1.0, 0.0)) == pytest.approx(3.0)
    assert held._deviations(1e9, apart(0.002, 0.0)) == pytest.approx(np.sqrt(2.0 * CLOSE))
    assert held._deviations(1e9, apart(0.0, 0.2)) == pytest.approx(2.0 * np.sqrt(2.0 * CLOSE))
    assert held._deviations(-1.0, apart(1.0, 1.0)) == 0.0


def test_only_what_promises_most_is_asked_and_no_more_once_one_is_enough():
    asked = []

    def ask(rival, r):
        asked.append((rival, r))
        return {1: 1.0, 3: SURE + 1.0, 0: 9.0}[r]

    promised = {"backlash": [6.0, 9.0, 1.0, 7.0], "punch": [6.0, 9.0, 9.0, 8.0]}
    (one,) = most_telling(promised, ask)
    assert asked == [("backlash", 1), ("punch", 1), ("backlash", 3), ("punch", 3)]
    assert one[:2] == (3, ("backlash", "punch"))
    enough = {"backlash": [SURE, 9.0, 1.0], "punch": [SURE, 1.0, 9.0]}
    assert [one[:2] for one in most_telling(enough)] == [(0, ("backlash", "punch"))]
    many = {"backlash": list(np.linspace(4.0, 3.0, 50))}
    asked.clear()
    monotone = most_telling(many, lambda rival, r: asked.append(r) or 0.1 * r)
    assert asked == list(range(ASKED))
    assert monotone[0][0] == ASKED - 1


@pytest.mark.slow
def test_an_experiment_for_several_rivals_is_no_surer_than_the_best_for_one(wide, monkeypatch):
    monkeypatch.setattr(proposing, "menu", lambda model: menu(model)[:8])
    monkeypatch.setattr(proposing, "SURE", np.inf)  # beyond, no better one is looked for
    rivals = {name: getattr(wide, name) for name in ("transport_delay", "coulomb_friction")}
    first, *_ = next_experiments(wide.model, wide.dead_zone, rivals, 1.0)
    assert set(first.separates) == {"dead_zone", *rivals}
    alone = [
        next_experiments(wide.model, wide.dead_zone, {name: rival}, 1.0)[0].power
        for name, rival in rivals.items()
    ]
    assert 0.5 < first.power <= min(alone)


def test_the_more_groups_there_are_the_more_another_must_show():
    some = model_of(logs(motions=["slow", "fast", "steps"]))
    assert told_by(some)[Kind.POSITION] == pytest.approx(engines_rad(some) * np.sqrt(4 * SHARED))
