"""Load registers that are renewed more seldom than they are read."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.joint.renewed import load_refresh
from bench.diagnosis.observed import Channel
from bench.diagnosis.periods import LEAST

READ_S = 0.01


def seen(period_s, count=1500, seed=0, channel=Channel.DUTY):
    random = np.random.default_rng(seed)
    t = READ_S * (np.arange(count) + random.uniform(-0.05, 0.05, count))
    renewed = np.floor((t - 0.013) / period_s) * period_s if period_s else t
    value = np.round(200.0 * np.sin(1.7 * renewed)) / 1000.0
    samples = SimpleNamespace(t_s=t, value=value)
    return SimpleNamespace(joint="arm", channels={channel: samples})


def test_a_register_that_is_new_at_every_read_is_none():
    assert load_refresh([seen(0.0)], 0.0) is None


@pytest.mark.parametrize("period_s", [0.05, 0.13, 0.3])
def test_a_period_is_found_within_its_interval(period_s):
    recordings = [seen(period_s, seed=k) for k in range(3)]
    cause = load_refresh(recordings, 0.0)
    found = cause.parameters["period_s"]
    assert found.ci95[0] <= period_s <= found.ci95[1]
    assert found.value == pytest.approx(period_s, rel=0.02)
    assert cause.held_out_gain_nats > 0.0


def test_the_period_of_the_servos_file_is_no_finding():
    assert load_refresh([seen(0.13)], 0.13) is None
    assert load_refresh([seen(0.26)], 0.13) is not None


def test_a_load_that_seldom_changes_is_not_one_that_is_seldom_renewed():
    slow = seen(0.0)
    slow.channels[Channel.DUTY].value = np.round(
        8.0 * np.sin(0.9 * slow.channels[Channel.DUTY].t_s)
    )
    assert load_refresh([slow, slow, slow], 0.0) is None


def test_few_changes_say_nothing():
    assert load_refresh([seen(0.3, count=30 * (LEAST - 5))], 0.0) is None


def test_without_a_load_register_there_is_nothing_to_see():
    assert load_refresh([seen(0.13, channel=Channel.VOLTAGE)], 0.0) is None
