from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.lost import lost_samples
from bench.diagnosis.observed import lonely

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
