import math

import numpy as np
import pytest
from walking_robots import marvin

from bench.diagnosis.robot.gait import BINS, Bins, Phase, commanded_lift, gait_phase
from hal.legs import PARTS, Legs

PERIOD_S = 0.9


def goals(seconds=8.0, period_s=PERIOD_S, drift=0.0, second=0.0, amplitude=0.3):
    """Goals of a tripod gait: coxae swing, femora lift in swing."""
    t = np.arange(0.0, seconds, 0.02)
    cycles = t / period_s * (1.0 + drift * t / seconds)
    found = {}
    for number, leg in enumerate(Legs.of(marvin()).names):
        angle = 2.0 * math.pi * (cycles + 0.5 * (number % 2))
        lift = np.maximum(0.0, np.sin(angle))
        shapes = {
            "coxa": np.cos(angle) + second * np.cos(2.0 * angle),
            "femur": lift,
            "tibia": -1.0 - 0.2 * lift,
        }
        for part in PARTS:
            found[f"{leg}.{part}"] = (t, amplitude * shapes[part])
    return t, cycles, found


def test_the_phase_turns_once_a_period():
    _, _, told = goals()
    phase = gait_phase(told, marvin())
    assert phase.period_s == pytest.approx(PERIOD_S, rel=0.02)
    known = ~np.isnan(phase.cycles)
    slope = np.polyfit(phase.t_s[known], phase.cycles[known], 1)[0]
    assert slope == pytest.approx(1.0 / PERIOD_S, rel=0.005)


def test_the_phase_follows_a_rhythm_that_drifts():
    t, cycles, told = goals(drift=0.08)
    phase = gait_phase(told, marvin())
    at = phase.at(t)
    known = ~np.isnan(at)
    apart = at[known] - cycles[known]
    assert np.ptp(apart) < 0.03


def test_a_strong_second_harmonic_is_not_taken_for_the_rhythm():
    _, _, told = goals(second=1.2)
    assert gait_phase(told, marvin()).period_s == pytest.approx(PERIOD_S, rel=0.02)


def test_phase_zero_is_where_the_first_leg_comes_down():
    t, _, told = goals()
    phase = gait_phase(told, marvin())
    lifted = commanded_lift(told, marvin(), t)[:, 0]
    down = t[1:][np.diff(lifted.astype(int)) == -1]
    at = phase.at(down)
    off = (at[~np.isnan(at)] + 0.5) % 1.0 - 0.5
    assert np.abs(off).max() < 0.04


@pytest.mark.parametrize(
    "told",
    [
        pytest.param({"a": lambda t: 0.0 * t}, id="still"),
        pytest.param({"a": lambda t: 0.1 * t}, id="a slow way"),
        pytest.param({"a": lambda t: np.where(t > 4.0, 0.3, 0.0)}, id="one step"),
        pytest.param({"a": lambda t: np.sin(2.0 * math.pi * (0.4 + 0.3 * t) * t)}, id="a chirp"),
    ],
)
def test_goals_without_a_rhythm_have_no_phase(told):
    t = np.arange(0.0, 8.0, 0.02)
    joints = Legs.of(marvin()).joints
    assert gait_phase({j: (t, told["a"](t)) for j in joints}, marvin()) is None


def test_bins_hold_the_mean_of_their_samples():
    phase = Phase(np.array([0.0, 10.0]), np.array([0.0, 10.0]), 1.0)
    t = np.linspace(0.0, 9.999, 2400)
    bins = Bins.of_phase(phase, t)
    assert bins.turns == 10
    wave = np.sin(2.0 * math.pi * t)
    expected = [wave[np.floor(t % 1.0 * BINS) == k].mean() for k in range(BINS)]
    assert bins.mean(wave) == pytest.approx(expected, abs=1e-12)


def test_scatter_is_the_variance_of_a_bins_mean_between_turns():
    phase = Phase(np.array([0.0, 400.0]), np.array([0.0, 400.0]), 1.0)
    t = np.arange(0.0, 400.0, 0.01)
    bins = Bins.of_phase(phase, t)
    assert bins.scatter(np.sin(2.0 * math.pi * t)).max() < 1e-20
    by_turn = np.random.default_rng(1).normal(0.0, 0.3, 400)[np.floor(t).astype(int)]
    assert bins.scatter(by_turn) == pytest.approx(0.3**2 / 400, rel=0.2)


def test_where_there_is_no_gait_windows_of_time_take_its_place():
    t = np.arange(0.0, 3.0, 0.01)
    bins = Bins.of_time(t, 1.0)
    assert (bins.bin[t < 0.99] == -1).all()
    assert bins.mean(t) == pytest.approx(bins.t_s, abs=0.011)


def test_samples_outside_of_a_span_lie_in_no_bin():
    t, _, told = goals()
    bins = Bins.of_phase(gait_phase(told, marvin()), t)
    some = bins.within(t, (3.0, 4.0))
    inside = (t >= 3.0) & (t <= 4.0)
    assert (some.bin[inside] == bins.bin[inside]).all()
    assert (some.bin[~inside] == -1).all()
    assert some.counts.sum() == inside.sum()
