"""What is left of a whole robot's misfit, on residuals that are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block
from bench.diagnosis.robot_features import RobotKind
from bench.diagnosis.robot_model import ENGINES_RAD
from bench.diagnosis.robot_rest import MISFIT, MORE, rest_of

JOINTS = [f"leg{n}.{part}" for n in (1, 2) for part in ("coxa", "femur", "tibia")]
BINS = 24
ROW = np.repeat(np.arange(len(JOINTS)), BINS)
BIN = np.tile(np.arange(BINS), len(JOINTS))
GOAL = np.sin(2.0 * np.pi * BIN / BINS)
FOUND = SimpleNamespace(names=(), z=None)


class Left:
    """A model whose residuals are given, one a recording; all of one gait."""

    def __init__(self, *values):
        self.values = values
        self.base = SimpleNamespace(joints=[SimpleNamespace(name=name) for name in JOINTS])
        one = SimpleNamespace(
            joint_row=ROW,
            bin=BIN,
            stance=BIN < 14,
            goal_rad=GOAL,
            position_rad=GOAL,
            phase=object(),
        )
        self.features = [one] * len(values)
        self.motion = list(range(len(values)))

    def residuals(self, names, z, which):
        t = np.arange(len(ROW)) * 1.0
        return {(r, RobotKind.JOINTS): Block(t, self.values[r], 0.0 * t) for r in which}


def noise(seed, size_rad=ENGINES_RAD):
    return size_rad * np.random.default_rng(seed).standard_normal(len(ROW))


def structure(times):
    """In the femurs' stance, so much that it is ``times`` what engines differ by, RMS."""
    there = np.isin(ROW, [1, 4]) & (BIN < 14)
    return times * ENGINES_RAD * there / np.sqrt(there.mean())


def test_noise_is_not_foretold():
    rest = rest_of(Left(noise(1), noise(2), noise(3)), FOUND, [0, 1], [2])
    assert not rest.structured
    assert rest.predicted_rad < 0.5 * ENGINES_RAD


def test_what_repeats_is_foretold_in_its_place_and_size():
    values = [noise(seed) + structure(2.0 * MORE) for seed in (1, 2, 3)]
    rest = rest_of(Left(*values), FOUND, [0, 1], [2])
    assert rest.structured
    assert rest.predicted_rad == pytest.approx(2.0 * MORE * ENGINES_RAD, rel=0.1)
    assert rest.joints == ("leg1.femur", "leg2.femur")
    assert rest.where == ("stance",)


def test_what_two_engines_leave_is_not_called_unexplained():
    values = [noise(seed, 1e-5) + structure(0.9 * MORE) for seed in (1, 2, 3)]
    rest = rest_of(Left(*values), FOUND, [0, 1], [2])
    assert rest.share == pytest.approx(1.0, abs=0.05)
    assert not rest.structured


def test_structure_that_other_recordings_deny_is_none():
    values = [noise(1) + structure(2.0 * MORE), noise(2) - structure(2.0 * MORE)]
    assert not rest_of(Left(*values), FOUND, [0], [1]).structured


def test_what_follows_a_term_is_told_by_it():
    values = [noise(seed) + 5.0 * ENGINES_RAD * GOAL for seed in (1, 2)]
    rest = rest_of(Left(*values), FOUND, [0], [1])
    assert next(iter(rest.terms)) == "position"
    assert rest.terms["position"] > 0.9


def test_a_recording_without_another_of_its_kind_foretells_nothing():
    assert rest_of(Left(noise(1) + structure(9.0)), FOUND, [0], [0]).predicted_rad == 0.0


def test_a_rest_far_beyond_what_engines_differ_by_is_unexplained_though_nothing_foretells_it():
    for times, unexplained in ((0.9, False), (1.1, True)):
        values = [noise(seed, times * MISFIT * ENGINES_RAD) for seed in (1, 2, 3)]
        rest = rest_of(Left(*values), FOUND, [0, 1], [2])
        assert rest.share < 0.1
        assert rest.structured is unexplained
