"""What a diagnosis names that no fit sees: what the registers themselves show."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from pendulum_logs import JOINT, MOTIONS, POSITION, logs, robot

from bench.diagnosis.joint import diagnosis as joint
from bench.diagnosis.joint import views
from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.search import Outside
from bench.diagnosis.joint.settling import settle
from bench.diagnosis.observed import Channel, observe
from bench.diagnosis.result import Rival
from sim.effects import effect
from sim.model import read_model

TRUTH, LIMIT = {"torque_limit": {"duty": 0.4}}, {"torque_limit": effect("torque_limit")}
STEP_S = 0.05e-3
"""How finely the duty of the law is asked for [s]."""


def diagnosed(observed, judged=()):
    found = diagnose_joint(read_model(robot()), robot(), observed, judged, effects={})
    return {cause.effect: cause for cause in found.diagnosis.causes}


def seen(*motions):
    return observe(logs(motions=motions), robot(), JOINT)


def held(one, period_s):
    """The same recording with a load register of its own period."""
    model = JointModel(read_model(robot()), robot(), [one])
    duty = model.law(Hypothesis(), np.zeros(len(model.nuisances)), 0, STEP_S)
    samples = one.channels[Channel.DUTY]
    value = np.interp(
        np.floor(samples.t_s / period_s) * period_s, STEP_S * np.arange(len(duty)), duty
    )
    channels = dict(one.channels) | {Channel.DUTY: replace(samples, value=value)}
    return replace(one, channels=channels)


def test_a_new_value_of_a_held_register_was_made_at_some_time_since_the_read_before():
    one = held(*seen("fast"), 0.0293)
    model = JointModel(read_model(robot()), robot(), [one], load_refresh_s=0.0293)
    z = np.zeros(len(model.nuisances))
    block = model.residuals(Hypothesis(), [z])[0][0, Kind.DUTY]
    law = model.law(Hypothesis(), z, 0, STEP_S)
    between_s = np.median(np.diff(one.channels[Channel.DUTY].t_s))
    now, before = (law[np.round((block.t_s - ago) / STEP_S).astype(int)] for ago in (0, between_s))
    change = now - before
    late = -float(change @ block.value / (change @ change))  # reads by which what is left is late
    assert abs(late) < 0.1


def test_a_register_that_is_always_new_and_read_well_is_no_cause():
    assert diagnosed(seen("slow", "fast"), seen("swell")) == {}


@pytest.mark.slow
def test_a_glitch_is_seen_in_recordings_that_only_judge_as_well():
    drafts = logs(motions=("swell",))
    (judge,) = observe([glitched(drafts[0])], robot(), JOINT)
    causes = diagnosed(seen("slow", "fast"), [judge])
    assert set(causes) == {"lost_samples"}


def glitched(recording):
    """The recording with a bit of one position turned over."""
    raw = recording.table["raw"].to_numpy().copy()
    names = np.array(recording.table["register"].to_pylist())
    (places,) = np.nonzero((names == POSITION) & np.isfinite(raw))
    raw[places[len(places) // 2]] += 32
    table = recording.table
    column = table.column_names.index("raw")
    table = table.set_column(column, "raw", pa.array(raw, pa.float64()))
    return type(recording).checked(table, dict(recording.metadata))


def test_a_register_with_a_short_period_of_its_own_is_a_cause():
    period_s = 0.0037
    causes = diagnosed([held(one, period_s) for one in seen(*MOTIONS)])
    assert "load_refresh" in causes
    low, high = causes["load_refresh"].parameters["period_s"].ci95
    assert low <= period_s <= high


@pytest.mark.slow
@pytest.mark.parametrize("repeats", [1, 2])
def test_a_motion_that_alone_reaches_a_limit_is_fitted_after_all_if_it_was_repeated(repeats):
    """One repeat is fitted and the other judges; a motion that was not repeated stays held out."""
    motions = ("slow", "slow", *["steps"] * repeats)
    slow, steps = np.split(np.array(observe(logs(TRUTH, motions), robot(), JOINT)), [2])
    found = diagnose_joint(read_model(robot()), robot(), slow, steps, effects=LIMIT).diagnosis
    assert found.fit.recordings == (steps[-1].name,)
    if repeats == 1:
        assert (found.verdict, found.causes) == ("unexplained", ())
        return
    (cause,) = found.causes
    assert cause.parameters["duty"].value == pytest.approx(0.4, rel=0.1)
    assert found.verdict == "explained"
    assert any(f"{steps[0].name} of them were fitted after all" in told for told in found.limits)


@pytest.mark.slow
def test_a_name_is_told_once_as_a_rival_or_as_rejected(monkeypatch):
    """A rival that was taken back stands beside the cause; one that was refuted does not."""
    back = ("gain_error", "torque_constant", "cable_drag")
    rows = [{"effect": name, "gain_nats": 9.0, "because": "so"} for name in back]

    def settled(*told):
        return replace(settle(*told), rejected=rows, refuted={"gain_error"})

    def in_its_place(model, now, name, *_):
        close = [Rival(other, (JOINT,), 0.3, 1.0) for other in back[:2]]
        return 0.4, close, {rival.effect: now for rival in close}, now

    monkeypatch.setattr(views, "settle", settled)
    monkeypatch.setattr(joint, "rivals", in_its_place)
    monkeypatch.setattr(joint, "next_experiments", lambda _, __, fits, ___: list(fits))
    observed = observe(logs(TRUTH, ("steps", "slow")), robot(), JOINT)
    found = diagnose_joint(read_model(robot()), robot(), observed, effects=LIMIT).diagnosis
    (cause,) = found.causes
    assert [rival.effect for rival in cause.indistinguishable_from] == ["torque_constant"]
    assert found.next_experiment == ("torque_constant",)
    assert [row["effect"] for row in found.rejected] == ["gain_error", "cable_drag"]
    assert tuple(found.details["taken_back"]) == back


@pytest.mark.slow
def test_experiments_are_proposed_in_the_order_of_causes(monkeypatch):
    truth = TRUTH | {"dead_zone": {"margin_rad": 0.02}}
    effects = LIMIT | {"dead_zone": effect("dead_zone")}

    def last_most(model, after, parts, floors):
        nats = np.arange(1.0, 1.0 + len(parts)) * 100.0
        pairs = zip(parts, nats.tolist(), strict=True)
        return [replace(gain, held_out=Outside(x, 0.0, 0.0)) for (gain, _), x in pairs]

    def in_its_place(model, now, name, *_):
        other = f"what is like {name}"
        return 0.4, [Rival(other, (JOINT,), 0.3, 1.0)], {other: now}, now

    monkeypatch.setattr(joint, "beside_others", last_most)
    monkeypatch.setattr(joint, "rivals", in_its_place)
    monkeypatch.setattr(joint, "next_experiments", lambda _, __, fits, ___: list(fits))
    observed = observe(logs(truth, ("steps", "slow", "fast")), robot(), JOINT)
    found = diagnose_joint(read_model(robot()), robot(), observed, effects=effects).diagnosis
    assert {cause.effect for cause in found.causes} == set(effects)
    gains = [cause.held_out_gain_nats for cause in found.causes]
    assert gains[0] > gains[1]
    told = tuple(f"what is like {cause.effect}" for cause in found.causes)
    assert found.next_experiment == told


def test_recordings_that_judge_and_are_like_those_that_were_fitted_are_not_fitted():
    slow, fast = np.split(
        np.array(observe(logs({}, ("slow", "fast", "fast")), robot(), JOINT)), [1]
    )
    found = diagnose_joint(read_model(robot()), robot(), slow, fast, effects={}).diagnosis
    assert found.fit.recordings == tuple(one.name for one in fast)
    assert not any("after all" in told for told in found.limits)
