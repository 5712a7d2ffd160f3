"""Residuals of a joint: what a model leaves of recordings, and what a fit finds in them."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import CONDITION, DUTY, JOINT, PACE_S, POSITION, VOLTS, logs, model_of, robot

import bench.diagnosis.joint.fit as fit_module
from bench.diagnosis.joint.fit import (
    DAMPINGS,
    block_costs,
    bounds,
    estimate_noise,
    fit,
    least_squares,
    linearise,
    prior_cost,
    steps,
)
from bench.diagnosis.joint.intervals import covariances, estimates
from bench.diagnosis.joint.left import INSTANT_S, WILD, Left, averaged
from bench.diagnosis.joint.model import LATEST, Hypothesis, JointModel, Kind
from bench.diagnosis.joint.nuisances import GEAR_LEVELS, LOAD_OF_GEAR
from bench.diagnosis.joint.remaining import block_rms, remaining, score
from bench.diagnosis.joint.search import NEEDED, confirm
from bench.diagnosis.joint.sways import FRICTION, SUPPLY
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.noise import cost
from bench.diagnosis.observed import observe
from sim.drive import fields, lanes
from sim.effects import effect
from sim.model import read_model
from sim.stepped import TICK_S

COULOMB_NM = read_model(robot()).joints[0].drive.friction.coulomb_nm


def blocks_of(model, z=None, hypothesis=None):
    z = np.zeros(len(model.nuisances)) if z is None else z
    return model.residuals(hypothesis or Hypothesis(), [z])[0]


@pytest.fixture(scope="module")
def null():
    """The model's own output, counted as registers count."""
    return model_of(logs())


def having(name):
    return Hypothesis(effect_knobs(effect(name)))


def test_what_a_model_leaves_of_its_own_output_is_rounding(null):
    for (r, kind), block in blocks_of(null).items():
        if kind is Kind.POSITION:
            quantum = null.observed[r].position.quantum
            assert np.abs(block.value).max() <= 0.5 * quantum * (1.0 + 1e-6)
            assert np.std(block.value) > 0.1 * quantum  # it is rounding, not nothing


def test_the_controller_along_counted_angles_is_off_by_counts_only(null):
    gain = max(null.observed[0].replay.start[7:9])
    for (r, kind), block in blocks_of(null).items():
        if kind is Kind.DUTY:
            samples = null.observed[r].channels[kind.channel]
            rounding = 0.5 * samples.quantum + gain * null.observed[r].position.quantum
            quiet = block.extra < np.median(block.extra)
            assert np.abs(block.value[quiet]).max() < 2.0 * rounding


def test_the_voltage_of_a_model_is_its_own_within_a_count():
    model = model_of(logs(registers=(POSITION, DUTY, VOLTS)))
    kinds = {kind for _, kind in blocks_of(model)}
    assert kinds == set(Kind)
    for (r, kind), block in blocks_of(model).items():
        if kind is Kind.VOLTAGE:
            quantum = model.observed[r].channels[kind.channel].quantum
            assert np.quantile(np.abs(block.value), 0.9) < quantum


@pytest.mark.parametrize(
    ("ohm", "held", "pace_s", "duration_s", "supplied"),
    [(0.6, 2, 0.01, 3.0, True), (3.0, 10, 0.01, 8.0, False), (1.5, 1, 0.036, 8.0, False)],
)
def test_a_sag_is_seen_in_a_voltage_that_is_measured_now_and_then(
    ohm, held, pace_s, duration_s, supplied
):
    sag = {"voltage_sag": {"resistance_ohm": ohm}}
    slow = {"held": held, "pace_s": pace_s, "duration_s": duration_s}
    model = model_of(logs(sag, registers=(POSITION, VOLTS), **slow))
    assert {*model.recorded_supply} == {supplied}  # whether it tells what a motion was under
    before = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    found = confirm(model, before, effect("voltage_sag"), np.append(before.z, 0.1))
    (knob,) = found.fit.hypothesis.knobs
    assert found.deflated > NEEDED
    assert knob.value(found.fit.z[-1]) == pytest.approx(ohm, rel=0.15)


def test_a_voltage_that_is_often_new_is_what_a_motion_was_under():
    sag = {"voltage_sag": {"resistance_ohm": 6.0}}
    often, held = (
        observe(logs(sag, ["fast"], (POSITION, VOLTS), 8.0, held=n), robot(), JOINT)
        for n in (1, 10)
    )
    assert [one.supplied for one in (*often, *held)] == [True, False]
    assert held[0].volts_s == pytest.approx(0.1, rel=0.02)
    (like,) = observe(
        logs(sag, ["slow"], (POSITION, VOLTS), 1.0, held=10), robot(), JOINT, like=held
    )
    assert not like.supplied  # which it does not show by itself
    volts = held[0].channels[Kind.VOLTAGE.channel]
    events = held[0].replay.events
    (level,) = events[events[:, 1] >= lanes.SUPPLY_EVENT][:, 2]
    assert np.median(volts.value) < level <= volts.value.max()


@pytest.mark.parametrize(("volts_s", "old_s"), [(0.036, 0.056), (0.1, 0.12), (1.0, 0.15)])
def test_a_voltage_is_no_older_for_being_asked_for_once_a_second(volts_s, old_s):
    (one,) = observe(logs(motions=["fast"], registers=(POSITION, VOLTS)), robot(), JOINT)
    assert replace(one, volts_s=volts_s).stale_s == pytest.approx(old_s)


def test_a_voltage_that_is_seldom_read_is_of_some_time_before():
    (one,) = observe(logs(motions=["fast"], registers=(POSITION, VOLTS)), robot(), JOINT)
    often = one.channels[Kind.VOLTAGE.channel]
    few = np.arange(19, len(often.t_s), 20)
    seldom = replace(
        often,
        **{name: getattr(often, name)[few] for name in ("t_s", "value", "index", "good")},
    )
    channels = dict(one.channels) | {Kind.VOLTAGE.channel: seldom}
    one = replace(one, channels=channels, supplied=False, volts_s=0.2, seldom=True)
    t_s = one.replay.samples
    outs = np.zeros((1, len(t_s), lanes.CHANNELS))
    outs[0, :, lanes.OUT_DUTY], outs[0, :, lanes.OUT_CURRENT] = 1.0, 1.0 + np.sin(20.0 * t_s)
    told = Left(one, renewed=False)
    (block,) = told.blocks(
        Kind.VOLTAGE.channel, outs, None, np.array([2.0]), np.array([11.0]), np.zeros(1)
    )
    drop = 2.0 + 2.0 * np.sin(20.0 * t_s)
    before = [drop[(t_s >= t - one.stale_s) & (t_s <= t)] for t in seldom.t_s]
    assert block.value == pytest.approx(seldom.value - 11.0 + [d.mean() for d in before])
    assert block.extra == pytest.approx([d.var() for d in before])


@pytest.mark.parametrize(
    ("delay_s", "unsure"), [(0.0, False), (0.004, False), (0.0065, True), (0.012, False)]
)
def test_a_duty_may_be_made_of_the_goal_before_where_that_is_in_force_just_then(delay_s, unsure):
    """Goals are written every 10 ms; a duty is read 7 ms after each of them."""
    (one,) = observe(logs(motions=["slow"]), robot(), JOINT)
    duty = one.channels[Kind.DUTY.channel]
    times = np.arange(0.0, 3.0, PACE_S)
    goals = np.where(np.arange(len(times)) % 2, 0.05, 0.0) + np.interp(
        times, one.position.t_s, one.position.value
    )
    at = times + 0.007
    late = replace(duty, t_s=at, value=np.resize(duty.value, len(at)))
    late = replace(late, index=np.resize(duty.index, len(at)), good=np.ones(len(at), bool))
    one = replace(one, goal=(times, goals), channels=one.channels | {Kind.DUTY.channel: late})
    outs = np.zeros((1, len(one.replay.samples), lanes.CHANNELS))
    duties = np.zeros((1, len(one.replay.samples)))
    some = np.array([2.0]), np.array([11.0])
    blocks = [
        Left(one, renewed=False).blocks(Kind.DUTY.channel, outs, duties, *some, np.array([late_s]))
        for late_s in (0.003, delay_s)
    ]
    (usual,), (block,) = blocks
    gain = max(one.replay.start[[fields.GAIN_CW, fields.GAIN_CCW]])
    more = np.sqrt(np.median(block.extra - usual.extra))
    assert more == pytest.approx(0.5 * 0.05 * gain if unsure else 0.0, rel=0.2, abs=1e-9)


def test_a_duty_holds_no_goal_that_is_written_after_it():
    (one,) = observe(logs(motions=["slow"]), robot(), JOINT)
    duty = one.channels[Kind.DUTY.channel]
    goal = duty.t_s + 0.0005, 0.3 * (np.arange(len(duty.t_s)) % 2)
    outs = np.zeros((1, len(one.replay.samples), lanes.CHANNELS))
    given = outs, outs[:, :, 0], np.array([2.0]), np.array([11.0]), np.zeros(1)
    blocks = [
        Left(replace(one, goal=now), renewed=False, made_s=made_s).blocks(Kind.DUTY.channel, *given)
        for now, made_s in ((goal, 0.0), ((goal[0], 0.0 * goal[1]), 0.0), (goal, 0.001))
    ]
    (told,), (still,), (unsure,) = blocks
    assert told.extra == pytest.approx(still.extra)
    assert np.median(unsure.extra) > 10.0 * np.median(still.extra)


def test_a_motion_sways_by_as_much_as_more_friction_or_voltage_changes_it(null):
    blocks = blocks_of(null)
    vector = np.zeros(len(null.nuisances))
    names = [n.name for n in null.nuisances]
    for k, (name, share) in enumerate((("coulomb_level", FRICTION), ("supply", SUPPLY))):
        at = names.index(name)
        moved = []
        for side in (1.0, -1.0):
            vector[at] = side * share / null.nuisances[at].deviation
            moved.append(blocks_of(null, vector.copy()))
        vector[at] = 0.0
        for key, block in blocks.items():
            if key[1] is Kind.POSITION:
                change = (moved[1][key].value - moved[0][key].value) / 2.0
                assert block.sways[:, k] == pytest.approx(change, abs=1e-12)
                assert np.abs(change).max() > 1e-5
            else:
                assert block.sways is None


def test_a_voltage_that_was_recorded_is_swayed_by_no_other():
    sag = {"voltage_sag": {"resistance_ohm": 6.0}}
    model = model_of(logs(sag, ["fast"], (POSITION, VOLTS), 8.0))
    assert model.recorded_supply == (True,)
    block = blocks_of(model)[0, Kind.POSITION]
    assert block.sways[:, 0].any()
    assert not block.sways[:, 1].any()


def test_friction_that_is_another_in_each_recording_is_found_in_each():
    """A likelihood with it is far likelier, and what it leaves is rounding again."""
    share = 2.0 * FRICTION
    rows = logs({"coulomb_friction": {"more_nm": share * COULOMB_NM}}, motions=["slow"])
    rows += logs({"coulomb_friction": {"more_nm": -share * COULOMB_NM}}, motions=["fast"])
    model = model_of(rows)
    found = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    raw = model.residuals(Hypothesis(), [found.z])[0]
    calm = remaining(model, found)
    for r in range(2):
        key = r, Kind.POSITION
        bare = replace(raw[key], sways=None)
        assert cost(bare, found.noise[Kind.POSITION]) > cost(raw[key], found.noise[Kind.POSITION])
        quantum = model.observed[r].position.quantum
        assert np.std(calm[key].value) < 0.5 * quantum
    assert block_rms(raw, Kind.POSITION) > 1.2 * block_rms(calm, Kind.POSITION)
    assert calm[0, Kind.DUTY] is raw[0, Kind.DUTY]


def test_voltages_are_means_over_windows_and_rare_ones_stay():
    often = np.array([1.0, 2.0, 3.0, 7.0])
    t_s, value, extra = averaged(np.array([0.0, 0.01, 0.02, 0.06]), often, np.ones(4), 0.05)
    assert t_s == pytest.approx([0.01, 0.06])
    assert value == pytest.approx([2.0, 7.0])
    assert extra == pytest.approx([1.0, 1.0])
    rare = np.arange(4.0) ** 2
    assert averaged(np.arange(4.0), rare, np.zeros(4), 0.05)[1] == pytest.approx(rare)


def test_residuals_are_recorded_less_modelled():
    model = model_of(logs(motions=["slow"]))
    before = blocks_of(model)[0, Kind.POSITION].value
    (one,) = model.observed
    more = replace(one.position, value=one.position.value + 0.01)
    shifted = replace(one, channels=dict(one.channels) | {Kind.POSITION.channel: more})
    model = JointModel(model.base, model.robot, [shifted])
    assert blocks_of(model)[0, Kind.POSITION].value == pytest.approx(before + 0.01)


def test_what_was_just_rolled_out_is_not_rolled_out_again():
    model = model_of(logs(motions=["slow"]))
    vectors = [x * np.ones(len(model.nuisances)) for x in np.linspace(0.0, 0.5, LATEST)]
    model.residuals(Hypothesis(), [9.0 * vectors[-1]])  # and what sways recordings, once for all
    done = model.rollouts
    first = model.residuals(Hypothesis(), vectors)
    assert model.rollouts == done + LATEST
    again = model.residuals(Hypothesis(), [vectors[3], 0.7 * vectors[-1], vectors[1]])
    assert model.rollouts == done + LATEST + 1
    assert (again[0], again[2]) == (first[3], first[1])
    assert not np.array_equal(again[1][0, Kind.POSITION].value, first[3][0, Kind.POSITION].value)
    (other,) = model.residuals(having("backlash"), [np.append(vectors[3], 1.0)])
    assert not np.array_equal(other[0, Kind.POSITION].value, first[3][0, Kind.POSITION].value)
    model.residuals(Hypothesis(), [vectors[0]])  # long ago
    assert model.rollouts == done + LATEST + 3


def test_steps_that_lead_nowhere_are_made_shorter_along_the_same_slopes(null, monkeypatch):
    asked = []

    def counted(model, hypothesis, z, noise, which=None):
        asked.append(z.tobytes())
        return linearise(model, hypothesis, z, noise, which)

    monkeypatch.setattr(fit_module, "linearise", counted)
    found = fit(null, Hypothesis(), np.zeros(len(null.nuisances)))
    box = bounds(null, Hypothesis())
    before, z = None, found.z
    while before is None or (z != before).any():
        before = z
        asked.clear()
        z = least_squares(null, Hypothesis(), z, found.noise, None, box, 4)
    assert asked == [z.tobytes()]


def test_a_zero_moves_residuals_only_as_far_as_gravity_does(null):
    """Held by the position law, the joint goes where it reads as before."""
    (k,) = [k for k, n in enumerate(null.nuisances) if n.name == "zero"]
    z = np.zeros(len(null.nuisances))
    z[k] = 1.0
    before, after = blocks_of(null), blocks_of(null, z)
    moved = [after[r, Kind.POSITION].value - before[r, Kind.POSITION].value for r in range(4)]
    assert max(np.abs(m).max() for m in moved) < null.nuisances[k].deviation
    assert all(np.abs(m).max() > 1e-5 for m in moved)


def test_many_vectors_give_what_each_gives_alone(null):
    random = np.random.default_rng(3)
    count = LATEST + 1  # so many are not remembered
    vectors = [random.normal(size=len(null.nuisances)) for _ in range(count)]
    together = null.residuals(Hypothesis(), vectors)
    for z, blocks in zip(vectors, together, strict=True):
        for key, block in blocks_of(null, z).items():
            assert (block.value == blocks[key].value).all()


def test_some_recordings_give_what_they_give_among_all(null):
    some = null.residuals(Hypothesis(), [np.zeros(len(null.nuisances))], [2])[0]
    assert {r for r, _ in some} == {2}
    for key, block in some.items():
        assert (block.value == blocks_of(null)[key].value).all()


def test_a_fast_joint_is_less_sure_of_its_samples(null):
    for r in range(4):
        block = blocks_of(null)[r, Kind.POSITION]
        position = null.observed[r].position.value
        speed = np.abs(np.gradient(position, null.observed[r].position.t_s))
        fastest = np.argmax(np.convolve(speed, np.ones(5) / 5.0, mode="same"))
        assert block.extra[fastest] == pytest.approx((speed.max() * INSTANT_S) ** 2, rel=0.5)
        assert block.extra[:5].max() < 0.1 * block.extra.max()


def test_glitches_are_no_residuals():
    recordings = logs(motions=["slow"])
    model = model_of(recordings)
    (one,) = model.observed
    position = one.position
    bad = position.good.copy()
    bad[[50, 120]] = False
    channels = dict(one.channels) | {Kind.POSITION.channel: replace(position, good=bad)}
    model = model.of((replace(one, channels=channels),))
    assert len(blocks_of(model)[0, Kind.POSITION].value) == len(position.value) - 2


@pytest.mark.parametrize("controller", ["dead_zone", "read_skew"])
def test_only_the_controllers_own_numbers_turn_the_duty(null, controller):
    names = [n.name for n in null.nuisances]
    hypothesis = having(controller) + effect_knobs(effect("load_friction"))
    z = np.zeros(len(names) + len(hypothesis.knobs))
    base = null.residuals(hypothesis, [z])[0]
    for k, size in enumerate(steps(null, hypothesis, z).tolist()):
        if abs(size) < 1e-3:
            continue  # a nuisance whose effect is on stays where it is
        moved = z.copy()
        moved[k] += size
        blocks = null.residuals(hypothesis, [moved])[0]
        turned = any(
            (blocks[r, Kind.DUTY].value != base[r, Kind.DUTY].value).any() for r in range(4)
        )
        assert turned is null.turns_controller(hypothesis, k), k


def test_the_jacobian_is_how_whitened_residuals_move(null):
    hypothesis = having("load_friction")
    z = np.append(np.zeros(len(null.nuisances)), 0.5)
    noise = estimate_noise(null, blocks_of(null))
    residual, jacobian = linearise(null, hypothesis, z, noise)
    step = np.zeros(len(z))
    step[-1] = 0.05
    moved, _ = linearise(null, hypothesis, z + step, noise)
    predicted = residual + jacobian @ step
    assert np.linalg.norm(moved - predicted) < 0.2 * np.linalg.norm(moved - residual)


def test_steps_of_differences_stay_within_bounds(null):
    hypothesis = having("gain_error") + effect_knobs(effect("transport_delay"))
    _, high = bounds(null, hypothesis)
    z = high.copy()
    low, _ = bounds(null, hypothesis)
    size = steps(null, hypothesis, z)
    inside = low < high
    assert (z + size <= high)[inside].all()
    assert (size[inside] < 0.0).all()


# --- fits


def fitted(name, truth, registers=(POSITION, DUTY), start=0.5, **more):
    model = model_of(logs({name: truth}, registers=registers, **more))
    hypothesis = having(name)
    z = np.append(np.zeros(len(model.nuisances)), np.full(len(hypothesis.knobs), start))
    return model, fit(model, hypothesis, z)


@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("gain_error", {"scale": 1.3}),
        ("transport_delay", {"delay_s": 0.03}),
        ("load_friction", {"ratio": 0.25}),
        ("dead_zone", {"margin_rad": 0.012}),
    ],
)
def test_a_fit_finds_what_was_planted(name, truth):
    model, found = fitted(name, truth)
    told = estimates(model, found, name)
    for parameter, value in truth.items():
        one = told[parameter]
        assert one.value == pytest.approx(value, rel=0.05)
        low, high = one.ci95
        assert low <= one.value <= high
        # counts leave it a little beside: within twice the interval
        assert abs(one.value - value) <= high - low
    # nothing is left to find but rounding, and a delay is one of whole ticks
    floor = model.observed[0].position.quantum / np.sqrt(12.0)
    if name == "transport_delay":
        speeds = [np.gradient(o.position.value, o.position.t_s) for o in model.observed]
        floor += TICK_S * np.sqrt(np.mean(np.concatenate(speeds) ** 2))
    squares = score(model, found, range(4))
    rms = np.sqrt(squares.squares[Kind.POSITION] / squares.count[Kind.POSITION])
    assert rms < 1.5 * floor


def test_a_fit_is_never_worse_than_where_it_started(null):
    start = np.random.default_rng(1).normal(size=len(null.nuisances))
    found = fit(null, Hypothesis(), start)
    noise = estimate_noise(null, blocks_of(null, start))
    first = sum(block_costs(blocks_of(null, start), noise).values())
    assert found.cost <= first + prior_cost(null, start)


def test_a_fit_stays_within_bounds(null):
    low, high = bounds(null, having("torque_limit"))
    found = fit(null, having("torque_limit"), np.full(len(low), 3.0))
    assert (found.z >= low).all()
    assert (found.z <= high).all()


def test_a_system_too_near_singular_is_met_with_more_damping(null, monkeypatch):
    solve, calls = fit_module.bounded_step, []

    def stubborn(*args):
        calls.append(args)
        if len(calls) <= len(DAMPINGS):
            raise np.linalg.LinAlgError
        return solve(*args)

    monkeypatch.setattr(fit_module, "bounded_step", stubborn)
    start = np.full(len(null.nuisances), 0.7)
    found = fit(null, Hypothesis(), start)
    assert len(calls) > len(DAMPINGS)
    assert found.cost < fit(null, Hypothesis(), start, evaluations=0, rounds=1).cost


def test_on_its_own_output_a_fit_leaves_the_nuisances_nearly_alone(null):
    """Some do nearly the same, so that one alone may move a little; all of it is worth no nat."""
    found = fit(null, Hypothesis(), np.zeros(len(null.nuisances)))
    assert prior_cost(null, found.z) < 1.0


def test_the_sandwich_is_near_what_the_likelihood_believes_on_a_null(null):
    found = fit(null, Hypothesis(), np.zeros(len(null.nuisances)))
    believed, sandwich = covariances(null, found)
    assert believed == pytest.approx(believed.T)
    assert (np.diag(believed) <= 1.0 + 1e-6).all()  # never wider than the prior
    free = np.diag(believed) > 0.0  # the levels of a rigid gear are idle, and what knows of loads
    assert free.sum() == len(null.nuisances) - len({*GEAR_LEVELS, LOAD_OF_GEAR})
    ratio = np.diag(sandwich)[free] / np.diag(believed)[free]
    assert np.median(ratio) < 3.0


def test_recordings_of_one_condition_share_what_hangs_there():
    heavy = dict(CONDITION) | {"payload_kg": 0.3}
    model = model_of(logs(motions=["slow"]) + logs(motions=["slow"], condition=heavy))
    z = np.zeros(len(model.nuisances))
    light, loaded = (model.candidate(Hypothesis(), z, r) for r in range(2))
    extra = 0.15 * 9.81 * 0.1
    assert loaded.load.sine_nm - light.load.sine_nm == pytest.approx(extra, rel=1e-6)
    assert loaded.payload.sine_nm - light.payload.sine_nm == pytest.approx(extra, rel=1e-6)


def test_a_rollout_that_flies_apart_is_a_large_residual_and_no_less_of_a_number(monkeypatch):
    """A rotor without inertia on a spring: what is left must be something that noise can be of."""
    model = model_of(logs(motions=["fast"], registers=(POSITION, DUTY, VOLTS)))
    flown = model.of(model.observed, sprung=True)
    run = flown._recorded.run
    monkeypatch.setattr(flown._recorded, "run", lambda *told: [out * np.nan for out in run(*told)])
    (blocks,) = flown.residuals(Hypothesis(), [np.zeros(len(flown.nuisances))])
    assert {kind for _, kind in blocks} >= {Kind.POSITION, Kind.VOLTAGE}
    for (_, kind), block in blocks.items():
        assert np.isfinite(block.extra).all()
        if kind is Kind.POSITION:
            assert (block.value == WILD).all()
