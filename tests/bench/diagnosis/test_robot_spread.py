"""What sound robots that stand do otherwise than traces foretell."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.spread import (
    APART,
    BOTH,
    DRAWS,
    WITHIN,
    Chance,
    of_starts,
    of_tolerances,
)

J = RobotKind.JOINTS
ROW = np.repeat([0, 1], 30)
JOINTS = [SimpleNamespace(segment=segment) for segment in ("femur", "femur")]
NUISANCES = [SimpleNamespace(name=f"mass {k}", trial="mass", ends=(-0.1, 0.1)) for k in range(3)]


def model(*walks):
    """Motions that walk or do not; what tolerances do to them is foretold to be nothing."""
    features = [
        SimpleNamespace(
            phase=object() if walk else None,
            joint_row=ROW,
            bin=np.arange(60) % 30,
            rounding_rad2=np.full(len(ROW), 1e-8),
        )
        for walk in walks
    ]
    return SimpleNamespace(
        features=features,
        motion=list(range(len(walks))),
        traces=[{J: np.zeros((len(ROW), len(NUISANCES)))} for _ in walks],
        floors=lambda: {J: 1e-4},
        base=SimpleNamespace(joints=JOINTS),
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
    away[10], away[20] = 0.009, -0.009
    found = of_tolerances(model(True, False), (), replaying(asked, away))
    assert not found[0].total.any()
    near = np.arange(len(ROW))[10 - APART : 11 + APART]
    assert found[1].varying[near] == pytest.approx(BOTH * 0.009**2 / (2 * APART + 1))
    assert np.count_nonzero(found[1].varying) == 2 * len(near)
    assert not found[1].lasting.any()
    assert [job.recording for job in asked] == [1] * DRAWS
    assert len({job.nuisances for job in asked}) == DRAWS
    assert sorted(job.jitter for job in asked) == list(range(1, DRAWS + 1))
    assert max(abs(z) for job in asked for z in job.nuisances) == pytest.approx(0.1)


def test_it_is_the_same_at_a_joints_first_window_as_in_its_middle():
    away = np.where(np.arange(len(ROW)) % 2, 0.01, -0.01)
    found = of_tolerances(model(False), (), replaying([], away))
    assert found[0].varying == pytest.approx(BOTH * 1e-4)


def test_what_a_joint_is_off_all_along_is_told_apart_and_joints_of_a_kind_share_it():
    away = np.where(ROW == 0, 0.01, 0.0)
    away[5] += 0.006
    away[6] -= 0.006
    sound = model(False)
    (found,) = of_tolerances(sound, (), replaying([], away))
    assert found.lasting == pytest.approx(BOTH * 0.5e-4)
    assert found.varying.sum() < found.lasting.sum()
    sound.base.joints = [SimpleNamespace(segment=segment) for segment in ("femur", "tibia")]
    (found,) = of_tolerances(sound, (), replaying([], away))
    assert found.lasting == pytest.approx(np.where(ROW == 0, BOTH * 1e-4, 0.0))
    assert found.total == pytest.approx(found.varying + found.lasting)


def test_repeats_do_not_tell_what_lasts_as_often_as_there_are_of_them():
    chance = Chance(np.zeros(len(ROW)), np.where(ROW == 0, 1e-4, 4e-4))
    sways = chance.sways(ROW, 3, 1)
    assert sways[:, 0] == pytest.approx(np.where(ROW == 0, 0.01, 0.0))
    assert sways[:, 1] == pytest.approx(np.where(ROW == 1, 0.02, 0.0))
    assert not sways[:, 2].any()
    assert chance.sways(ROW, 3, 4) == pytest.approx(2.0 * sways)


def test_what_traces_foretell_is_no_spread():
    sound = model(False)
    sound.modelled = lambda settings, z, m: {J: np.full(len(ROW), 0.01)}
    (found,) = of_tolerances(sound, (), replaying([], np.full(len(ROW), 0.01)))
    assert not found.total.any()


def test_what_fits_take_for_a_tolerance_is_no_chance_where_they_are_made_but_where_they_judge():
    """A wave that a tolerance makes as well; in a motion that is not fitted it makes the other."""
    wave = np.where(np.arange(len(ROW)) % 2, 0.01, -0.01)
    sound = model(False, False)
    for m, way in enumerate((1.0, -1.0)):
        sound.traces[m][J][:, 1] = way * 10.0 * wave
    found = of_tolerances(sound, {1}, replaying([], wave))
    assert np.sqrt(found[0].varying / BOTH) == pytest.approx(0.0, abs=2e-4)
    assert np.sqrt(found[1].varying / BOTH) == pytest.approx(0.02, abs=2e-4)
    # where nothing that stands is fitted, what judges tells it
    found = of_tolerances(sound, {0, 1}, replaying([], wave))
    assert found[0].varying == pytest.approx(found[1].varying)
    assert np.sqrt(found[0].varying / BOTH) == pytest.approx(0.01, abs=2e-4)


def test_tolerances_are_no_farther_off_than_they_may_be_to_follow_chance():
    """One that moves joints by a tenth of it takes little of it away."""
    wave = np.where(np.arange(len(ROW)) % 2, 0.01, -0.01)
    sound = model(False)
    sound.traces[0][J][:, 1] = 0.1 * wave
    (found,) = of_tolerances(sound, (), replaying([], wave))
    pull = len(ROW) * 0.1**2 * 1e-4 / (1e-4 + 2e-8)
    assert np.sqrt(found.varying / BOTH) == pytest.approx(
        0.01 * (1.0 - 0.1 * 10 * pull / (1 + pull))
    )


@pytest.mark.parametrize(("off", "falls"), [(0.05, True), (0.005, False)])
def test_a_robot_that_falls_is_not_the_one_that_was_recorded(off, falls):
    """Of four one is far from where the others are in one motion; then it tells nothing of any."""
    wave = np.where(np.arange(len(ROW)) % 2, 1.0, -1.0)

    def run(jobs):
        one = [job.jitter == 2 and job.recording == 1 for job in jobs]
        return [{J: (off if far else 0.002) * wave} for far in one]

    found = of_tolerances(model(False, False), (), run)
    assert found[0].varying == pytest.approx(BOTH * 0.002**2)
    square = 0.002**2 if falls else (3.0 * 0.002**2 + off**2) / 4.0
    assert found[1].varying == pytest.approx(BOTH * square)


def test_where_nearly_all_robots_fall_somewhere_all_tell():
    wave = np.where(np.arange(len(ROW)) % 2, 1.0, -1.0)

    def run(jobs):
        return [{J: (0.05 if job.jitter == job.recording + 1 else 0.002) * wave} for job in jobs]

    found = of_tolerances(model(False, False, False), (), run)
    expected = np.sqrt((3.0 * 0.002**2 + 0.05**2) / 4.0)
    for one in found:
        assert np.sqrt(one.varying / BOTH) == pytest.approx(expected)


def test_a_robot_that_the_engine_cannot_run_tells_nothing():
    (found,) = of_tolerances(model(False), (), replaying([], np.full(len(ROW), np.nan)))
    assert not found.total.any()


def test_tolerances_are_half_of_what_they_may_be():
    wide = [SimpleNamespace(name=f"mass {k}", trial="mass", ends=(-9.0, 9.0)) for k in range(400)]
    sound, asked = model(False), []
    sound.nuisances, sound.traces = wide, [{J: np.zeros((len(ROW), len(wide)))}]
    of_tolerances(sound, (), replaying(asked, np.zeros(len(ROW))))
    every = np.array([job.nuisances for job in asked])
    assert np.std(every) == pytest.approx(WITHIN, rel=0.05)


def test_replays_that_start_otherwise_scatter_by_their_mean_square():
    plain = {0: {J: np.zeros(len(ROW))}}
    square = of_starts(plain, replaying([], np.full(len(ROW), 0.002)))
    assert square[0][J] == pytest.approx(4e-6)
