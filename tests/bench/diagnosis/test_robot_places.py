from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block
from bench.diagnosis.robot_features import RobotKind
from bench.diagnosis.robot_places import mismatch

JOINTS = [f"leg{n}.{part}" for n in (1, 2, 3) for part in ("coxa", "femur", "tibia")]
BINS = 24
STANCE = np.tile(np.arange(BINS) < 14, len(JOINTS))
NOISE_RAD = 1e-3


@dataclass
class Stood:
    """A model of one recording whose residual is given."""

    value: np.ndarray

    def __post_init__(self):
        self.base = SimpleNamespace(joints=[SimpleNamespace(name=name) for name in JOINTS])
        row = np.repeat(np.arange(len(JOINTS)), BINS)
        self.features = [SimpleNamespace(joint_row=row, stance=STANCE)]

    def floors(self):
        return {RobotKind.JOINTS: NOISE_RAD}

    def residuals(self, names, z, which):
        t = np.arange(len(self.value)) * 1.0
        return {(0, RobotKind.JOINTS): Block(t, self.value, 0.0 * t)}


FOUND = SimpleNamespace(names=(), z=None)


def noise(seed=5):
    return np.random.default_rng(seed).normal(0.0, NOISE_RAD, STANCE.size)


def rows_of(joints):
    return np.repeat([name in joints for name in JOINTS], BINS)


def test_joints_of_one_kind_that_are_off_in_stance_stand_together():
    femurs = [name for name in JOINTS if name.endswith("femur")]
    (place,) = mismatch(Stood(noise() + 0.01 * (rows_of(femurs) & STANCE)), FOUND, [0])
    assert (place["joints"], place["phase"]) == (femurs, "stance")
    assert 0.9 < place["share"] <= 1.0
    assert place["p_value"] < 1e-6


def test_a_leg_that_stands_out_stands_on_its_own():
    value = noise() + 0.02 * (rows_of(["leg2.tibia"]) & ~STANCE)
    (place,) = mismatch(Stood(value), FOUND, [0])
    assert (place["joints"], place["phase"]) == (["leg2.tibia"], "swing")


def test_noise_has_no_place():
    assert [mismatch(Stood(noise(seed)), FOUND, [0]) for seed in range(20)] == [()] * 20


def test_shares_are_of_the_whole_misfit():
    value = noise() + 0.01 * (rows_of(["leg1.coxa"]) & STANCE)
    value += 0.01 * (rows_of(["leg3.tibia"]) & STANCE)
    found = mismatch(Stood(value), FOUND, [0])
    assert {place["joints"][0] for place in found} == {"leg1.coxa", "leg3.tibia"}
    assert sum(place["share"] for place in found) == pytest.approx(1.0, abs=0.2)
