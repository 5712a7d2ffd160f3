"""Sine, cosine and decay of the compiled drives against NumPy's."""

import numpy as np
import pytest
from numba import njit

from sim.drive.elementary import GONE, decay, sine_cosine


@njit
def _turned(angles):
    out = np.empty((2, angles.size))
    for k in range(angles.size):
        out[0, k], out[1, k] = sine_cosine(angles[k])
    return out


@njit
def _decayed(some):
    out = np.empty(some.size)
    for k in range(some.size):
        out[k] = decay(some[k])
    return out


@pytest.mark.parametrize("scale", [1e-9, 0.1, 1.0, 10.0, 2000.0])
def test_sine_and_cosine_are_numpys_within_a_bit_or_two(scale):
    angles = np.random.default_rng(1).uniform(-scale, scale, 20_000)
    sine, cosine = _turned(angles)
    assert np.abs(sine - np.sin(angles)).max() < 3e-16
    assert np.abs(cosine - np.cos(angles)).max() < 3e-16


def test_quarters_of_a_turn_are_in_their_quadrants():
    angles = np.concatenate([k * np.pi / 2 + np.linspace(-1e-9, 1e-9, 21) for k in range(-9, 10)])
    sine, cosine = _turned(angles)
    assert np.abs(sine - np.sin(angles)).max() < 3e-16
    assert np.abs(cosine - np.cos(angles)).max() < 3e-16


def test_a_decay_is_numpys_exponential():
    some = np.concatenate([np.linspace(0.0, GONE, 10_001), np.geomspace(1e-300, 1.0, 1001)])
    assert np.abs(_decayed(some) / np.exp(-some) - 1.0).max() < 1e-13
    assert _decayed(np.array([0.0]))[0] == 1.0


def test_what_has_decayed_decays_no_further():
    assert 0.0 < _decayed(np.array([1e3, np.inf])).max() < 1e-17


def test_what_is_no_number_stays_none():
    assert np.isnan(_turned(np.array([np.nan, np.inf]))).all()
