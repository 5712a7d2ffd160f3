"""Where a misfit lives, what is left of it, and how small it can be."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import DUTY, JOINT, MOTIONS, POSITION, logs, model_of, robot

from bench.diagnosis.joint import views
from bench.diagnosis.joint.diagnosis import SIGNIFICANT, diagnose_joint
from bench.diagnosis.joint.diagnosis import _unexplained as left
from bench.diagnosis.joint.fit import fit
from bench.diagnosis.joint.floor import (
    ENGINE_RAD,
    judged_floor,
    noise_floor,
    same_goals,
    tolerance,
)
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.regimes import (
    EVERYWHERE,
    STRETCH_S,
    localise,
    regimes,
    shares,
    top_speed,
)
from bench.diagnosis.joint.remainder import remainder
from bench.diagnosis.joint.rest import MISFIT, Rest, is_structured, is_worse
from bench.diagnosis.joint.settling import Settled
from bench.diagnosis.joint.views import Views
from bench.diagnosis.noise import Block
from bench.diagnosis.observed import observe
from bench.diagnosis.report.telling import remains
from bench.diagnosis.watch import Watch
from sim.effects import effect
from sim.model import read_model

SIZE_RAD = 0.01
FLOOR_RAD = 0.0005


@pytest.fixture(scope="module")
def model():
    return model_of(logs())


def planted(model, make, which=None):
    """Blocks of positions; ``make(observed, random)`` gives the values [rad]."""
    blocks = {}
    for r, one in enumerate(model.observed):
        samples = one.position
        values = make(one, np.random.default_rng(50 + r))
        assert samples.good.all()
        blocks[r, Kind.POSITION] = Block(samples.t_s, values, np.zeros(len(values)))
    return blocks


def noise(one, random):
    return SIZE_RAD * random.normal(size=len(one.position.t_s))


def velocity(one):
    smooth = np.convolve(np.pad(one.position.value, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
    return np.gradient(smooth, one.position.t_s)


# --- regimes


def test_parts_of_a_motion_are_where_they_say(model):
    fastest = top_speed(model.observed)
    (slow, *_) = model.observed
    parts = regimes(slow, fastest)
    t = slow.position.t_s
    assert parts["first_second"].sum() == (t < t[0] + 1.0).sum()
    assert np.mean(parts["late"]) == pytest.approx(0.25, abs=0.01)
    assert np.abs(velocity(slow)[parts["at_rest"]]).max() <= 0.1 * fastest
    assert parts["at_rest"][:5].all()
    assert not (parts["at_rest"] & parts["high_speed"]).any()
    fast = model.observed[list(MOTIONS).index("fast")]
    assert regimes(fast, fastest)["reversal"].any()


def test_a_reversal_begins_where_the_direction_changes(model):
    fast = model.observed[list(MOTIONS).index("fast")]
    parts = regimes(fast, top_speed(model.observed))
    begins = np.flatnonzero(np.diff(parts["reversal"].astype(int)) == 1) + 1
    sense = np.sign(velocity(fast))
    for k in begins:
        assert sense[k] != sense[k - 12]


def at_reversals(fastest):
    def make(one, random):
        return 0.1 * noise(one, random) + SIZE_RAD * regimes(one, fastest)["reversal"]

    return make


def test_a_misfit_at_reversals_is_found_there(model):
    blocks = planted(model, at_reversals(top_speed(model.observed)))
    places = localise(model.observed, blocks, FLOOR_RAD)
    assert places[0].phase == "reversal"
    assert places[0].p_value < SIGNIFICANT
    assert places[0].share > 0.9
    assert places[0].share > 2.0 * places[0].time_share
    assert shares(places)["reversal"] == places[0].share


def test_a_misfit_at_high_speed_is_not_called_rest(model):
    fastest = top_speed(model.observed)

    def make(one, random):
        return 0.1 * noise(one, random) + SIZE_RAD * regimes(one, fastest)["high_speed"]

    places = {p.phase: p for p in localise(model.observed, planted(model, make), FLOOR_RAD)}
    assert places["high_speed"].p_value < SIGNIFICANT
    assert places["at_rest"].p_value > SIGNIFICANT


def false_alarms(model, make, sets=20):
    """How many of some sets of nothing have a significant place."""
    called = 0
    for seed in range(sets):
        random = np.random.default_rng(seed)
        blocks = planted(model, lambda one, _, random=random: make(one, random))
        places = localise(model.observed, blocks, FLOOR_RAD, seed)
        called += any(p.p_value < SIGNIFICANT for p in places)
    return called


def by_stretch(one, random):
    """Misfits that last as long as what is shuffled."""
    stretch = np.floor(one.position.t_s / STRETCH_S).astype(int)
    return SIZE_RAD * random.normal(size=stretch.max() + 1)[stretch]


def test_misfits_of_whole_stretches_are_nowhere(model):
    assert false_alarms(model, by_stretch) <= 3  # of 20 at 5 %: 98 % of the time


def test_noise_is_nowhere(model):
    assert false_alarms(model, noise) <= 3


def test_nothing_above_the_floor_is_nowhere(model):
    blocks = planted(model, lambda one, random: 0.0 * noise(one, random))
    assert localise(model.observed, blocks, FLOOR_RAD) == []


def test_places_are_the_same_for_the_same_seed(model):
    blocks = planted(model, noise)
    first, again = (localise(model.observed, blocks, FLOOR_RAD, 3) for _ in range(2))
    assert first == again


# --- the rest


def sticking(one, random):
    """Structure a catalogue may lack: goes with direction and position."""
    way = np.tanh(5.0 * velocity(one))
    return 0.2 * noise(one, random) + SIZE_RAD * way * np.cos(2.0 * one.position.value)


def test_a_rest_that_recordings_agree_about_is_structured(model):
    rest = remainder(model, planted(model, sticking))
    assert is_structured(rest, FLOOR_RAD, FLOOR_RAD, ENGINE_RAD)
    assert rest.share > 0.3
    assert rest.agreeing == 1.0
    assert rest.terms[0][0] in ("direction", "velocity")
    assert 0.3 * SIZE_RAD < rest.predicted_rad < SIZE_RAD


@pytest.mark.parametrize(("share", "unexplained"), [(0.95, False), (1.05, True)])
def test_what_is_far_more_than_noise_and_engines_is_unexplained(model, share, unexplained):
    """Though no function of the joint foretells it: a loose weight has a will of its own."""
    rest = remainder(model, planted(model, noise))
    left = share * MISFIT * float(np.hypot(FLOOR_RAD, ENGINE_RAD))
    assert is_structured(rest, left, FLOOR_RAD, ENGINE_RAD) is unexplained


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [(3.0, 3.1, True), (3.0, 2.9, False), (0.5, 0.9, False), (0.5, 1.1, True)],
)
def test_names_that_leave_more_than_none_and_more_than_noise_make_it_worse(before, after, worse):
    noise = tolerance(FLOOR_RAD)
    assert is_worse(before * noise, after * noise, FLOOR_RAD) is worse


@pytest.mark.parametrize(("worse", "verdict"), [(True, "partly_explained"), (False, "explained")])
@pytest.mark.slow
def test_what_names_make_worse_is_not_explained(monkeypatch, worse, verdict):
    monkeypatch.setattr("bench.diagnosis.joint.diagnosis.is_worse", lambda *_: worse)
    stiff = {"gain_error": {"scale": 1.4}}
    fitted, judged = (
        observe(logs(stiff, motions=some), robot(), JOINT) for some in (["fast", "steps"], ["slow"])
    )
    found = diagnose_joint(
        read_model(robot()), robot(), fitted, judged, effects={"gain_error": effect("gain_error")}
    )
    assert [cause.effect for cause in found.diagnosis.causes] == ["gain_error"]
    assert found.diagnosis.verdict == verdict
    assert bool(found.diagnosis.unexplained) is worse


@pytest.mark.parametrize(
    ("registers", "shown"),
    [((POSITION,), False), pytest.param((POSITION, DUTY), True, marks=pytest.mark.slow)],
)
@pytest.mark.slow
def test_a_name_beside_a_rest_is_no_likelier_than_its_part_of_both(monkeypatch, registers, shown):
    """But where a register shows it by itself."""
    stiff = {"gain_error": {"scale": 1.4}}
    told = observe(logs(stiff, ["fast", "steps"], registers), robot(), JOINT)
    chances = []
    for much in (0.0, 1e6):  # rad^2
        monkeypatch.setattr(Rest, "foretold", property(lambda _, much=much: much))
        found = diagnose_joint(
            read_model(robot()), robot(), told, effects={"gain_error": effect("gain_error")}
        )
        (cause,) = found.diagnosis.causes
        chances.append(cause.probability)
    assert chances[0] > 0.5
    assert chances[1] > 0.9 * chances[0] if shown else chances[1] < 1e-6


def test_noise_is_no_structure_however_large(model):
    for size in (1.0, 10.0):
        rest = remainder(model, planted(model, lambda one, random, k=size: k * noise(one, random)))
        assert not is_structured(rest, FLOOR_RAD, FLOOR_RAD, ENGINE_RAD)
        assert rest.share < 0.1


def test_slow_noise_that_recordings_do_not_share_is_no_structure(model):
    """Drifts that are each recording's own."""

    def drift(one, random):
        steps = random.normal(size=len(one.position.t_s))
        wander = np.cumsum(steps) / np.sqrt(len(steps))
        return SIZE_RAD * (wander - wander.mean())

    rest = remainder(model, planted(model, drift))
    assert not is_structured(rest, FLOOR_RAD, FLOOR_RAD, ENGINE_RAD)


def test_a_rest_of_nothing_is_none(model):
    rest = remainder(model, planted(model, lambda one, random: 0.0 * noise(one, random)))
    assert not is_structured(rest, FLOOR_RAD, FLOOR_RAD, ENGINE_RAD)
    assert rest.predicted_rad == 0.0


def test_noise_of_a_single_group_is_no_structure():
    """One group of recordings must not be judged by what was fitted to itself."""
    single = model_of(logs(motions=["fast", "slow"], groups=["one", "one"]))
    rest = remainder(single, planted(single, lambda one, random: 5.0 * noise(one, random)))
    assert rest.share < 0.1
    assert not is_structured(rest, FLOOR_RAD, FLOOR_RAD, ENGINE_RAD)


def test_halves_of_a_single_recording_judge_each_other():
    single = model_of(logs(motions=["fast"]))
    rest = remainder(single, planted(single, lambda one, random: 5.0 * noise(one, random)))
    assert not is_structured(rest, FLOOR_RAD, FLOOR_RAD, ENGINE_RAD)
    assert is_structured(
        remainder(single, planted(single, sticking)), FLOOR_RAD, FLOOR_RAD, ENGINE_RAD
    )


def test_a_rest_that_has_no_place_is_everywhere(model):
    rest = remainder(model, planted(model, sticking))
    quiet = planted(model, lambda one, random: 0.0 * noise(one, random))
    (told,) = left(model, Rest(quiet, rest, True), FLOOR_RAD, 0)
    assert told["where"] == [EVERYWHERE]
    assert remains(told).count("everywhere") == 1


# --- the floor


def test_without_repeats_the_floor_is_rounding(model):
    quantum = model.observed[0].position.quantum
    blocks = planted(model, noise)
    assert noise_floor(model.observed, blocks) == pytest.approx(quantum / np.sqrt(12.0))


def repeats(make):
    recordings = logs(motions=["fast"] * 4, groups=["fast"] * 4)
    model = model_of(recordings)
    return noise_floor(model.observed, planted(model, make))


def test_repeats_that_scatter_raise_the_floor_to_their_spread():
    assert repeats(noise) == pytest.approx(SIZE_RAD, rel=0.1)


def test_what_goes_farther_is_no_repeat_whatever_its_name():
    """An experiment done again, a tenth bolder: what differs is no noise."""
    model = model_of(logs(motions=["fast"] * 2, groups=["fast"] * 2))
    one, other = model.observed
    times, goals = other.goal
    for share, expected in ((1.1, False), (1.02, True)):
        bolder = replace(other, goal=(times, share * goals))
        assert same_goals(one, bolder) is expected
        floor = noise_floor([one, bolder], planted(model, noise))
        rounding = one.position.quantum / np.sqrt(12.0)
        assert bool(floor == pytest.approx(rounding)) is not expected


def test_what_all_repeats_share_is_no_noise():
    def shared(one, random):
        return 0.1 * np.sin(7.0 * one.position.t_s) + noise(one, random)

    assert repeats(shared) == pytest.approx(SIZE_RAD, rel=0.1)


def test_a_floor_of_repeats_is_never_below_rounding():
    quiet = model_of(logs(motions=["fast"] * 2, groups=["fast"] * 2))
    blocks = planted(quiet, lambda one, random: 0.0 * noise(one, random))
    assert noise_floor(quiet.observed, blocks) == pytest.approx(
        quiet.observed[0].position.quantum / np.sqrt(12.0)
    )


@pytest.mark.parametrize(
    ("groups", "scatter", "expected"),
    [
        (("fast", "fast"), 1.0, SIZE_RAD),  # repeats that differ by less than what was fitted
        (("fast", "fast"), 9.0, 3.0 * SIZE_RAD),  # never more
        (("fast", "fast"), 0.0, None),  # rounding
        (("fast", "slow"), 1.0, 3.0 * SIZE_RAD),  # no repeats
    ],
)
def test_where_repeats_judge_the_floor_is_what_they_differ_by(groups, scatter, expected):
    judged = model_of(logs(motions=groups, groups=groups))
    left = planted(judged, lambda one, random: scatter * noise(one, random))
    floor = judged_floor(3.0 * SIZE_RAD, judged.observed, left)
    rounding = judged.observed[0].position.quantum / np.sqrt(12.0)
    assert floor == pytest.approx(expected or rounding, rel=0.15)


@pytest.mark.parametrize("holds_out", [True, False])
def test_a_view_has_the_floor_of_those_that_judge_it(monkeypatch, holds_out):
    """Not where what is held out judges nothing of its own."""
    fitted = model_of(logs(motions=["fast"] * 2, groups=["fast"] * 2))
    before = fit(fitted, Hypothesis(), np.zeros(len(fitted.nuisances)), rounds=1)
    settled = Settled(before, (), (), {}, (), 0.0)
    monkeypatch.setattr(views, "settle", lambda *_: settled)
    monkeypatch.setattr(views, "noise_floor", lambda *_: 0.5)
    own = Views(read_model(robot()), robot(), {}, None, None, Watch(print))
    view = own._with(fitted, before, fitted.observed if holds_out else ())
    assert (view.floor < 0.1) is holds_out
    assert view.floors[Kind.POSITION] == tolerance(view.floor)


def test_two_sound_simulations_may_differ():
    assert tolerance(0.0) == ENGINE_RAD
    assert tolerance(3.0 * ENGINE_RAD) == pytest.approx(np.sqrt(10.0) * ENGINE_RAD)
