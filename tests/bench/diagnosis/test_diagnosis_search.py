"""Which effects: the right one of a few, none on a null; groups stay whole."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pendulum_logs import DUTY, POSITION, logs, model_of

from bench.diagnosis.joint.faint import SURELY
from bench.diagnosis.joint.fit import Fit, bounds, fit
from bench.diagnosis.joint.floor import tolerance
from bench.diagnosis.joint.growing import PLAIN, _holds, _together, grow, ranked
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.remaining import Score
from bench.diagnosis.joint.rivals import (
    AS_GOOD,
    CLOSE,
    NEAR_NATS,
    NONE_LEAST,
    _among,
    contemporaries,
    rivals,
    upright,
)
from bench.diagnosis.joint.screening import (
    CLOSER,
    LIMITS,
    PROMISING,
    limits,
    screen,
    starts,
    stretched,
    vectors_to_try,
    worth_fitting,
)
from bench.diagnosis.joint.search import (
    NEEDED,
    NUMBER_NATS,
    STRAYED,
    Gain,
    Outside,
    folds,
    held_out,
)
from bench.diagnosis.knobs import TWINS, effect_knobs, joint_effects
from bench.diagnosis.running import (
    HELD_OUT_OF,
    LEAST_GROUPS,
    DiagnosisError,
    split,
    without_effects,
)
from sim.effects import effect
from sim.stepped import TICK_S

KNOWN = ("load_friction", "transport_delay", "dead_zone", "torque_limit")
TRUTHS = {
    "load_friction": {"ratio": 0.3},
    "transport_delay": {"delay_s": 0.03},
    "dead_zone": {"margin_rad": 0.015},
}
TRUTHS_TOGETHER = {"dead_zone": {"margin_rad": 0.05}}
EFFECTS = {name: effect(name) for name in KNOWN}


def quiet(_):
    pass


def base_of(model):
    return fit(model, Hypothesis(), np.zeros(len(model.nuisances)))


def grown(truth, registers=(POSITION, DUTY)):
    model = model_of(logs(truth, registers=registers))
    base = base_of(model)
    quantum = model.observed[0].position.quantum
    floors = {kind: noise.total for kind, noise in base.noise.items()}
    floors[Kind.POSITION] = tolerance(quantum / np.sqrt(12.0))
    return model, base, grow(model, base, dict(EFFECTS), quiet, floors, most=2)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == "dead_zone" else pytest.mark.slow) for name in TRUTHS],
)
def test_the_search_names_what_was_planted(name):
    _, base, (found, taken, confirmed) = grown({name: TRUTHS[name]})
    assert found.hypothesis.effects == (name,)
    (gain,) = taken
    assert gain.effect == name
    assert gain.deflated >= NEEDED
    assert gain.held_out.nats > 0.0
    assert found.cost < base.cost - NEEDED
    assert {g.effect for g in confirmed} <= set(KNOWN)


def test_the_search_names_nothing_on_a_null():
    _, base, (found, taken, _) = grown({})
    assert taken == []
    assert found is base


@pytest.mark.slow
def test_rivals_are_on_one_scale():
    model, _, (found, _, confirmed) = grown({"load_friction": TRUTHS["load_friction"]})
    probability, close, fits, without = rivals(
        model, found, "load_friction", EFFECTS, confirmed, quiet
    )
    assert 0.5 < probability <= 1.0
    assert probability + sum(r.probability for r in close) <= 1.0 + 1e-9
    assert [r.behind_nats for r in close] == sorted(r.behind_nats for r in close)
    assert all(r.behind_nats < CLOSE for r in close)
    assert set(fits) == {r.effect for r in close}
    assert without.hypothesis.effects == ()


def test_a_name_that_holds_beside_another_is_not_its_rival(monkeypatch):
    """When the first was taken, the second had been fitted in its place, and gained more."""
    model = model_of(logs(motions=["slow"]))
    first, second = sized("gain_error", 1.0, 100.0), sized("dead_zone", 1.0, 120.0)
    both = first.fit.hypothesis + second.fit.hypothesis.knobs
    monkeypatch.setattr("bench.diagnosis.joint.rivals.drop", lambda *_: (first.fit, first))
    for held, expected in ((both, []), (first.fit.hypothesis, ["dead_zone"])):
        found = SimpleNamespace(hypothesis=held)
        probability, close, *_ = contemporaries(model, found, first, [first, second])
        assert [rival.effect for rival in close] == expected
        assert (probability > 0.5) is (not expected)


def test_a_faint_gain_is_stated_with_less_and_none_with_certainty():
    model = model_of(logs(motions=["slow"]))
    told = [_among(model, sized("gain_error", 0.0, nats), [])[0] for nats in (7.0, 60.0, 1e4)]
    assert told == sorted(told)
    assert told[0] < 0.5
    assert told[2] == pytest.approx(1.0 - NONE_LEAST)


@pytest.mark.parametrize("hardly", [True, False])
def test_a_rival_that_leaves_no_more_than_engines_differ_by_is_close(monkeypatch, hardly):
    """However sure the likelihood is, which counts what repeats."""
    model = model_of(logs(motions=["slow"]))
    named, other = sized("gain_error", 0.0, 1000.0), sized("dead_zone", 0.0, 900.0)
    monkeypatch.setattr("bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: hardly)
    probability, close = _among(model, named, [other])
    assert [rival.effect for rival in close] == (["dead_zone"] if hardly else [])
    assert [rival.behind_nats for rival in close] == ([AS_GOOD] if hardly else [])
    assert (probability < 0.9) is hardly


@pytest.mark.parametrize(("behind", "sure"), [(0.9 * SURELY, False), (1.1 * SURELY, True)])
def test_a_rival_is_asked_as_a_name_is_how_much_it_leaves(monkeypatch, behind, sure):
    """Of what is so far behind that no engines made it, a small trace is enough."""
    asked = []
    monkeypatch.setattr(
        "bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: asked.append(sure)
    )
    named, other = sized("gain_error", 0.0, 1000.0), sized("dead_zone", 0.0, 1000.0 - behind)
    _among(model_of(logs(motions=["slow"])), named, [other])
    assert asked == [sure]


@pytest.mark.parametrize("others", [1, 2, 6])
def test_many_rivals_that_leave_as_little_are_together_as_likely_as_one(monkeypatch, others):
    model = model_of(logs(motions=["slow"]))
    named = sized("gain_error", 0.0, 1000.0)
    amounts = (
        "coulomb_friction",
        "dead_zone",
        "link_mass",
        "punch",
        "supply_voltage",
        "zero_offset",
    )
    names = list(amounts[:others])
    monkeypatch.setattr("bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: True)
    probability, close = _among(model, named, [sized(name, 0.0, 900.0) for name in names])
    assert [rival.effect for rival in close] == names
    alone, _ = _among(model, named, [sized("dead_zone", 0.0, 900.0)])
    assert probability == pytest.approx(alone)
    assert sum(rival.probability for rival in close) == pytest.approx(1 - NONE_LEAST - alone)


@pytest.mark.parametrize(("ahead", "behind"), [(40.0, AS_GOOD), (-30.0, 30.0)])
def test_a_name_that_holds_another_is_never_likelier_than_it(monkeypatch, ahead, behind):
    """It always fits as well; where its numbers agreed, that says nothing for it."""
    model = model_of(logs(motions=["slow"]))
    monkeypatch.setattr("bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: False)
    named = sized("load_friction", 0.0, 300.0)
    other = sized("directional_load_friction", 0.0, 300.0 + ahead)
    probability, close = _among(model, named, [other])
    assert probability > 0.5
    assert [r.behind_nats for r in close] == ([behind] if behind < CLOSE else [])


@pytest.mark.parametrize(
    ("more_nm", "speed_rad_s", "expected"),
    [
        (0.05, 5.0, []),
        (0.05, 0.2, ["stribeck_friction"]),
        (1.0, 0.2, ["stribeck_friction"]),
    ],
)
def test_what_is_the_named_effect_in_other_words_is_no_rival(
    monkeypatch, more_nm, speed_rad_s, expected
):
    """Friction that falls from 5 rad/s on, which is its bound, falls nowhere in slow motions."""
    model = model_of(logs(motions=["slow"]))
    monkeypatch.setattr("bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: True)
    knobs = effect_knobs(effect("stribeck_friction"))
    z = np.append(np.zeros(len(model.nuisances)), [knobs[0].at(more_nm), knobs[1].at(speed_rad_s)])
    other = Gain("stribeck_friction", Fit(Hypothesis(knobs), z, {}, 0.0), 300.0, 1.0)
    for named, names in (("coulomb_friction", expected), ("dead_zone", ["stribeck_friction"])):
        _, close = _among(model, sized(named, 0.0, 320.0), [other])
        assert [rival.effect for rival in close] == names


@pytest.mark.slow
def test_two_names_for_one_thing_are_rivals_of_like_probability():
    """Delay of commands and skew of samples, seen by positions alone."""
    both = {name: effect(name) for name in ("transport_delay", "dead_zone")}
    model = model_of(logs({"transport_delay": {"delay_s": 0.02}}, registers=(POSITION,)))
    base = base_of(model)
    knobs = effect_knobs(effect("transport_delay"))
    found = fit(model, Hypothesis(knobs), np.append(base.z, 1.0), base.noise)
    twin = Gain("read_skew", *_with(model, base, "read_skew"))
    probability, close, _, _ = rivals(model, found, "transport_delay", both, [twin], quiet)
    if close:
        (rival,) = close
        assert rival.effect == "read_skew"
        ratio = np.exp(-0.5 * max(0.0, rival.behind_nats))
        assert rival.probability == pytest.approx(ratio * probability, rel=1e-6)
    else:
        assert probability > 0.8


@pytest.mark.parametrize(
    ("behind", "deeper", "rival"),
    [(0.9 * NEAR_NATS, 0.9 * NEAR_NATS, True), (1.1 * NEAR_NATS, 1.1 * NEAR_NATS, False)],
)
def test_a_rival_not_far_behind_is_begun_from_elsewhere_as_the_name_was(
    monkeypatch, behind, deeper, rival
):
    model = model_of(logs(motions=["slow"]))
    named, other = sized("gain_error", 1.0, 200.0), sized("dead_zone", 1.0, 200.0 - behind)
    other = replace(other, fit=replace(base_of(model), **vars(other.fit)))
    monkeypatch.setattr("bench.diagnosis.joint.rivals.drop", lambda *_: (named.fit, named))
    monkeypatch.setattr("bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: False)
    monkeypatch.setattr(
        "bench.diagnosis.joint.rivals.elsewhere",
        lambda model, found: replace(found, cost=found.cost - deeper),
    )
    _, close, fits, _ = rivals(model, named.fit, "gain_error", EFFECTS, [other], quiet)
    assert [one.effect for one in close] == (["dead_zone"] if rival else [])
    if rival:
        assert close[0].behind_nats == pytest.approx(0.0, abs=1e-9)
        assert fits["dead_zone"].cost == other.fit.cost - deeper


@pytest.mark.parametrize("lies", [True, False])
def test_without_gravity_a_friction_of_load_is_one_with_that_which_is_unlike_both_ways(
    monkeypatch, lies
):
    """No torque comes from outside then, but for inertia, which not every engine counts."""
    model = model_of(logs(motions=["slow"]))
    assert not upright(model)
    monkeypatch.setattr("bench.diagnosis.joint.rivals.upright", lambda _: lies)
    monkeypatch.setattr("bench.diagnosis.joint.rivals.hardly_better", lambda *_, sure: False)
    both = ("directional_load_friction", "load_friction")
    for name, other in (both, both[::-1]):
        some = [sized(other, 0.0, 100.0), sized("dead_zone", 0.0, 100.0)]
        _, close = _among(model, sized(name, 0.0, 300.0), some)
        assert [(r.effect, r.behind_nats) for r in close] == ([(other, AS_GOOD)] if lies else [])


@pytest.mark.parametrize(("sine_nm", "cosine_nm"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])
def test_a_joint_is_upright_where_gravity_does_no_work_in_any_recording(sine_nm, cosine_nm):
    loads = [(0.0, 0.0), (sine_nm, cosine_nm)]
    model = SimpleNamespace(
        nuisances=(),
        observed=loads,
        candidate=lambda hypothesis, z, r: SimpleNamespace(
            load=SimpleNamespace(sine_nm=np.array([loads[r][0]]), cosine_nm=np.array([loads[r][1]]))
        ),
    )
    assert upright(model) is (sine_nm == cosine_nm == 0.0)


@pytest.mark.parametrize(
    ("beside", "rivals_there"),
    [(("transport_delay",), ["directional_load_friction"]), (("gain_error",), [])],
)
def test_what_a_name_was_split_into_beside_the_others_is_its_rival(
    monkeypatch, beside, rivals_there
):
    """It was refused as its numbers agree; the deepest of its fits counts."""
    model = model_of(logs(motions=["slow"]))
    base = base_of(model)

    def of(*names, cost=0.0):
        knobs = tuple(k for name in names for k in effect_knobs(effect(name)))
        z = np.zeros(len(model.nuisances) + len(knobs))
        return replace(base, hypothesis=Hypothesis(knobs), z=z, cost=cost)

    named = Gain("load_friction", of("transport_delay", "load_friction", cost=-300.0), 300.0, 1.0)
    split = [
        Gain(
            "directional_load_friction",
            of(*beside, "directional_load_friction", cost=cost),
            50.0,
            1.0,
        )
        for cost in (-250.0, -310.0)
    ]
    without = of("transport_delay")
    monkeypatch.setattr("bench.diagnosis.joint.rivals.drop", lambda *_: (without, named))
    monkeypatch.setattr("bench.diagnosis.joint.rivals.elsewhere", lambda model, found: found)
    _, close, fits, _ = rivals(model, named.fit, "load_friction", {}, split, quiet)
    assert [one.effect for one in close] == rivals_there
    assert [one.behind_nats for one in close] == [AS_GOOD] * len(rivals_there)
    assert all(fits[name].cost == -310.0 for name in rivals_there)


def _with(model, base, name):
    k = [n.name for n in model.nuisances].index(TWINS[name])
    z = base.z.copy()
    z[k] = 0.0
    found = fit(model, Hypothesis(effect_knobs(effect(name))), np.append(z, 4.0), base.noise)
    return found, base.cost - found.cost, 1.0


# --- the parts of a search


def test_screening_puts_what_was_planted_first():
    model = model_of(logs({"dead_zone": TRUTHS["dead_zone"]}))
    ranking = screen(model, base_of(model), EFFECTS.values())
    gains = [gain for gain, _, _ in ranking]
    assert ranking[0][1] == "dead_zone"
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > NEEDED


@pytest.mark.parametrize("name", sorted(joint_effects()))
def test_an_effect_is_tried_within_its_bounds_and_never_off(name):
    knobs = effect_knobs(effect(name))
    tried = starts(knobs)
    assert tried
    for z in tried:
        assert len(z) == len(knobs)
        assert any(x != 0.0 for x, k in zip(z, knobs, strict=True) if not k.parameter.shape)
    amplitudes = [i for i, k in enumerate(knobs) if not k.parameter.shape]
    if all(knobs[i].bounds[0] < 0.0 for i in amplitudes):  # each alone, either way
        alone = {(i, np.sign(z[i])) for z in tried for i in amplitudes if z[i] != 0.0}
        assert alone == {(i, sign) for i in amplitudes for sign in (-1.0, 1.0)}
        assert all(sum(z[i] != 0.0 for i in amplitudes) == 1 for z in tried)
    else:
        assert all((z[amplitudes] > 0.0).all() for z in tried)


def test_a_twin_is_tried_in_the_place_of_its_nuisance():
    model = model_of(logs({"gain_error": {"scale": 1.2}}))
    base = base_of(model)
    k = [n.name for n in model.nuisances].index("gain")
    knobs = effect_knobs(effect("gain_error"))
    tried = vectors_to_try(model, base, effect("gain_error"), knobs)
    took_over = base.z[k] * model.nuisances[k].deviation
    assert took_over > 0.0
    for z in tried:
        assert z[k] == 0.0
    assert any(knobs[0].value(z[-1]) == pytest.approx(1.0 + took_over) for z in tried)


def test_of_two_that_are_close_the_one_with_fewer_numbers_is_first():
    fitted = SimpleNamespace(hypothesis=Hypothesis(), z=np.zeros(0))
    one = Gain("dead_zone", fitted, 20.0, 1.0)
    two = Gain("stribeck_friction", fitted, 20.0 + 0.9 * NUMBER_NATS, 1.0)
    assert [g.effect for g in ranked([two, one])] == ["dead_zone", "stribeck_friction"]
    far = Gain("stribeck_friction", fitted, 20.0 + 1.1 * NUMBER_NATS, 1.0)
    assert [g.effect for g in ranked([one, far])] == ["stribeck_friction", "dead_zone"]


def sized(name, size, nats):
    hypothesis = Hypothesis(effect_knobs(effect(name)))
    return Gain(name, SimpleNamespace(hypothesis=hypothesis, z=np.array([0.0, size])), nats, 1.0)


def test_of_two_that_are_close_the_likelier_size_comes_first():
    usual, odd = sized("gain_error", 1.0, 100.0), sized("link_mass", 16.0, 103.0)
    assert odd.unlikely - usual.unlikely == pytest.approx(np.log(257.0 / 2.0))
    assert [g.effect for g in ranked([odd, usual])] == ["gain_error", "link_mass"]
    plainly = sized("link_mass", 16.0, 106.0)
    assert [g.effect for g in ranked([usual, plainly])] == ["link_mass", "gain_error"]
    assert sized("gain_error", 0.0, 1.0).unlikely == 0.0


def test_gains_of_a_step_share_one_inflation():
    fitted = SimpleNamespace(hypothesis=Hypothesis(), z=np.zeros(0))
    gains = ranked([Gain("dead_zone", fitted, 30.0, 1.0), Gain("punch", fitted, 40.0, 4.0)])
    assert [g.inflation for g in gains] == pytest.approx([2.0, 2.0])
    assert gains[0].effect == "punch"


def score_of(nats, squares, count=100):
    return Score(nats, {Kind.POSITION: squares}, {Kind.POSITION: count})


def test_held_out_gains_are_in_nats_and_in_squares_of_the_floor():
    floors = {Kind.POSITION: 0.1}
    outside = held_out(
        [score_of(1.0, 3.0), score_of(2.0, 5.0)], [score_of(4.0, 1.0), score_of(2.0, 5.0)], floors
    )
    assert outside.nats == 3.0
    assert outside.relief == pytest.approx(2.0 / 200 / 0.01)
    worse = held_out([score_of(1.0, 3.0)], [score_of(0.0, 4.0)], floors)
    assert worse.nats == -1.0
    assert worse.harm == pytest.approx(1.0 / 100 / 0.01)


def test_a_group_that_the_rest_does_not_tell_how_to_fit_is_judged_by_fits_that_have_seen_it():
    floors = {Kind.POSITION: 0.1}
    seen = [score_of(10.0 * STRAYED, 3.0), score_of(10.0 * STRAYED + 20.0, 1.0)]
    far = [
        replace(score_of(s.nats - 2.0 * STRAYED * k, 90.0), seen=s) for k, s in enumerate(seen, 1)
    ]
    outside = held_out([far[0]], [far[1]], floors)
    assert outside.nats == pytest.approx(20.0)
    assert outside.relief == pytest.approx(2.0 / 100 / 0.01)
    near = [
        replace(score_of(s.nats - 0.5 * STRAYED * k, 90.0), seen=s) for k, s in enumerate(seen, 1)
    ]
    assert held_out([near[0]], [near[1]], floors).nats == pytest.approx(20.0 - 0.5 * STRAYED)


@pytest.mark.parametrize(
    ("gained", "outside", "relief", "holds"),
    [
        (20.0, 5.0, 1.0, True),  # large enough to be seen
        (20.0, 5.0, 0.0, False),
        (20.0, 0.0, 1.0, False),
        (2.0 * PLAIN, PLAIN, 0.0, True),  # plain, however small its trace
        (2.0 * PLAIN, 1.0, 0.0, False),
    ],
)
def test_a_gain_holds_on_groups_left_out_if_it_is_large_there_or_plain(
    gained, outside, relief, holds
):
    gain = Gain("dead_zone", SimpleNamespace(), gained, 1.0)
    assert _holds(replace(gain, held_out=Outside(outside, relief, 0.0))) is holds
    assert not _holds(gain)


@pytest.mark.slow
def test_of_a_set_the_effect_that_gains_nothing_is_left_out_and_the_others_stay():
    model = model_of(logs(TRUTHS_TOGETHER))
    both = Hypothesis(
        tuple(k for n in ("dead_zone", "load_friction") for k in effect_knobs(effect(n)))
    )
    now = fit(model, both, np.append(np.zeros(len(model.nuisances)), [0.5, 0.1]))
    taken = [Gain(name, now, 100.0, 1.0) for name in ("dead_zone", "load_friction")]
    floors = {kind: noise.total for kind, noise in now.noise.items()}
    after, held = _together(model, now, taken, floors)
    assert [gain.effect for gain in held] == ["dead_zone"]
    assert after.hypothesis.effects == ("dead_zone",)
    assert held[0].held_out.nats > 0.0


def test_what_nuisances_need_no_longer_stray_counts_as_it_is():
    gain = Gain("gain_error", SimpleNamespace(), 20.0, 4.0, relief=8.0)
    assert gain.deflated == 11.0
    assert gain.counted(2.0) == 14.0
    model = SimpleNamespace(nuisances=[None, None])
    base = SimpleNamespace(z=np.array([2.0, 1.0]), cost=30.0)
    after = SimpleNamespace(z=np.array([1.0, 0.0, 5.0]), cost=10.0)
    over = Gain("gain_error", after, 0.0, 4.0).over(model, base)
    assert (over.nats, over.relief) == (20.0, 2.0)


# --- groups


def model_with(groups):
    return SimpleNamespace(observed=[SimpleNamespace(group=g) for g in groups])


@pytest.mark.parametrize("groups", [["a"], list("aab"), list("abcabc"), list("abcdefgabcdefg")])
def test_folds_never_split_a_group_and_leave_none_out(groups):
    parts = folds(model_with(groups))
    assert sorted(r for part in parts for r in part) == list(range(len(groups)))
    assert len(parts) == min(4, len(set(groups)))
    for group in set(groups):
        holders = [part for part in parts if any(groups[r] == group for r in part)]
        assert len(holders) == 1


def recording(group, number):
    return SimpleNamespace(metadata={"group": group}, name=f"{group}-{number}")


@pytest.mark.parametrize("count", [3, 4, 7, 12])
def test_what_is_held_out_is_whole_groups(count):
    recordings = [recording(f"g{k:02}", i) for k in range(count) for i in range(3)]
    parts = split(recordings)
    fitted, judging = ({r.metadata["group"] for r in p} for p in (parts.fitted, parts.judging))
    assert not fitted & judging
    assert len(fitted) + len(judging) == count
    assert {r.name for r in (*parts.fitted, *parts.judging)} == {r.name for r in recordings}
    assert len(parts.judging) >= 3
    assert len(judging) <= max(1, -(-count // HELD_OUT_OF))


@pytest.mark.parametrize(("count", "expected"), [(3, {"g1"}), (5, {"g3"}), (9, {"g7", "g3"})])
def test_what_differs_most_is_fitted_and_the_second_of_four_judges(count, expected):
    recordings = [recording(f"g{k}", 0) for k in range(count)]
    parts = split(recordings, {f"g{k}": float(k) for k in range(count)})
    assert {r.metadata["group"] for r in parts.judging} == expected


def test_few_groups_are_all_fitted():
    recordings = [recording(f"g{k}", 0) for k in range(LEAST_GROUPS - 1)]
    assert split(recordings).judging == ()


def test_a_recording_without_a_group_is_its_own():
    recordings = [SimpleNamespace(metadata={}, name=f"r{k}") for k in range(8)]
    parts = split(recordings)
    assert len(parts.judging) == 2


def test_the_split_does_not_hang_on_the_order():
    recordings = [recording(f"g{k}", 0) for k in range(9)]
    names = {r.name for r in split(recordings).judging}
    assert {r.name for r in split(recordings[::-1]).judging} == names


def test_an_effect_taken_out_of_the_catalogue_is_not_tried():
    left = without_effects(["dead_zone", "punch"])
    assert not {"dead_zone", "punch"} & set(left)
    assert len(left) == len(joint_effects()) - 2
    with pytest.raises(DiagnosisError, match="no effect named 'gravity'"):
        without_effects(["gravity"])


def test_an_effect_that_shows_at_a_hundredth_of_its_typical_size_is_screened_there():
    """Of an integral a little is much: it adds up."""
    truth = {"integral_action": {"gain_per_rad_s": 0.03}}
    model = model_of(logs(truth))
    base = base_of(model)
    integral, other = effect("integral_action"), effect("punch")
    (best, name, start), _ = screen(model, base, [integral, other])
    (knob,) = effect_knobs(integral)
    assert name == "integral_action"
    assert best > 0.0
    assert 0.0 < knob.value(float(start[-1])) < 2.0 * 0.03


@pytest.mark.parametrize("margin_rad", [0.006, 0.009])
def test_a_size_between_those_tried_is_screened_where_it_is(margin_rad):
    """4 and 12 mrad are tried."""
    model = model_of(logs({"dead_zone": {"margin_rad": margin_rad}}))
    none = Fit(Hypothesis(), np.zeros(len(model.nuisances)), base_of(model).noise, 0.0)
    ((_, _, start),) = screen(model, none, [effect("dead_zone")])
    (knob,) = effect_knobs(effect("dead_zone"))
    assert knob.value(float(start[-1])) == pytest.approx(margin_rad, rel=0.2)


def test_a_limit_is_screened_between_where_it_does_nothing_and_where_it_does_too_much():
    model = model_of(logs({"torque_limit": {"duty": 0.35}}, motions=("slow", "swell")))
    none = Fit(Hypothesis(), np.zeros(len(model.nuisances)), base_of(model).noise, 0.0)
    ((gain, _, start),) = screen(model, none, [effect("torque_limit")])
    (knob,) = effect_knobs(effect("torque_limit"))
    assert gain > PROMISING
    assert knob.value(float(start[-1])) == pytest.approx(0.35, rel=0.15)


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_a_limit_is_tried_from_the_highest_to_the_lowest_and_closely(name):
    (knob,) = effect_knobs(effect(name))
    tried = limits(knob)
    values = [knob.value(z) for z in tried]
    assert values == sorted(values, reverse=True)
    assert max(values) != knob.parameter.off
    assert min(values) == pytest.approx(knob.parameter.low)
    assert all(1.0 < b / a <= 1.0001 * CLOSER for a, b in itertools.pairwise(tried))


@pytest.mark.parametrize("limit", [0.9, 1.7])
def test_a_speed_is_screened_where_it_is_limited(limit):
    model = model_of(logs({"velocity_limit": {"limit_rad_s": limit}}, motions=("slow", "swell")))
    none = Fit(Hypothesis(), np.zeros(len(model.nuisances)), base_of(model).noise, 0.0)
    ((_, _, start),) = screen(model, none, [effect("velocity_limit")])
    (knob,) = effect_knobs(effect("velocity_limit"))
    assert knob.value(float(start[-1])) == pytest.approx(limit, rel=0.1)


def test_of_many_effects_that_are_alike_more_are_worth_a_fit():
    def rows(*gains):
        return [(gain, f"effect{k}", np.zeros(0)) for k, gain in enumerate(gains)]

    apart = rows(100.0, 50.0, 40.0, 30.0, 20.0, 10.0, 5.0, 4.0, 0.5)
    alike = rows(100.0, 95.0, 90.0, 85.0, 80.0, 75.0, 70.0, 65.0, 45.0)
    none = rows(0.5, 0.4, 0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1)
    assert worth_fitting(apart, 3) == apart[:6]
    assert worth_fitting(alike, 3) == alike[:8]
    assert worth_fitting(none, 3) == none[:3]
    assert worth_fitting(apart, 3, {"effect1", "effect8"}) == [*apart[:6], apart[8]]


@pytest.mark.parametrize("side", [0, 1])
def test_what_a_tolerance_at_its_end_is_a_part_of_is_tried_in_full(side):
    """Many of them together may be near what is hidden, and then no one try promises much."""
    model = model_of(logs(motions=["slow"]))
    ends = bounds(model, Hypothesis())
    z = np.zeros(len(model.nuisances))
    names = [n.name for n in model.nuisances]
    assert stretched(model, Fit(Hypothesis(), z, {}, 0.0)) == set()
    rotor = names.index("rotor_level")
    z[rotor] = ends[side][rotor]
    assert stretched(model, Fit(Hypothesis(), z, {}, 0.0)) == {"rotor_inertia"}


def test_a_time_is_not_screened_below_a_tick_of_the_firmware(monkeypatch):
    monkeypatch.setattr("bench.diagnosis.joint.screening.SIZES", (6.0,))  # all far too great
    model = model_of(logs())
    ((_, _, start),) = screen(model, base_of(model), [effect("transport_delay")])
    (knob,) = effect_knobs(effect("transport_delay"))
    assert knob.value(float(start[-1])) >= TICK_S
