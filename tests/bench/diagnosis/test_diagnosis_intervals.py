"""Intervals, fits that leave their first hollow, and what speaks against a name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pendulum_logs import DUTY, POSITION, VOLTS, logs, model_of, robot

from bench.diagnosis.joint import intervals, settling, valleys, worth
from bench.diagnosis.joint.confidence import NORMAL
from bench.diagnosis.joint.fit import Fit, fit
from bench.diagnosis.joint.intervals import (
    FALL,
    REACH,
    Spread,
    _inverse,
    estimates,
    interval,
    may_be_nothing,
)
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.nuisances import LATE_S
from bench.diagnosis.joint.search import HELD_OUT, NEEDED, Gain, Outside
from bench.diagnosis.joint.settling import (
    ALONE,
    BESIDE,
    BETTER,
    HARMFUL,
    NOTHING,
    SPOILT,
    _denied,
    _faint,
    _little,
    _objected,
    _parts,
    _unsure,
)
from bench.diagnosis.joint.valleys import (
    DEEPER,
    LATE,
    STRAYED,
    afresh,
    elsewhere,
    explore,
    retimed,
    strayed,
)
from bench.diagnosis.joint.veto import as_plainer, largest_step, objection
from bench.diagnosis.joint.worth import FARTHER, explained, explains_little, shown
from bench.diagnosis.knobs import effect_knobs, joint_effects, of_drive
from bench.diagnosis.observed import Channel
from sim.effects import effect
from sim.model import read_model
from sim.stepped import TICK_S

EVERY = joint_effects()
DRAG = {"stiffness_nm_rad": 0.1, "rest_rad": 0.6}


def fitted(name, truth, start, planted=None):
    model = model_of(logs({planted or name: truth}))
    hypothesis = Hypothesis(effect_knobs(effect(name)))
    z = np.append(np.zeros(len(model.nuisances)), start)
    return model, fit(model, hypothesis, z)


def gain_of(name, found, nats=100.0):
    return Gain(name, found, nats, 1.0)


@pytest.fixture(scope="module")
def cable():
    """A cable's drag, fitted from near the truth."""
    return fitted("cable_drag", DRAG, [5.0, 0.6])


def test_a_fit_in_a_wrong_hollow_finds_its_way_out(cable):
    model, near = cable
    count = len(model.nuisances)
    wrong = near.z.copy()
    wrong[count:] *= (0.4, 2.4)  # the same pull in the middle, another spring
    stuck = Fit(near.hypothesis, wrong, near.noise, 0.0)
    stuck = fit(model, stuck.hypothesis, wrong, near.noise, rounds=1, evaluations=1)
    out = explore(model, stuck, "cable_drag")
    assert out.cost <= stuck.cost
    assert out.cost - near.cost < 0.1 * (stuck.cost - near.cost)


def test_an_effect_of_one_number_is_left_as_it_is():
    model, found = fitted("gain_error", {"scale": 1.3}, [3.0])
    assert explore(model, found, "gain_error") is found


def test_a_time_that_late_samples_make_up_for_finds_its_way_out():
    delay_s = 0.0104
    model, near = fitted("transport_delay", {"delay_s": delay_s}, [delay_s / 0.02])
    (knob,), count = near.hypothesis.knobs, len(model.nuisances)
    late = near.z.copy()
    late[count] = knob.at(delay_s + 0.006)
    late[[n.name for n in model.nuisances].index("sampling")] = 2.0
    stuck = fit(model, near.hypothesis, late, near.noise, rounds=1, evaluations=2, held=[count])
    out = retimed(model, stuck)
    assert stuck.cost > near.cost + 1000.0
    assert out.cost < near.cost + LATE
    assert knob.value(float(out.z[count])) == pytest.approx(delay_s, abs=0.0021)
    assert retimed(model, out) is out  # what is as good within a few nats moves nothing


@pytest.fixture(scope="module")
def rubbing():
    """Friction that grows with load, and the best fit without it: nuisances have strayed."""
    model = model_of(logs({"load_friction": {"ratio": 0.4}}))
    base = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    assert strayed(model, base)
    return model, base


def test_a_fit_begun_where_nuisances_have_strayed_is_begun_afresh(rubbing):
    model, base = rubbing
    knobs = effect_knobs(effect("load_friction"))
    among = np.append(base.z, 0.1)
    stuck = fit(model, Hypothesis(knobs), among, base.noise, rounds=1, evaluations=1)
    out = afresh(model, base, stuck, "load_friction")
    assert out.cost < stuck.cost - DEEPER
    assert knobs[0].value(float(out.z[-1])) == pytest.approx(0.4, rel=0.05)
    assert not strayed(model, out)


def test_a_fit_that_is_deeper_than_one_begun_afresh_is_kept(rubbing):
    model, base = rubbing
    found = fit(model, Hypothesis(effect_knobs(effect("load_friction"))), np.append(base.z, 1.0))
    deep = replace(found, cost=found.cost - 100.0)
    assert afresh(model, base, deep, "load_friction") is deep


def test_nothing_is_begun_afresh_where_nuisances_are_about_as_believed(rubbing, monkeypatch):
    model, base = rubbing
    near = replace(base, z=0.5 * STRAYED * np.sign(base.z))
    monkeypatch.setattr(valleys, "fit", None)
    assert afresh(model, near, base, "load_friction") is base


def test_a_fit_is_begun_with_more_and_less_friction_and_the_deepest_is_kept(rubbing, monkeypatch):
    model, base = rubbing
    begun = []

    def tried(model, hypothesis, start):
        begun.append(start)
        return replace(base, z=start, cost=base.cost - gained[len(begun) - 1])

    monkeypatch.setattr(valleys, "fit", tried)
    gained = [0.0, 2.0 * DEEPER, 0.9 * DEEPER, 1.5 * DEEPER]
    out = elsewhere(model, base)
    assert out.cost == base.cost - 2.0 * DEEPER
    assert out.z is begun[1]
    own = [[n.name for n in model.nuisances].index(name) for name in valleys.FRICTION]
    count = len(model.nuisances)
    signs = np.sign([start[own] for start in begun]).tolist()
    assert sorted(signs) == [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]
    for start in begun:
        assert not np.delete(start[:count], own).any()
        assert (start[count:] == base.z[count:]).all()
    begun.clear()
    gained = [0.9 * DEEPER] * 4
    assert elsewhere(model, base) is base


def test_intervals_hold_the_truth(cable):
    model, found = cable
    told = estimates(model, found, "cable_drag")
    for name, value in DRAG.items():
        low, high = told[name].ci95
        assert low <= value <= high
    assert told["stiffness_nm_rad"].ci95[0] > 0.0  # it says that there is one


def test_a_size_is_never_surer_than_two_engines_are_of_it(monkeypatch):
    model, found = fitted("gain_error", {"scale": 1.3}, [3.0])
    monkeypatch.setattr(intervals, "ENGINES_SHARE", 0.3)
    low, high = estimates(model, found, "gain_error")["scale"].ci95
    assert 0.5 * (high - low) == pytest.approx(NORMAL * 0.3 * 0.3, rel=0.1)


def test_a_delay_is_never_surer_than_where_in_their_ticks_firmwares_are():
    model, found = fitted("transport_delay", {"delay_s": 0.006}, [1.0])
    low, high = estimates(model, found, "transport_delay")["delay_s"].ci95
    assert 0.5 * (high - low) >= NORMAL * TICK_S / np.sqrt(3.0)
    assert low < 0.006 < high


def test_few_recordings_leave_a_number_less_sure_than_many(cable):
    model, found = cable
    spread = Spread(model, found)
    apart = np.diag(spread.sandwich(spread.recordings))
    free = np.diag(spread.believed) > 0.0  # the levels of a rigid gear are idle
    assert (np.diag(spread.between_recordings())[free] > apart[free]).all()


def test_a_variance_is_no_less_than_any_of_its_parts(cable):
    spread = Spread(*cable)
    total = spread.variances()
    engines = spread.between_engines()
    assert (np.diag(engines)[-2:] > 0.0).all()
    for part in (spread.believed, spread.between_recordings()):
        assert (total >= np.diag(part + engines) - 1e-15).all()


def test_the_widest_account_says_how_sure_numbers_are_together():
    """A valley: of two numbers only the sum is known."""
    spread = Spread.__new__(Spread)
    spread.found = SimpleNamespace(z=np.array([0.0, 1.0, 1.0]))
    of_sum = np.eye(3) - 0.999 * np.array([[0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]])
    spread.believed = of_sum
    spread.accounts = (of_sum, 0.5 * of_sum)
    assert spread.doubt([1, 2]) == pytest.approx(1.0)
    spread.accounts = (of_sum, 2.0 * np.eye(3))
    assert spread.doubt([1, 2]) == pytest.approx(2.0 / 0.001)
    assert spread.doubt([1]) == pytest.approx(2.0)


def test_a_number_that_no_step_shows_is_not_known():
    believed = _inverse(np.diag([1.0, 1e-9]) + np.array([[0.0, 1e-7], [1e-7, 0.0]]))
    assert believed[0, 0] == pytest.approx(1.0, rel=0.1)
    assert believed[1, 1] > 1e8


def test_an_interval_ends_where_the_number_does():
    model, found = fitted("torque_limit", {"duty": 0.6}, [1.0])
    spread = Spread(model, found)
    wide = np.full(len(found.z), 1e6)
    k = len(found.z) - 1
    low, high = interval(model, found, spread, wide, k)
    assert (low, high) == found.hypothesis.knobs[0].bounds


def test_a_bound_that_the_likelihood_excludes_is_no_end(cable):
    """The formula's end is beyond nothing at all; recordings know that there is something."""
    model, found = cable
    spread = Spread(model, found)
    k = len(found.z) - 2
    wide = spread.variances()
    wide[k] = (0.6 * found.z[k]) ** 2
    low, high = interval(model, found, spread, wide, k)
    assert found.z[k] - NORMAL * np.sqrt(wide[k]) < 0.0 < low < found.z[k] < high
    without = fit(model, Hypothesis(), found.z[:-2])
    nats = (without.cost - found.cost) * spread.believed[k, k] / wide[k]
    assert low == pytest.approx(found.z[k] * (1.0 - np.sqrt(FALL / nats)), rel=0.05)


def test_an_interval_is_never_narrower_than_its_variance_nor_wider_than_was_looked_at(cable):
    model, found = cable
    spread = Spread(model, found)
    variances = spread.variances()
    for k in (len(found.z) - 2, len(found.z) - 1):
        half = NORMAL * np.sqrt(variances[k])
        low, high = interval(model, found, spread, variances, k)
        least, most = found.hypothesis.knobs[k - len(model.nuisances)].bounds
        assert low <= max(least, found.z[k] - half) + 1e-12
        assert high >= min(most, found.z[k] + half) - 1e-12
        assert low >= found.z[k] - REACH[-1] * half - 1e-12
        assert high <= found.z[k] + REACH[-1] * half + 1e-12


# -- what speaks against a name -------------------------------------------------------------------


def with_numbers(name, values, motions=("slow",)):
    knobs = effect_knobs(effect(name))
    model = model_of(logs(motions=motions))
    z = np.append(np.zeros(len(model.nuisances)), values)
    return model, Fit(Hypothesis(knobs), z, {}, 0.0)


def test_a_size_that_nothing_has_speaks_against_a_name():
    (knob,) = effect_knobs(effect("load_friction"))
    model, found = with_numbers("load_friction", [knob.bounds[1]])
    why = objection(model, found, gain_of("load_friction", found), EVERY)
    assert "not plausible" in why
    model, found = with_numbers("load_friction", [0.5 * knob.bounds[1]])
    assert objection(model, found, gain_of("load_friction", found), EVERY) is None


@pytest.mark.parametrize(
    ("name", "speaks"), [("coulomb_friction", True), ("viscous_friction", False)]
)
def test_a_gear_has_dry_friction_and_may_have_no_other(name, speaks):
    drive = read_model(robot()).joints[0].drive
    knobs = effect_knobs(of_drive(EVERY, drive)[name])
    model = model_of(logs(motions=("slow",)))
    z = np.append(np.zeros(len(model.nuisances)), knobs[0].bounds[0])
    found = Fit(Hypothesis(knobs), z, {}, 0.0)
    assert (objection(model, found, gain_of(name, found), EVERY) is not None) is speaks


def test_nothing_speaks_against_an_effect_that_is_off_or_against_its_shape():
    knobs = effect_knobs(effect("cable_drag"))
    values = [0.0, knobs[1].bounds[1]]
    model, found = with_numbers("cable_drag", values)
    assert objection(model, found, gain_of("cable_drag", found), EVERY) is None


def test_a_wave_of_less_than_half_a_turn_is_none():
    knobs = effect_knobs(effect("encoder_nonlinearity"))
    for periods, speaks in ((knobs[1].parameter.low, True), (0.8, False)):
        numbers = [1.0, knobs[1].at(periods), 0.0]
        model, found = with_numbers("encoder_nonlinearity", numbers)
        why = objection(model, found, gain_of("encoder_nonlinearity", found), EVERY)
        assert (why is not None) is speaks


def test_a_limit_of_the_duty_that_its_register_shows_more_than_is_denied():
    model, found = fitted("torque_limit", {"duty": 0.4}, [1.5])
    gain = gain_of("torque_limit", found)
    assert objection(model, found, gain, EVERY) is None
    shown = max(np.abs(o.channels[Channel.DUTY].value).max() for o in model.observed)
    assert shown == pytest.approx(0.4, abs=0.002)
    knob = found.hypothesis.knobs[-1]
    for limit in (0.3, 0.38):
        lower = replace(found, z=np.append(found.z[:-1], knob.at(limit)))
        why = objection(model, lower, gain, EVERY)
        assert f"{limit:g} of full duty" in why
        assert "shows up to 0.4" in why


def test_a_limit_of_speed_that_no_step_of_a_goal_takes_long_at_is_none():
    (knob,) = effect_knobs(effect("velocity_limit"))
    for motions, speaks in ((("swell",), True), (("steps",), False)):
        model, found = with_numbers("velocity_limit", [knob.at(40.0)], motions)
        steps = [largest_step(one) / 40.0 for one in model.observed]
        assert (max(steps) < LATE_S) is speaks
        why = objection(model, found, gain_of("velocity_limit", found), EVERY)
        assert (why is not None) is speaks


def test_what_is_written_first_is_no_step_of_a_goal():
    times, goals = np.array([0.0, 0.001, 0.2, 0.21]), np.array([0.0, 0.9, 0.95, 0.93])
    assert largest_step(SimpleNamespace(goal=(times, goals))) == pytest.approx(0.05)


@pytest.mark.parametrize(("limit", "speaks"), [(900.0, True), (60.0, False)])
def test_a_limit_of_acceleration_beyond_what_a_servo_can_is_none(limit, speaks):
    (knob,) = effect_knobs(effect("acceleration_limit"))
    model, found = with_numbers("acceleration_limit", [knob.at(limit)])  # it can 313 rad/s^2
    why = objection(model, found, gain_of("acceleration_limit", found), EVERY)
    assert (why is not None) is speaks


def test_a_limit_is_not_denied_where_no_register_of_the_duty_was_read():
    model = model_of(logs({"torque_limit": {"duty": 0.4}}, registers=(POSITION,)))
    knobs = effect_knobs(effect("torque_limit"))
    found = Fit(
        Hypothesis(knobs), np.append(np.zeros(len(model.nuisances)), knobs[0].at(0.3)), {}, 0.0
    )
    assert objection(model, found, gain_of("torque_limit", found), EVERY) is None


@pytest.mark.parametrize(
    ("truth", "speaks"),
    [({"driving": 0.3, "backdriving": 0.3}, True), ({"driving": 0.1, "backdriving": 0.6}, False)],
)
def test_two_numbers_that_agree_are_one(truth, speaks):
    name = "directional_load_friction"
    model, found = fitted(name, truth, [1.0, 1.0])
    assert (objection(model, found, gain_of(name, found), EVERY) is not None) is speaks


@pytest.mark.parametrize(
    ("planted", "truth", "speaks"),
    [
        ("coulomb_friction", {"more_nm": 0.06}, True),
        ("stribeck_friction", {"stribeck_nm": 0.06, "velocity_rad_s": 0.2}, False),
    ],
)
def test_what_is_no_more_than_a_plainer_effect_is_not_named_for_it(planted, truth, speaks):
    name = "stribeck_friction"
    model, found = fitted(name, truth, [2.0, 0.0], planted)
    fewer = {n: e for n, e in EVERY.items() if n != "coulomb_friction"}
    for effects in (EVERY, fewer):
        why = objection(model, found, gain_of(name, found), effects)
        assert (why is not None) is speaks


def test_an_effect_whose_numbers_agree_goes_on_as_the_plainer_one_from_there():
    name, plain = "directional_load_friction", "load_friction"
    model, found = fitted(name, {"driving": 0.3, "backdriving": 0.3}, [1.0, 1.0])
    after, gain = as_plainer(model, found, name, effect(plain))
    assert (after.hypothesis.effects, gain.effect) == ((plain,), plain)
    assert after.hypothesis.knobs[-1].value(after.z[-1]) == pytest.approx(0.3, rel=0.05)
    assert after.cost < found.cost + 5.0
    assert gain.deflated > NEEDED


def test_numbers_that_agree_are_no_reason_against_a_name_as_a_rival():
    name = "directional_load_friction"
    model, found = fitted(name, {"driving": 0.3, "backdriving": 0.3}, [1.0, 1.0])
    denied = _objected(model, found, found, [gain_of(name, found)], EVERY, needed=0.0)
    assert not denied.refuted
    (knob,) = effect_knobs(effect("load_friction"))
    model, found = with_numbers("load_friction", [knob.bounds[1]])
    gain = gain_of("load_friction", found)
    assert _objected(model, found, found, [gain], EVERY, needed=0.0).refuted


def test_what_explains_far_less_than_a_name_taken_back_is_not_named():
    model, found = with_numbers("load_friction", [0.1])
    gain, before = gain_of("load_friction", found), replace(found, cost=found.cost + 20.0)
    assert _objected(model, before, found, [gain], EVERY, needed=10.0) is None
    denied = _objected(model, before, found, [gain], EVERY, needed=30.0)
    assert denied.because == BETTER


def test_names_together_take_the_place_of_one_taken_back():
    """The first of two gains little by itself, before the other is beside it."""
    model, found = with_numbers("load_friction", [0.1])
    before = replace(found, cost=found.cost + 20.0)
    gains = [gain_of("load_friction", found, nats=nats) for nats in (5.0, 15.0)]
    assert _objected(model, before, found, gains, EVERY, needed=10.0) is None


@pytest.mark.parametrize(("ratio", "unsure"), [(0.0, True), (0.3, False)])
def test_a_size_that_may_as_well_be_nothing_is_no_name(ratio, unsure):
    model, found = fitted("load_friction", {"ratio": ratio}, [0.05])
    parts = _parts(model, found, [gain_of("load_friction", found)], print)
    denied = _unsure(model, found, parts, {})
    assert (denied is not None) is unsure
    if denied is not None:
        assert denied.because == NOTHING
        assert not denied.again


@pytest.mark.parametrize(("nats", "because"), [(0.5 * HELD_OUT, ALONE), (20.0, None)])
def test_the_last_name_that_is_left_must_gain_on_recordings_left_out_as_well(nats, because):
    model, found = fitted("load_friction", {"ratio": 0.3}, [0.05])
    gain = replace(gain_of("load_friction", found), held_out=Outside(nats, 1.0, 0.0))
    denied = _unsure(model, found, _parts(model, found, [gain], print), {})
    assert (denied.because if denied else None) == because


@pytest.mark.parametrize(("ratio", "nothing"), [(0.0, True), (0.3, False)])
def test_an_interval_that_holds_nothing_is_no_name_however_much_is_gained(
    ratio, nothing, monkeypatch
):
    monkeypatch.setattr("bench.diagnosis.joint.settling.SURE", 0.0)
    model, found = fitted("load_friction", {"ratio": ratio}, [0.05])
    parts = _parts(model, found, [gain_of("load_friction", found)], print)
    denied = _unsure(model, found, parts, {})
    assert (denied is not None) is nothing
    assert denied is None or denied.because == NOTHING


@pytest.mark.parametrize(
    ("name", "fall", "nothing"),
    [
        ("viscous_friction", 0.9 * FALL, True),
        ("viscous_friction", 1.1 * FALL, False),
        ("transport_delay", 1e6, True),  # where in their ticks firmwares are, no likelihood knows
    ],
)
def test_a_size_is_not_nothing_where_the_likelihood_falls_though_variances_are_wide(
    monkeypatch, name, fall, nothing
):
    """They do not know that what could stand in for it has gone as far as it may."""
    model, found = with_numbers(name, [0.1])
    k = len(model.nuisances)
    variances = np.ones(k + 1)
    spread = SimpleNamespace(variances=lambda: variances, believed=0.25 * np.eye(k + 1))
    asked = []

    def off(model, hypothesis, start, noise, rounds, held):
        asked.append((float(start[k]), held))
        return replace(found, cost=found.cost + 4.0 * fall)  # variances are four times as wide

    monkeypatch.setattr(intervals, "fit", off)
    assert may_be_nothing(model, found, spread, name) is nothing
    assert asked == ([] if name == "transport_delay" else [(0.0, [k])])


@pytest.mark.parametrize(
    ("there", "spoilt", "harmful"),
    [(0.3, SPOILT, False), (0.0, SPOILT, True), (0.0, 4.0, False)],
)
def test_a_name_that_spoils_other_recordings_is_taken_back(there, spoilt, harmful, monkeypatch):
    monkeypatch.setattr("bench.diagnosis.joint.settling.SPOILT", spoilt)
    model, found = fitted("load_friction", {"ratio": 0.3}, [3.0])
    judge = model_of(logs({"load_friction": {"ratio": there}}))
    floors = {Kind.POSITION: 0.002}
    parts = _parts(model, found, [gain_of("load_friction", found)], print)
    denied = _denied(model, judge, found, parts, floors)
    assert (denied is not None) is harmful
    assert denied is None or denied.because == HARMFUL


def test_what_could_not_be_explained_is_explained_by_nobody():
    model, found = fitted("load_friction", {"ratio": 0.3}, [3.0])
    without = fit(model, Hypothesis(), found.z[:-1])
    assert explained([model], without, without, found, 0.001) > 0.9
    assert explained([model], without, without, found, 1.0) == 0.0


def test_a_name_that_explains_little_is_taken_back_only_where_much_is_left():
    planted = {"dead_zone": {"margin_rad": 0.05}, "load_friction": {"ratio": 0.05}}
    model = model_of(logs(planted))
    before = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    hypothesis = Hypothesis(effect_knobs(effect("load_friction")))
    after = fit(model, hypothesis, np.append(before.z, 0.5))
    gain = gain_of("load_friction", after)
    floor = model.observed[0].position.quantum / np.sqrt(12.0)
    parts = _parts(model, after, [gain], print)
    denied = _little(model, model, before, after, parts, floor)
    assert denied.because == BESIDE
    assert _little(model, model, before, after, parts, 1.0) is None
    assert _little(model, model, before, after, [], floor) is None


@pytest.mark.parametrize("registers", [(POSITION, DUTY, VOLTS), (POSITION, DUTY)])
def test_a_name_that_a_register_shows_is_kept_however_little_it_moves(registers):
    planted = {"dead_zone": {"margin_rad": 0.05}, "voltage_sag": {"resistance_ohm": 1.0}}
    model = model_of(logs(planted, registers=registers))
    before = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    sag = Hypothesis(effect_knobs(effect("voltage_sag")))
    after = fit(model, sag, np.append(before.z, 3.0))
    parts = _parts(model, after, [gain_of("voltage_sag", after)], print)
    floor = model.observed[0].position.quantum / np.sqrt(12.0)
    told = VOLTS in registers
    assert explains_little([model], before, parts[0].without, after, floor)
    assert shown([model], parts[0].without, after) is told
    assert (_little(model, model, before, after, parts, floor) is None) is told


@pytest.mark.parametrize(
    ("was", "missing", "left", "little"),
    [
        (1.0, 1.0, 0.9, True),  # little of all, and less than is left
        (1.0, 0.20, 0.05, False),  # another took most: of the rest it is most
        (1.0, 0.20, 0.15, True),
        (1.0, 1.0, 0.6, False),
    ],
)
def test_little_is_less_than_a_share_and_less_than_what_is_left(
    was, missing, left, little, monkeypatch
):
    monkeypatch.setattr(worth, "mean_square", lambda _, found, kind: found)
    assert explains_little([], was, missing, left, 0.0) is little


@pytest.mark.parametrize(
    ("missing", "left", "denies"),
    [
        (9.0, 1.1 * FARTHER * 9.0, True),  # in squares of what rounding leaves
        (9.0, 0.9 * FARTHER * 9.0, False),
        (0.5, 1.1 * FARTHER, False),  # within rounding
        (9.0, 1.0, False),
    ],
)
@pytest.mark.parametrize("register", [DUTY, VOLTS])
def test_a_register_that_is_much_farther_off_denies_a_name(
    missing, left, denies, register, monkeypatch
):
    model = model_of(logs(motions=["slow"], registers=(POSITION, register)))
    name, start = "load_friction", np.zeros(len(model.nuisances))
    found = fit(model, Hypothesis(effect_knobs(effect(name))), np.append(start, 1.0), rounds=1)
    parts = _parts(model, found, [gain_of(name, found)], lambda _: None)
    noise = model.floors()[Kind.DUTY if register == DUTY else Kind.VOLTAGE] ** 2
    squares = lambda _, one, kind: noise * (left if one is found else missing)  # noqa: E731
    monkeypatch.setattr(worth, "mean_square", squares)
    monkeypatch.setattr(settling, "changes_little", lambda *_: False)
    objection = _faint(model, model, found, parts)
    assert (objection is not None and objection.because == settling.DENIED) is denies


@pytest.mark.parametrize(("name", "denied"), [("load_friction", False), ("transport_delay", True)])
def test_names_that_take_nothing_off_what_judges_are_taken_back_where_much_is_left(
    name, denied, monkeypatch
):
    """However much either explains beside the other where they were fitted."""
    planted = {"dead_zone": {"margin_rad": 0.05}, "load_friction": {"ratio": 0.5}}
    model = model_of(logs(planted))
    before = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    knobs = effect_knobs(effect(name))
    after = fit(model, Hypothesis(knobs), np.append(before.z, 0.0 if denied else 5.0))
    parts = _parts(model, after, [gain_of(name, after)], print)
    monkeypatch.setattr(worth, "explained", lambda *_: 1.0)
    floor = model.observed[0].position.quantum / np.sqrt(12.0)
    found = _little(model, model, before, after, parts, floor)
    assert (found is not None and found.because == BESIDE) is denied
