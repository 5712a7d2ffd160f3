from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block
from bench.diagnosis.robot_features import RobotKind
from bench.diagnosis.robot_places import places

JOINTS = [f"leg{n}.{part}" for n in (1, 2, 3) for part in ("coxa", "femur", "tibia")]
BINS = 24
STANCE = np.tile(np.arange(BINS) < 14, len(JOINTS))


@dataclass
class Stood:
    """A model of one recording whose residual is given."""

    value: np.ndarray

    def __post_init__(self):
        self.base = SimpleNamespace(joints=[SimpleNamespace(name=name) for name in JOINTS])
        row = np.repeat(np.arange(len(JOINTS)), BINS)
        self.features = [SimpleNamespace(joint_row=row, stance=STANCE)]

    def residuals(self, hypothesis, vectors, which):
        t = np.arange(len(self.value)) * 1.0
        return [{(0, RobotKind.JOINTS): Block(t, self.value, 0.0 * t)}]


FOUND = SimpleNamespace(hypothesis=None, z=None)


def residual(where, size):
    value = np.random.default_rng(5).normal(0.0, 1e-3, STANCE.size)
    part = np.repeat([name.split(".")[1] for name in JOINTS], BINS)
    value[(part == where) & STANCE] += size
    return value


def test_the_place_of_a_misfit_comes_first_with_its_share_and_mean():
    first, *rest = places(Stood(residual("femur", 0.01)), FOUND, [0])
    assert (first.part, first.phase) == ("femur", "stance")
    assert first.mean_rad == pytest.approx(0.01, rel=0.05)
    assert first.joints == ("leg1.femur", "leg2.femur", "leg3.femur")
    assert first.share + sum(place.share for place in rest) == pytest.approx(1.0)
    assert first.share > 0.9
    assert first.p_value < 0.01


def test_a_misfit_that_knows_no_phase_has_no_place():
    for seed in range(3):
        value = np.random.default_rng(seed).normal(0.0, 1e-3, STANCE.size)
        assert min(place.p_value for place in places(Stood(value), FOUND, [0])) > 0.01
