"""Fits of a whole robot on a model whose truth is known: linear nuisances, one bent knob."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block
from bench.diagnosis.robot_features import RobotKind
from bench.diagnosis.robot_fit import Sight

ROWS, NUISANCES = 400, 3
NOISE_RAD = 1e-3
TIMES = np.arange(ROWS) * 0.05
RANDOM = np.random.default_rng(3)
TRACES = 1e-2 * RANDOM.standard_normal((ROWS, NUISANCES))
BENT = 1e-2 * RANDOM.standard_normal(ROWS)
BOUNDS = (0.0, 4.0)


class Pretended:
    """One recording: nuisances add up, the knob does it by its square root."""

    def __init__(self, nuisances, knob, noise_rad=NOISE_RAD, seed=1):
        noise = noise_rad * np.random.default_rng(seed).standard_normal(ROWS)
        self.data = TRACES @ np.asarray(nuisances) + self.effect(knob) + noise
        self.nuisances = [SimpleNamespace(name=str(k)) for k in range(NUISANCES)]
        self.placed = {"bent": SimpleNamespace(knob=SimpleNamespace(bounds=BOUNDS))}
        self.motion = [0]
        self.traces = [{RobotKind.JOINTS: TRACES}]

    @staticmethod
    def effect(knob):
        return BENT * np.sqrt(max(knob, 0.0))

    def floors(self):
        return {RobotKind.JOINTS: NOISE_RAD}

    def recorded(self, r, kind):
        return self.data

    def residuals(self, names, z, which):
        knob = z[NUISANCES] if names else 0.0
        value = self.data - TRACES @ z[:NUISANCES] - self.effect(knob)
        return {(0, RobotKind.JOINTS): Block(TIMES, value, np.zeros(ROWS))}


def sight(model):
    return Sight(model, [0], RobotKind)


def test_nuisances_are_found_as_far_as_their_priors_let_them():
    true = np.array([0.5, -1.0, 0.0])
    found = sight(Pretended(true, 0.0)).fit()
    assert found.nuisances == pytest.approx(true, abs=0.05)
    assert len(found.knobs) == 0


def test_a_knob_is_found_with_its_error():
    model = Pretended([0.3, 0.0, 0.0], 2.0)
    found = sight(model).fit(("bent",), np.array([0.0, 0.0, 0.0, 0.5]))
    believed, sandwich = sight(model).covariances(found)
    deviation = float(np.sqrt(believed[3, 3]))
    assert abs(found.settings[0][1] - 2.0) < 4.0 * deviation
    assert 0.3 < sandwich[3, 3] / believed[3, 3] < 3.0


def test_a_knob_stays_within_its_bounds():
    found = sight(Pretended([0.0, 0.0, 0.0], 9.0)).fit(("bent",), np.array([0.0, 0.0, 0.0, 1.0]))
    assert found.settings == (("bent", pytest.approx(BOUNDS[1])),)


def test_what_is_there_gains_and_what_is_not_does_not():
    for knob, gains in ((2.0, True), (0.0, False)):
        own = sight(Pretended([0.0, 0.0, 0.0], knob))
        base = own.fit()
        with_it = own.fit(("bent",), np.append(base.z, 0.5), base.noise)
        assert (base.cost - with_it.cost > 20.0) is gains


def test_doing_without_an_effect_gives_the_fit_that_never_had_it():
    own = sight(Pretended([0.5, 0.0, 0.0], 1.0))
    base = own.fit()
    with_it = own.fit(("bent",), np.append(base.z, 0.5))
    assert own.without(with_it, "bent").cost == pytest.approx(base.cost, abs=1.0)
