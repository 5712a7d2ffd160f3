"""How sure a number is said to be: states, sandwich variance, chances."""

import numpy as np
import pytest

from bench.diagnosis.joint.confidence import (
    BLIND,
    NORMAL,
    STRETCH_S,
    TRADED,
    WIDE,
    estimate,
    sandwich,
    state,
    stretches,
)
from bench.diagnosis.joint.rivals import NONE_FAINT, NONE_LEAST, chances
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.result import LEAST_PART, Cause, Rival, beside_rest, verdict_of
from sim.effects import effect

(KNOB,) = effect_knobs(effect("viscous_friction"))
LOW, HIGH = KNOB.bounds
INSIDE = 0.5 * (LOW + HIGH)


def said(at=INSIDE, deviation=0.1, variance=0.01, alike=0.0, nuisance="zero"):
    between = alike * np.sqrt(variance)
    believed = np.array([[1.0, between], [between, variance]])
    return state(np.array([0.0, at]), 1, deviation, KNOB, believed, [nuisance, KNOB.name])


def test_a_number_that_data_holds_is_pinned():
    assert said() == "pinned"


@pytest.mark.parametrize(("more", "word"), [(-1e-3, "pinned"), (1e-3, "flat")])
def test_a_number_is_flat_when_its_deviation_is_wide_beside_its_size(more, word):
    assert said(deviation=(WIDE + more) * max(1.0, abs(INSIDE))) == word


@pytest.mark.parametrize("at", [LOW, HIGH])
def test_a_number_at_an_end_of_what_it_may_be_is_at_bound(at):
    assert said(at=at) == "at bound"


def test_what_nothing_depends_on_is_dead_however_narrow_it_is_said_to_be():
    assert said(variance=2.0 * BLIND) == "dead"


def test_two_numbers_that_stand_for_each_other_are_a_trade_off_by_name():
    assert said(alike=TRADED + 0.01) == "trade-off with zero"
    assert said(alike=-TRADED - 0.01) == "trade-off with zero"
    assert said(alike=TRADED - 0.01) == "pinned"
    assert said(alike=TRADED + 0.01, nuisance="") == "pinned", "it is held"


def test_an_interval_ends_at_the_bounds_and_in_order():
    told = estimate(KNOB, INSIDE, (HIGH + 1.0, LOW - 1.0), "pinned")
    assert told.ci95 == tuple(sorted((KNOB.value(LOW), KNOB.value(HIGH))))
    assert told.value == KNOB.value(INSIDE)


@pytest.mark.parametrize(("said", "value"), [("dead", KNOB.value(0.0)), ("flat", KNOB.value(1e-9))])
def test_a_dead_number_that_was_not_moved_is_off(said, value):
    assert estimate(KNOB, 1e-9, (LOW, HIGH), said).value == value
    assert estimate(KNOB, INSIDE, (LOW, HIGH), said).value == KNOB.value(INSIDE)


def test_stretches_never_reach_over_two_blocks():
    times = np.array([0.0, 0.4 * STRETCH_S, 1.2 * STRETCH_S])
    assert stretches([times, times]).tolist() == [0, 0, 1, 2, 2, 3]


def test_scores_that_agree_within_a_stretch_widen_the_variance_and_independent_ones_do_not():
    random = np.random.default_rng(0)
    count, long = 4000, 20
    alone = random.standard_normal((count, 1))
    together = np.repeat(alone[: count // long], long, axis=0)
    cluster = np.repeat(np.arange(count // long), long)
    believed, prior = np.array([[1.0 / count]]), np.zeros(1)
    few = NORMAL * np.sqrt(2.0 * long / count)
    assert sandwich(believed, alone, cluster, prior) == pytest.approx(believed, rel=few)
    assert sandwich(believed, together, cluster, prior) == pytest.approx(long * believed, rel=few)


def test_a_prior_alone_keeps_the_variance_it_states():
    nothing = np.zeros((10, 1))
    found = sandwich(np.eye(1), nothing, np.arange(10), np.ones(1))
    assert found == pytest.approx(np.eye(1))


def test_chances_leave_something_to_what_is_in_no_catalogue():
    sure, others = chances(1e3, {})
    assert sure == pytest.approx(1.0 - NONE_LEAST)
    assert others == {}
    own, others = chances(1e3, {"equal": 0.0, "ahead": -5.0, "far": 1e3})
    assert own == others["equal"] == others["ahead"]
    assert own + sum(others.values()) == pytest.approx(1.0 - NONE_LEAST)
    assert others["far"] == pytest.approx(0.0)


def test_what_gains_nothing_is_as_likely_as_no_effect_at_all():
    own, _ = chances(0.0, {})
    assert own == pytest.approx(0.5 * (1.0 - NONE_LEAST - NONE_FAINT))


@pytest.mark.parametrize(
    ("named", "left", "verdict"),
    [
        (False, False, "consistent"),
        (True, False, "explained"),
        (True, True, "partly_explained"),
        (False, True, "unexplained"),
    ],
)
def test_a_verdict_says_what_is_named_and_whether_something_is_left(named, left, verdict):
    assert verdict_of(named, left) == verdict


@pytest.mark.parametrize(
    ("explained", "left", "shown", "part"),
    [
        (0.9, 0.0, 0.0, 1.0),
        (0.6, 0.2, 0.0, 0.75),
        (0.3, 0.7, 0.0, 0.3),
        (0.0, 0.3, 0.0, LEAST_PART / (LEAST_PART + 0.3)),
        (-0.5, 0.0, 0.0, 1.0),
        (0.3, 0.7, 0.9, 0.9),  # of another register it takes more
        (0.6, 0.2, 0.7, 0.75),
    ],
)
def test_a_cause_beside_a_rest_is_no_likelier_than_its_part_of_both(explained, left, shown, part):
    rival = Rival("dead_zone", ("arm",), 0.1, 3.0)
    cause = beside_rest(
        Cause("punch", ("arm",), {}, 50.0, explained, 0.8, (rival,)), 2.0 * left, 2.0, shown
    )
    assert cause.probability == pytest.approx(0.8 * part)
    (other,) = cause.indistinguishable_from
    assert other.probability == pytest.approx(0.1 * part)
    assert cause.explained_share == explained
