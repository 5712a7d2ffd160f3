"""How steep curves are beside other effects, on a stand-in for replays."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.curves import BENT, NEAR, Curves
from bench.diagnosis.robot.features import RobotKind

MOTIONS = (0, 2)
ALONE = np.array([1.0, -2.0, 0.5])  #: what a spring does to each row alone, for one unit
TIPS = np.array([0.3, 0.0, 1.0])
BESIDE = np.array([-2.0, 1.0, 0.0])  #: what both do that neither does alone
TURNED = np.array([0.0, 0.7, 0.0])  #: what a spring does beside one deviation of a nuisance


def rows(job):
    knobs = dict(job.effects)
    spring, tips = knobs.get("spring@all", 0.0), knobs.get("tips@all", 0.0)
    (z,) = job.nuisances or (0.0,)
    value = (1.0 + job.recording) * (ALONE * spring + TIPS * tips + BESIDE * spring * tips)
    return {RobotKind.JOINTS: value + TURNED * z * spring}


def placed(low=0.0, high=8.0):
    knob = SimpleNamespace(bounds=(low, high))
    return SimpleNamespace(knob=knob, first_z=1.0, levels=())


class Run:
    """Replays that are counted; those of too stiff a spring cannot be run."""

    def __init__(self, stiff=np.inf):
        self.jobs, self.stiff = [], stiff

    def __call__(self, jobs):
        self.jobs += jobs
        return [self._rows(job) for job in jobs]

    def _rows(self, job):
        lost = len(job.effects) > 1 and dict(job.effects)["spring@all"] > self.stiff
        return {k: np.full(3, np.nan) if lost else v for k, v in rows(job).items()}


def curves(run):
    none = SimpleNamespace(effects=(), nuisances=(), recording=0)
    plain = {m: rows(none) for m in MOTIONS}
    return Curves({"spring@all": placed(), "tips@all": placed()}, plain, run)


def exact(m, spring, tips, z=0.0):
    effects = (("spring@all", spring), ("tips@all", tips))
    return rows(SimpleNamespace(effects=effects, nuisances=(z,), recording=m))[RobotKind.JOINTS]


def moved(found, m, here, there):
    told = [(("spring@all", spring), ("tips@all", tips)) for spring, tips in (here, there)]
    then, now = (found.effects(m, settings)[RobotKind.JOINTS] for settings in told)
    return now - then


def bent(run, spring=2.0, tips=3.0, z=0.5):
    found = curves(run)
    found.bend((("spring@all", spring), ("tips@all", tips)), (z,), MOTIONS)
    return found


@pytest.mark.parametrize("m", MOTIONS)
def test_a_knob_moves_a_robot_as_it_does_beside_all_that_is_fitted(m):
    found, here = bent(Run()), (2.0, 3.0)
    for there in ((2.5, 3.0), (2.0, 2.6)):
        wanted = exact(m, *there, 0.5) - exact(m, *here, 0.5)
        assert moved(found, m, here, there) == pytest.approx(wanted)
        assert moved(curves(Run()), m, here, there) != pytest.approx(wanted)


def test_that_is_asked_of_both_sides_of_each_knob_within_its_bounds():
    run = Run()
    bent(run, spring=8.0, tips=0.05)
    asked = [dict(job.effects) for job in run.jobs if job.nuisances and job.recording == 0]
    springs = [8.0 - 8.0 * NEAR, 8.0, 8.0, 8.0]
    tips = [0.05, 0.05, 0.0, 0.05 + NEAR]
    told = [[knobs[name] for knobs in asked] for name in ("spring@all", "tips@all")]
    assert told == [pytest.approx(springs), pytest.approx(tips)]
    assert all(job.short for job in run.jobs)


def test_far_away_a_curve_is_as_steep_as_alone():
    found, here, tips = bent(Run()), (2.0, 3.0), 3.0
    end = (2.0 + BENT * NEAR * 2.0, tips)
    beyond = (end[0] + 2.0, tips)
    assert moved(found, 0, end, beyond) == pytest.approx(2.0 * ALONE)
    assert moved(found, 0, here, end) == pytest.approx(exact(0, *end, 0.5) - exact(0, *here, 0.5))


def test_what_no_engine_can_run_is_as_steep_as_alone():
    found, here, there = bent(Run(stiff=2.1)), (2.0, 3.0), (2.5, 3.0)
    assert moved(found, 0, here, there) == pytest.approx(0.5 * ALONE)


def test_elsewhere_it_is_asked_anew():
    found = bent(Run())
    found.bend((("tips@all", 1.0),), (0.0,), MOTIONS)
    assert moved(found, 0, (2.0, 1.0), (2.5, 1.0)) == pytest.approx(0.5 * ALONE)
