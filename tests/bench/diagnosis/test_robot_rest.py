"""What is left of a whole robot's misfit, on residuals that are given."""

from copy import copy
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block
from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.model import ENGINES_RAD
from bench.diagnosis.robot.rest import LOCAL, MISFIT, MORE, SHARE, rest_of

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
            rounding_rad2=np.zeros(len(ROW)),
        )
        self.features = [one] * len(values)
        self.motion = list(range(len(values)))
        self.chances = [np.zeros(len(ROW)) for _ in values]

    def chance(self, r):
        return self.chances[r]

    def residuals(self, names, z, which):
        t = np.arange(len(ROW)) * 1.0
        return {(r, RobotKind.JOINTS): Block(t, self.values[r], 0.0 * t) for r in which}


def noise(seed, size_rad=ENGINES_RAD):
    return size_rad * np.random.default_rng(seed).standard_normal(len(ROW))


def structure(times, joints=(1, 4)):
    """In the femurs' stance, so much that it is ``times`` what engines differ by, RMS."""
    there = np.isin(ROW, joints) & (BIN < 14)
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
    values = [noise(seed, 1e-5) + structure(0.9 * MORE, range(6)) for seed in (1, 2, 3)]
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


def in_place(times, joint=4):
    """In one joint's stance, ``times`` what engines differ by there."""
    return times * ENGINES_RAD * ((joint == ROW) & (BIN < 14))


@pytest.mark.parametrize(("times", "unexplained"), [(0.85, False), (1.15, True)])
def test_one_joint_far_off_in_one_phase_is_unexplained_though_the_mean_over_all_is_not(
    times, unexplained
):
    values = [noise(seed, 2e-4) + in_place(times * LOCAL) for seed in (1, 2, 3)]
    rest = rest_of(Left(*values), FOUND, [0, 1], [2])
    assert not rest.everywhere
    assert rest.structured is unexplained
    assert (rest.places[0].joint, rest.places[0].phase) == ("leg2.femur", "stance")
    assert rest.places[0].predicted_rad == pytest.approx(times * LOCAL * ENGINES_RAD, rel=0.1)
    if unexplained:
        (row,) = rest.told()
        assert (row["joints"], row["where"]) == (["leg2.femur"], ["stance"])
        assert row["predictable_rad"] == rest.places[0].predicted_rad


def test_both_phases_of_a_joint_are_told_in_one_row():
    whole = 1.5 * LOCAL * ENGINES_RAD * (ROW == 4)
    values = [noise(seed, 2e-4) + whole for seed in (1, 2)]
    rest = rest_of(Left(*values), FOUND, [0], [1])
    *_, row = rest.told()
    assert (row["joints"], sorted(row["where"])) == (["leg2.femur"], ["stance", "swing"])


def test_one_joint_of_which_others_foretell_little_is_not_unexplained():
    values = [noise(1) + in_place(2.0 * LOCAL), noise(2) - in_place(2.0 * LOCAL)]
    assert not rest_of(Left(*values), FOUND, [0], [1]).structured
    scattered = [3.0 * noise(k) + in_place(1.2 * LOCAL) for k in (1, 2, 3)]
    rest = rest_of(Left(*scattered), FOUND, [0, 1], [2])
    assert rest.places[0].predicted_rad > LOCAL * ENGINES_RAD
    assert not rest.local


def test_what_is_left_everywhere_is_told_of_all_joints():
    values = [noise(seed) + structure(2.0 * MORE) for seed in (1, 2, 3)]
    rest = rest_of(Left(*values), FOUND, [0, 1], [2])
    assert rest.told()[0]["joints"] == ["leg1.femur", "leg2.femur"]


@pytest.mark.parametrize("same", [True, False])
def test_windows_of_time_foretell_those_of_the_same_motion_alone(same):
    left = Left(*(noise(seed) + structure(2.0 * MORE) for seed in (1, 2)))
    for features in left.features:
        features.phase = None
        features.shows = lambda other: same
    rest = rest_of(left, FOUND, [0], [1])
    assert rest.structured is same
    assert (rest.predicted_rad > 0.0) is same


def test_what_is_chance_where_a_robot_stands_is_not_unexplained():
    values = [noise(seed, 2e-4) + structure(2.0 * MORE) for seed in (1, 2)]
    assert rest_of(Left(*values), FOUND, [0], [1]).structured
    left = Left(*values)
    left.chances = [np.full(len(ROW), (2.5 * MORE * ENGINES_RAD) ** 2)] * 2
    rest = rest_of(left, FOUND, [0], [1])
    assert not rest.everywhere
    assert rest.sound_rad == pytest.approx(ENGINES_RAD * np.hypot(1.0, 2.5 * MORE))
    far = [noise(seed, 2e-4) + structure(6.0 * MORE) for seed in (1, 2)]
    left.values = far
    assert rest_of(left, FOUND, [0], [1]).everywhere


def test_a_rest_that_nothing_foretells_may_be_larger_where_a_robot_stands():
    left = Left(*(noise(seed, 1.2 * MISFIT * ENGINES_RAD) for seed in (1, 2)))
    assert rest_of(left, FOUND, [0], [1]).everywhere
    left.chances = [np.full(len(ROW), ENGINES_RAD**2)] * 2
    assert not rest_of(left, FOUND, [0], [1]).everywhere


def test_chance_of_one_joint_hides_nothing_in_another():
    values = [noise(seed, 2e-4) + in_place(1.5 * LOCAL) for seed in (1, 2)]
    for joint, hidden in ((4, True), (1, False)):
        left = Left(*values)
        left.chances = [np.where(joint == ROW, (2.0 * LOCAL * ENGINES_RAD) ** 2, 0.0)] * 2
        assert bool(rest_of(left, FOUND, [0], [1]).local) is not hidden


@pytest.mark.parametrize("standing", [(0, 1), (0,), (1,), ()])
def test_rounding_that_recordings_have_in_common_foretells_nothing(standing):
    values = [noise(seed, 2e-4) + 1.2 * ENGINES_RAD for seed in (1, 2)]
    left = Left(*values)
    left.features = [copy(left.features[0]) for _ in values]
    for r in standing:
        left.features[r].rounding_rad2 = np.full(len(ROW), ENGINES_RAD**2)
    rest = rest_of(left, FOUND, [0], [1])
    both = standing == (0, 1)
    assert rest.structured is not both
    less = ENGINES_RAD**2 if both else 0.0
    assert rest.predicted_rad**2 + less == pytest.approx(float(np.mean(values[0] * values[1])))


@pytest.mark.parametrize(("others", "unexplained"), [(-0.3, False), (0.3, True)])
def test_structure_of_one_recording_that_most_deny_is_none(others, unexplained):
    shape = structure(1.4 * MORE)
    rest = rest_of(Left(shape, 3.0 * shape, others * shape, others * shape), FOUND, [0], [1, 2, 3])
    assert rest.predicted_rad > MORE * ENGINES_RAD
    assert rest.share > SHARE
    assert rest.structured is unexplained
