"""When the values of a load register with a period of its own were made."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import JOINT, MOTIONS, logs, robot

from bench.diagnosis.joint.fit import fit
from bench.diagnosis.joint.instants import FEWEST, lattice, located
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.search import confirm
from bench.diagnosis.observed import Channel, observe
from sim.effects import effect
from sim.model import read_model

PERIOD_S, PHASE_S = 0.13, 0.047


def spans(period_s=PERIOD_S, duration_s=6.0, phase_s=PHASE_S, read_s=0.02, jitter_s=0.002):
    """Times of the reads before and at which values were seen to be new."""
    random = np.random.default_rng(0)
    late_s = random.uniform(0.0, jitter_s, round(duration_s / read_s))
    reads = read_s * np.arange(len(late_s)) + late_s
    seen = np.floor((reads - phase_s) / period_s)
    new = 1 + np.flatnonzero(np.diff(seen))
    return reads[new - 1], reads[new]


@pytest.mark.parametrize("period_s", [0.128, 0.13, 0.1325])
def test_a_lattice_is_found_where_reads_are_in_step_with_it(period_s):
    every_s, phase_s, off_s, share = lattice(*spans(period_s), PERIOD_S)
    assert share == 1.0
    middle = 3.0
    true, said = (
        x[0] + x[1] * np.round((middle - x[0]) / x[1])
        for x in ((PHASE_S, period_s), (phase_s, every_s))
    )
    assert abs(said - true) < off_s + 0.001 < 0.012


@pytest.mark.slow
def test_a_long_recording_is_gone_through_in_little_memory():
    told = spans(0.1297, 600.0)
    tracemalloc.start()
    every_s, phase_s, off_s, share = lattice(*told, PERIOD_S)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(told[0]) > 4000
    assert share > 0.99  # hardly any room is left for all of them
    assert every_s == pytest.approx(0.1297, abs=1e-5)
    assert abs((phase_s - PHASE_S + every_s / 2) % every_s - every_s / 2) < off_s + 0.001 < 0.012
    assert most < 1e8


def held(one, period_s=PERIOD_S):
    """The same recording with a load register that is made now and then: (recording, instants)."""
    samples = one.channels[Channel.DUTY]
    made_s = np.arange(PHASE_S, samples.t_s[-1], period_s)
    model = JointModel(read_model(robot()), robot(), [one])
    law = model.law(Hypothesis(), np.zeros(len(model.nuisances)), 0, 1e-4)
    value = law[np.round(made_s / 1e-4).astype(int)]
    last = np.searchsorted(made_s, samples.t_s, "right") - 1
    shown = np.where(last >= 0, value[np.maximum(last, 0)], 0.0)
    channels = dict(one.channels) | {Channel.DUTY: replace(samples, value=shown)}
    return replace(one, channels=channels), made_s


def seen(*motions, truth=None):
    return observe(logs(truth, motions=motions, duration_s=6.0), robot(), JOINT)


def test_values_are_put_where_they_were_made():
    one, made_s = held(*seen("fast"))
    found, off_s = located(one, Channel.DUTY, PERIOD_S)
    duty = found.channels[Channel.DUTY]
    nearest = made_s[np.argmin(np.abs(duty.t_s[:, None] - made_s), axis=1)]
    assert len(duty.t_s) > 30
    assert np.abs(duty.t_s - nearest).max() < off_s + 0.001
    assert found.replay.samples[duty.index] == pytest.approx(duty.t_s)
    position = found.channels[Channel.POSITION]
    assert found.replay.samples[position.index] == pytest.approx(position.t_s)
    assert position.value is one.channels[Channel.POSITION].value


def test_a_law_leaves_less_of_values_that_are_where_they_were_made():
    one, _ = held(*seen("fast"), period_s=0.1304)  # out of step, so that no span is wide
    left = []
    for period_s in (PERIOD_S, 1.0):
        model = JointModel(read_model(robot()), robot(), [one], load_refresh_s=period_s)
        (blocks,) = model.residuals(Hypothesis(), [np.zeros(len(model.nuisances))])
        left.append(np.sqrt(np.mean(blocks[0, Kind.DUTY].value ** 2)))
    assert left[0] < 0.5 * left[1]


def test_a_register_without_a_period_stays_as_it_is():
    (one,) = seen("fast")
    assert located(one, Channel.DUTY, PERIOD_S) == (one, None)


def test_a_register_that_is_new_at_every_read_is_not_looked_at():
    one, _ = held(*seen("fast"))
    assert located(one, Channel.DUTY, 0.0) == (one, None)
    assert located(one, Channel.DUTY, 0.015) == (one, None)


def test_few_changes_say_nothing():
    one, _ = held(*seen("fast"))
    samples = one.channels[Channel.DUTY]
    few = np.where(samples.t_s < PERIOD_S * (FEWEST - 3), samples.value, samples.value[-1])
    channels = dict(one.channels) | {Channel.DUTY: replace(samples, value=few)}
    one = replace(one, channels=channels)
    assert located(one, Channel.DUTY, PERIOD_S) == (one, None)


def test_a_late_sample_is_told_from_a_late_command_by_a_register_that_is_seldom_made():
    late_s = -0.008
    told = seen(*MOTIONS, truth={"read_skew": {"skew_s": late_s}})
    straight = seen(*MOTIONS)
    # a duty is of its own instant, whatever the age of the angles: that of the joint as it was
    pairs = zip(told, straight, strict=True)
    duties = [held(one)[0].channels[Channel.DUTY] for one in straight]
    observed = [
        replace(one, channels=dict(one.channels) | {Channel.DUTY: duty})
        for (one, _), duty in zip(pairs, duties, strict=True)
    ]
    model = JointModel(read_model(robot()), robot(), observed, load_refresh_s=PERIOD_S)
    before = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    skew = confirm(model, before, effect("read_skew"), np.append(before.z, late_s / 0.005))
    delay = confirm(model, before, effect("transport_delay"), np.append(before.z, 1.0))
    assert skew.deflated > delay.deflated + 20.0
    (knob,) = skew.fit.hypothesis.knobs
    assert knob.value(skew.fit.z[-1]) == pytest.approx(late_s, abs=0.001)
    assert len(model.residuals(skew.fit.hypothesis, [skew.fit.z])[0][0, Kind.DUTY].value) > 30
