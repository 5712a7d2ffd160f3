from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.joint.lost import lost_samples
from bench.diagnosis.observed import lonely, sound
from bench.diagnosis.smooth import smooth

STEP = 0.0015


def seen(value):
    t = 0.005 * np.arange(len(value))
    position = SimpleNamespace(t_s=t, value=value, good=lonely(value, STEP))
    return SimpleNamespace(joint="arm", position=position)


def sweep(count=400):
    return np.round(np.sin(0.02 * np.arange(count)) / STEP) * STEP


def test_smooth_motion_has_lost_nothing():
    assert lost_samples([seen(sweep())], 0.002) is None


def test_single_wild_samples_are_counted_with_an_interval():
    value = sweep()
    value[[50, 180, 333]] = -3.0
    cause = lost_samples([seen(value), seen(sweep())], 0.002)
    assert cause.effect == "lost_samples"
    estimate = cause.parameters["share"]
    assert estimate.value == pytest.approx(3 / 800)
    assert estimate.ci95[0] < 3 / 800 < estimate.ci95[1]
    assert cause.held_out_gain_nats > 0.0


@pytest.mark.parametrize("counts", [16, -16, 64])
def test_a_glitch_in_the_midst_of_a_fast_motion_is_lost(counts):
    t_s = 0.0053 * np.arange(400)
    value = np.round(np.sin(6.0 * t_s) / STEP) * STEP
    value[150] += counts * STEP
    assert np.flatnonzero(~smooth(t_s, value, STEP)).tolist() == [150]


def test_a_body_that_is_jerked_has_lost_nothing():
    """A spring's swing after a step, read 28 times a second: six reads a turn."""
    t_s = np.arange(0.0, 4.0, 1 / 28)
    swing = np.where(t_s < 1.0, 0.0, 1.0 - np.exp(-3.0 * (t_s - 1.0)) * np.cos(28.0 * (t_s - 1.0)))
    assert smooth(t_s, np.round(0.5 * swing / STEP) * STEP, STEP).all()


def overshoot():
    """A step of a soft joint: what rests, shoots over by twelve counts, and comes back."""
    value = np.full(200, 0.0)
    value[100:110] = [20, 88, 153, 199, 211, 200, 184, 172, 168, 167]
    value[110:] = 167
    return 0.036 * np.arange(200), value * STEP


def test_the_top_of_an_overshoot_is_no_glitch():
    t_s, value = overshoot()
    assert not lonely(value, STEP).all()
    assert sound(t_s, value, STEP).all()


@pytest.mark.parametrize("place", [1, 50, 104, 107, 198])
def test_a_wild_angle_is_a_glitch_before_during_and_after_the_step(place):
    t_s, value = overshoot()
    value[place] = -300 * STEP
    assert np.flatnonzero(~sound(t_s, value, STEP)).tolist() == [place]


def test_a_hole_in_a_recording_is_no_glitch():
    t_s = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(3.0, 4.0, 0.01)])
    value = np.round(np.sin(2.0 * t_s) / STEP) * STEP
    assert smooth(t_s, value, STEP).all()


def test_reads_of_one_instant_are_no_glitch():
    t_s = 0.01 * np.floor(np.arange(100) / 2.0)
    assert smooth(t_s, np.round(np.sin(9.0 * t_s) / STEP) * STEP, STEP).all()
