"""The rhythm: it locks into a tripod from any start, and its integration can be trusted."""

import numpy as np
import pytest

from busemu.tables import load_robot
from hal.cpg import Network, OscillatorParameters, Oscillators, tripods
from hal.cpg.network import neighbours
from hal.legs import Legs

PERIOD_S = 1.0
LEGS = Legs.of(load_robot("phantomx"))
FIRST = np.array([name in ("leg1", "leg3", "leg6") for name in LEGS.names])


def phases_over(network, seconds, step_s=0.02):
    phases, amplitudes = [], []
    for _ in range(round(seconds / step_s)):
        network.advance(step_s)
        rhythm = network.rhythm()
        phases.append(rhythm.phase)
        amplitudes.append(rhythm.amplitude)
    return np.array(phases), np.array(amplitudes)


def tripod_error(phases):
    """How far the legs are from two tripods in antiphase [periods], at each instant."""
    turns = np.exp(2j * np.pi * (phases - np.where(FIRST, 0.0, 0.5)))
    mean = turns.mean(axis=1, keepdims=True)
    return np.abs(np.angle(turns / mean)).max(axis=1) / (2 * np.pi)


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_the_tripods_are_front_and_rear_of_one_side_with_the_middle_of_the_other(name):
    legs = Legs.of(load_robot(name))
    assert tripods(legs) == (("leg1", "leg3", "leg6"), ("leg2", "leg4", "leg5"))


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_each_tripods_triangle_holds_the_middle_of_the_trunk(name):
    legs = Legs.of(load_robot(name))
    feet = legs.feet_m(legs.stretched(0.0, 0.45, -1.95))[:, :2]
    for tripod in tripods(legs):
        a, b, c = (feet[legs.names.index(leg)] for leg in tripod)
        turns = [np.cross((*(q - p), 0.0), (*-p, 0.0))[2] for p, q in ((a, b), (b, c), (c, a))]
        assert len({np.sign(turn) for turn in turns}) == 1


def test_the_links_are_symmetric_and_give_every_leg_the_same_inhibition():
    weights = neighbours(LEGS)
    assert (weights == weights.T).all()
    assert (weights >= 0.0).all()
    assert weights.sum(axis=1) == pytest.approx(np.ones(6))
    assert (weights[np.ix_(FIRST, FIRST)] == 0.0).all()


def test_the_network_locks_into_a_tripod_from_fifty_random_starts():
    for seed in range(50):
        phases, amplitudes = phases_over(Network(LEGS, PERIOD_S, seed), 8.0)
        error = tripod_error(phases)
        assert error[-50:].max() < 0.02, f"seed {seed}"
        assert amplitudes[-50:] == pytest.approx(np.ones((50, 6)), abs=0.02)


def test_the_start_up_shows_a_transient_and_seeds_differ():
    starts = []
    for seed in range(10):
        phases, amplitudes = phases_over(Network(LEGS, PERIOD_S, seed), 0.2)
        starts.append(phases[0])
        assert tripod_error(phases).max() > 0.05
        assert amplitudes[0].mean() < 0.5
    assert np.ptp(starts, axis=0).min() > 0.1


def test_the_same_seed_gives_the_same_walk():
    a, _ = phases_over(Network(LEGS, PERIOD_S, 3), 2.0)
    b, _ = phases_over(Network(LEGS, PERIOD_S, 3), 2.0)
    assert (a == b).all()


def test_locked_phase_grows_evenly_once_a_period():
    network = Network(LEGS, PERIOD_S, 5)
    network.advance(10.0)
    phases, _ = phases_over(network, 3.0)
    growth = np.mod(np.diff(phases, axis=0), 1.0)
    assert growth == pytest.approx(np.full_like(growth, 0.02), abs=0.002)


def test_the_extensor_leads_in_the_first_half_of_the_phase():
    network = Network(LEGS, PERIOD_S, 5)
    network.advance(10.0)
    for _ in range(100):
        network.advance(0.013)
        rhythm = network.rhythm()
        sure = np.abs(np.mod(rhythm.phase + 0.25, 0.5) - 0.25) > 0.01
        assert (rhythm.extensor_leads == (rhythm.phase < 0.5))[sure].all()


def test_the_state_depends_on_the_instant_and_not_on_the_calls():
    one, many = Network(LEGS, PERIOD_S, 7), Network(LEGS, PERIOD_S, 7)
    one.advance(1.0)
    for _ in range(1000):
        many.advance(0.001)
    assert many.oscillators.state == pytest.approx(one.oscillators.state, abs=1e-9)


def test_halving_the_step_changes_nothing_that_matters():
    coarse = Network(LEGS, PERIOD_S, 7)
    fine = Network(LEGS, PERIOD_S, 7, step=0.025)
    rough = Network(LEGS, PERIOD_S, 7, step=0.4)
    for network in (coarse, fine, rough):
        network.advance(10.0)
    difference = np.abs(coarse.oscillators.state - fine.oscillators.state).max()
    assert difference < 1e-3
    assert np.abs(rough.oscillators.state - fine.oscillators.state).max() > 10 * difference


def test_the_integration_stays_bounded_at_much_larger_steps():
    for step in (0.05, 0.2, 0.5, 1.0):
        network = Network(LEGS, PERIOD_S, 1, step=step)
        network.advance(100.0)
        assert np.abs(network.oscillators.state).max() < 3.0


def test_weights_outside_matsuokas_condition_are_refused():
    with pytest.raises(ValueError, match=r"between 1\.5 and 3\.5"):
        OscillatorParameters(mutual_inhibition=1.4)
    with pytest.raises(ValueError, match=r"between 1\.5 and 3\.5"):
        OscillatorParameters(mutual_inhibition=3.6)


def test_a_single_unit_alternates_extensor_and_flexor():
    state = np.array([[0.2], [0.0], [0.0], [0.0]])
    unit = Oscillators(OscillatorParameters(), np.zeros((1, 1)), state)
    unit.advance(60.0)
    lead = []
    for _ in range(400):
        unit.advance(0.1)
        lead.append(unit.state[0, 0] > unit.state[1, 0])
    assert 4 <= np.count_nonzero(np.diff(lead)) <= 12


def test_time_does_not_run_back():
    with pytest.raises(ValueError, match="cannot go back"):
        Network(LEGS, PERIOD_S, 1).advance(-0.1)
