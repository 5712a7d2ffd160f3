"""What a run keeps of itself: steps by what they depend on, and when it stops."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import logs, robot

from bench.diagnosis import journal
from bench.diagnosis.joint.fit import fit
from bench.diagnosis.joint.growing import grow
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.screening import screen
from bench.diagnosis.journal import Journal, digest
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.noise import Noise
from bench.diagnosis.observed import observe
from bench.diagnosis.watch import OutOfTimeError, Watch
from sim.effects import effect
from sim.model import read_model

DELAY = effect("transport_delay")


@pytest.fixture
def model(tmp_path):
    truth = {"transport_delay": {"delay_s": 0.02}}
    recordings = logs(truth, motions=["fast", "swell"], duration_s=1.0)
    seen = observe(recordings, robot(), "arm")
    return JointModel(read_model(robot()), robot(), seen, Journal(tmp_path / "steps"))


def started(model):
    return np.zeros(len(model.nuisances))


def same(one, other):
    assert one.hypothesis == other.hypothesis
    assert one.z.tolist() == other.z.tolist()
    assert (one.noise, one.cost, one.costs) == (other.noise, other.cost, other.costs)


def test_a_fit_that_was_done_is_recalled_to_the_bit(model):
    first = fit(model, Hypothesis(), started(model), rounds=1)
    run = model.rollouts
    again = fit(model, Hypothesis(), started(model), rounds=1)
    assert model.rollouts == run
    assert model.journal.recalled == 0  # it was this run's own
    model.journal = Journal(model.journal.folder)
    same(fit(model, Hypothesis(), started(model), rounds=1), again)
    assert model.rollouts == run
    assert model.journal.recalled == 1
    same(first, again)
    fit(model, Hypothesis(), started(model), rounds=1)
    assert model.journal.recalled == 1  # a step counts once


def test_a_ranking_that_was_made_is_recalled_to_the_bit(model):
    base = fit(model, Hypothesis(), started(model), rounds=1)
    first = screen(model, base, [DELAY])
    run = model.rollouts
    again = screen(model, base, [DELAY])
    assert model.rollouts == run
    assert [(g, n, x.tolist()) for g, n, x in first] == [(g, n, x.tolist()) for g, n, x in again]


def test_other_steps_are_other_steps(model):
    """Start, knobs, noise, recordings and patience each make another fit."""
    begin = started(model)
    noise = {kind: Noise(0.001, 0.01, 0.1) for kind in Kind}
    fit(model, Hypothesis(), begin, rounds=1)
    fit(model, Hypothesis(), begin + 0.1, rounds=1)
    fit(model, Hypothesis(), begin, noise, rounds=1)
    fit(model, Hypothesis(), begin, which=[0], rounds=1)
    fit(model, Hypothesis(), begin, rounds=2)
    fit(model, Hypothesis(effect_knobs(DELAY)), np.append(begin, 0.0), rounds=1)
    assert len(list(model.journal.folder.iterdir())) == 6


def test_other_recordings_or_another_robot_are_another_model(model):
    def key(base=model.base, seen=model.observed):
        return JointModel(base, model.robot, seen).key

    assert key() == model.key
    assert key(seen=model.observed[:1]) != model.key
    one, other = model.observed
    samples = one.position
    moved = replace(samples, value=samples.value + np.spacing(samples.value))
    channels = dict(one.channels) | {next(iter(one.channels)): moved}
    assert key(seen=(replace(one, channels=channels), other)) != model.key
    supply = replace(model.base.supply, voltage_v=model.base.supply.voltage_v + 1e-9)
    assert key(base=replace(model.base, supply=supply)) != model.key


@pytest.mark.parametrize("torn", ["", '{"z": [0.1', "[1, 2]"])
def test_a_step_that_is_no_json_is_done_again(model, torn):
    first = fit(model, Hypothesis(), started(model), rounds=1)
    (path,) = model.journal.folder.iterdir()
    path.write_text(torn)
    same(fit(model, Hypothesis(), started(model), rounds=1), first)
    assert json.loads(path.read_text())["z"] == first.z.tolist()


def test_arrays_are_told_apart_to_the_bit():
    x = np.array([1.0, 2.0])
    assert digest(x) == digest(x.copy())
    assert digest(x) != digest(x + np.spacing(x))
    assert digest(x) != digest(x.reshape(1, 2))
    assert digest(x, 1) != digest(1, x)
    assert digest(1, 23) != digest(12, 3)


def test_other_code_takes_other_steps(model, monkeypatch):
    before = model.key, journal.code()
    monkeypatch.setattr(journal, "CODE", ("bench/diagnosis",))
    code = journal.code.__wrapped__()
    assert code != before[1]
    monkeypatch.setattr("bench.diagnosis.joint.model.code", lambda: code)
    assert JointModel(model.base, model.robot, model.observed).key != before[0]


def test_steps_of_a_finished_run_are_forgotten(tmp_path):
    kept = Journal(tmp_path / "steps")
    kept.put("one", {"z": 1.0})
    assert kept.get("one") == {"z": 1.0}
    kept.finished()
    assert kept.get("one") is None
    assert list(tmp_path.iterdir()) == []


# --- time


class Clock:
    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


def test_a_watch_stops_once_and_then_lets_finish():
    told, clock = [], Clock()
    watch = Watch(told.append, 10.0, clock)
    watch("first")
    clock.now_s = 10.0
    with pytest.raises(OutOfTimeError):
        watch("second")
    watch("third")
    assert told == ["first", "third"]
    assert watch.stopped == "second"
    assert watch.late


def test_joints_share_the_time_that_is_left_and_say_which_they_are():
    told, clock = [], Clock()
    watch = Watch(told.append, 12.0, clock)
    first = watch.of("shoulder", 2)
    first("one")
    clock.now_s = 5.9
    assert not first.late
    clock.now_s = 6.0
    with pytest.raises(OutOfTimeError):
        first("two")
    second = watch.of("elbow", 1)
    clock.now_s = 11.9
    second("one")
    clock.now_s = 12.0
    assert second.late
    assert told == ["shoulder: one", "elbow: one"]
    assert watch.stopped is None


def test_without_a_budget_a_watch_never_stops():
    clock = Clock()
    watch = Watch(lambda _: None, None, clock)
    joint = watch.of("shoulder", 2)
    clock.now_s = 1e12
    for one in (watch, joint):
        one("first")
        assert not one.late


def test_a_search_that_is_out_of_time_gives_what_it_has(model):
    base = fit(model, Hypothesis(), started(model))
    floors = {kind: noise.total for kind, noise in base.noise.items()}
    effects = {"transport_delay": DELAY, "viscous_friction": effect("viscous_friction")}

    def until(stage):
        def say(told):
            if told.startswith(stage):
                raise OutOfTimeError(told)

        return grow(model, base, dict(effects), say, floors)

    now, taken, _ = until("step 1")
    assert now is base
    assert taken == []
    for stage in ("fitting transport_delay from elsewhere", "step 2"):
        now, taken, confirmed = until(stage)
        assert [gain.effect for gain in taken] == ["transport_delay"]
        assert now.hypothesis.effects == ("transport_delay",)
        assert confirmed
