"""What sound robots that stand do otherwise than traces foretell."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.spread import APART, BOTH, DRAWS, WITHIN, of_starts, of_tolerances

J = RobotKind.JOINTS
ROW = np.repeat([0, 1], 30)
NUISANCES = [SimpleNamespace(name=f"mass {k}", trial="mass", ends=(-0.1, 0.1)) for k in range(3)]


def model(*walks):
    """Motions that walk or do not; what tolerances do to them is foretold to be nothing."""
    features = [
        SimpleNamespace(phase=object() if walk else None, joint_row=ROW, bin=np.arange(60) % 30)
        for walk in walks
    ]
    return SimpleNamespace(
        features=features,
        nuisances=NUISANCES,
        modelled=lambda settings, z, m: {J: np.zeros(len(ROW))},
    )


def replaying(asked, away):
    def run(jobs):
        asked.extend(jobs)
        return [{J: away} for _ in jobs]

    return run


def test_what_traces_do_not_foretell_is_spread_over_a_second_of_the_same_joint():
    away, asked = np.zeros(len(ROW)), []
    away[10] = 0.009
    square = of_tolerances(model(True, False), [0, 1], replaying(asked, away))
    assert list(square) == [1]
    near = np.arange(len(ROW))[10 - APART : 11 + APART]
    assert square[1][near] == pytest.approx(BOTH * 0.009**2 / (2 * APART + 1))
    assert np.count_nonzero(square[1]) == len(near)
    assert [job.recording for job in asked] == [1] * DRAWS
    assert len({job.nuisances for job in asked}) == DRAWS
    assert max(abs(z) for job in asked for z in job.nuisances) == pytest.approx(0.1)


def test_it_is_the_same_at_a_joints_first_window_as_in_its_middle():
    square = of_tolerances(model(False), [0], replaying([], np.full(len(ROW), 0.01)))
    assert square[0] == pytest.approx(BOTH * 1e-4)


def test_what_traces_foretell_is_no_spread():
    sound = model(False)
    sound.modelled = lambda settings, z, m: {J: np.full(len(ROW), 0.01)}
    assert not of_tolerances(sound, [0], replaying([], np.full(len(ROW), 0.01)))[0].any()


def test_a_robot_that_the_engine_cannot_run_tells_nothing():
    square = of_tolerances(model(False), [0], replaying([], np.full(len(ROW), np.nan)))
    assert not square[0].any()


def test_tolerances_are_half_of_what_they_may_be():
    wide = [SimpleNamespace(name=f"mass {k}", trial="mass", ends=(-9.0, 9.0)) for k in range(400)]
    sound, asked = model(False), []
    sound.nuisances = wide
    of_tolerances(sound, [0], replaying(asked, np.zeros(len(ROW))))
    every = np.array([job.nuisances for job in asked])
    assert np.std(every) == pytest.approx(WITHIN, rel=0.05)


def test_replays_that_start_otherwise_scatter_by_their_mean_square():
    plain = {0: {J: np.zeros(len(ROW))}}
    square = of_starts(plain, replaying([], np.full(len(ROW), 0.002)))
    assert square[0][J] == pytest.approx(4e-6)
