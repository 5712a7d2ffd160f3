"""Load registers that are renewed oftener than they are read."""

from types import SimpleNamespace

import numpy as np
import pytest
from pendulum_logs import JOINT, logs, robot

from bench.diagnosis.joint.model import JointModel
from bench.diagnosis.joint.rhythm import Register, denied, short_refresh
from bench.diagnosis.observed import Channel, observe
from sim.drive import fields
from sim.model import read_model
from sim.stepped import TICK_S

READ_S, COUNT, STEP = 0.0053, 900, 1.0 / 885.0


def law(t_s):
    """Duty of a joint that follows: even between two goals, with a jump at every goal."""
    goal = np.floor(t_s / READ_S) * READ_S
    return 0.4 * np.sin(3.0 * goal) + 1.5 * (goal - t_s) * np.cos(3.0 * t_s)


def recorded(period_s, age_s=0.0, seed=0, phase=0.3):
    random = np.random.default_rng(seed)
    t_s = 0.0027 + np.cumsum(READ_S * (1.0 + 0.02 * random.normal(size=COUNT)))
    held = (np.floor((t_s - age_s) / period_s - phase) + phase) * period_s
    value = np.round(law(held) / STEP + 1.5 * random.normal(size=COUNT)) * STEP
    samples = SimpleNamespace(t_s=t_s, value=value, good=np.ones(COUNT, bool), quantum=STEP)
    return SimpleNamespace(joint=JOINT, channels={Channel.DUTY: samples})


class Model:
    """What is asked of a model: what was observed, and the law."""

    def __init__(self, observed, believed_s=0.0):
        servo = SimpleNamespace(drive={"load_refresh_s": believed_s})
        self.robot = SimpleNamespace(
            tables={robot().by_joint[JOINT].servo_id: servo}, by_joint=robot().by_joint
        )
        self.observed = observed

    def law(self, found, z, r, every_s):
        t_s = np.arange(0.0, self.observed[r].channels[Channel.DUTY].t_s[-1] + every_s, every_s)
        return law(t_s)

    def between(self, r, t_s):
        """Reads are as dense as motions want them."""
        return np.zeros(len(t_s))


FOUND = SimpleNamespace(hypothesis=None, z=None)


def seen(*periods_s, believed_s=0.0, **how):
    observed = [recorded(p, seed=k, phase=0.1 + 0.2 * k, **how) for k, p in enumerate(periods_s)]
    return short_refresh(Model(observed, believed_s), FOUND)


@pytest.mark.parametrize("period_s", [0.0016, 0.00257, 0.0072])
def test_a_period_below_that_of_reads_is_found_within_its_interval(period_s):
    cause = seen(*3 * [period_s])
    assert cause.effect == "load_refresh"
    estimate = cause.parameters["period_s"]
    assert estimate.value == pytest.approx(period_s, rel=1e-3)
    assert estimate.ci95[0] <= period_s <= estimate.ci95[1]
    assert cause.held_out_gain_nats > 0.0


@pytest.mark.parametrize("period_s", [TICK_S, 0.1 * TICK_S])
def test_a_register_that_is_renewed_in_every_tick_is_always_new(period_s):
    assert seen(*3 * [period_s]) is None


@pytest.mark.parametrize("age_s", [0.001, 0.004])
def test_a_register_that_is_late_by_the_same_age_at_every_read_has_no_period(age_s):
    assert seen(*3 * [0.1 * TICK_S], age_s=age_s) is None


def test_a_servo_that_is_known_to_hold_its_register_is_judged_by_its_changes():
    assert seen(*3 * [0.00257], believed_s=0.13) is None


def test_a_law_that_is_wrong_is_no_period():
    one = recorded(0.1 * TICK_S)
    one.channels[Channel.DUTY].value += 0.02 * np.sin(40.0 * one.channels[Channel.DUTY].t_s)
    assert short_refresh(Model([one, one]), FOUND) is None


def register(value):
    """Read every 0.1 s."""
    return Register(0.1 * np.arange(len(value)), np.asarray(value), np.zeros(1), STEP, STEP)


def test_a_register_that_jumps_twice_within_a_period_does_not_have_it():
    rest = [0.0] * 8
    moves = register(3 * [*rest, 0.2, 0.4, 0.1])
    held = register(3 * [*rest, 0.2, 0.2, 0.2, 0.4, 0.4, 0.1, 0.1, 0.1])
    assert denied([moves], 0.25)
    assert not denied([moves], 0.15)
    assert not denied([held], 0.25)
    assert not denied([held, held, held, register([*rest, 0.2, 0.4])], 0.25)


class Unsure(Model):
    """Reads so far apart that nobody knows the duty between them."""

    def between(self, r, t_s):
        return np.full(len(t_s), 0.05)


def test_a_law_that_is_not_known_between_reads_shows_no_period():
    observed = [recorded(0.00257, seed=k, phase=0.1 + 0.2 * k) for k in range(3)]
    assert short_refresh(Model(observed), FOUND) is not None
    assert short_refresh(Unsure(observed), FOUND) is None


def test_a_law_is_as_far_off_between_reads_as_motions_are_bent():
    told = observe(logs(motions=["slow"], duration_s=1.0), robot(), JOINT)
    model = JointModel(read_model(robot()), robot(), told)
    (one,) = told
    times = one.position.t_s
    gain = max(one.replay.start[fields.GAIN_CW], one.replay.start[fields.GAIN_CCW])
    for angles, wanted in ((2.0 * times, 0.0), (3.0 * times**2, gain * 6.0 * 0.01**2 / 8.0)):
        one.position.value[:] = angles
        assert model.between(0, times[5:-5]) == pytest.approx(wanted, rel=0.05, abs=1e-9)
