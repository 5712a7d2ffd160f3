"""Feet that give a little: a tolerance of robots whose file says nothing of their feet."""

from dataclasses import replace

import numpy as np
import pytest
from walking_robots import believed, marvin, walked

from bench.diagnosis.robot.fit import Sight
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.nuisances import TIPS, nuisances, trials, with_nuisances
from sim.effects import effect

KNOWN = {n.name.split()[0] for n in nuisances(believed(), 0.005)} - {TIPS}
STIFFEST_RUBBER_N_M = 2e4


def tips(robot):
    return next(n for n in nuisances(robot, 0.005) if n.name == TIPS)


def test_feet_give_from_nothing_to_what_stiff_rubber_does():
    one = tips(believed())
    least, most = one.ends
    assert least == 0.0
    assert most * one.deviation == pytest.approx(1.0 / STIFFEST_RUBBER_N_M)
    soft = with_nuisances(believed(), [one], [most])
    for leg in soft.legs:
        assert leg.foot.stiffness_n_m == pytest.approx(STIFFEST_RUBBER_N_M)
        assert leg.foot.damping_n_s_m > 0.0
    assert replace(soft, legs=believed().legs) == believed()


def test_feet_that_give_next_to_nothing_are_as_stiff_as_any_may_be():
    (leg, *_) = with_nuisances(believed(), [tips(believed())], [1e-3]).legs
    assert leg.foot.stiffness_n_m == effect("foot_compliance").parameters[0].high


def test_feet_that_give_already_give_more():
    one = tips(believed())
    once = with_nuisances(believed(), [one], [0.5])
    (trial,) = (t for t in trials(believed()) if t.name == TIPS)
    (leg, *_) = with_nuisances(believed(), [one], [1.0]).legs
    for twice in (
        trial.change(once, 0.5 * one.deviation),
        with_nuisances(once, [one], [0.5]),  # as where a step goes half the way to soft feet
    ):
        assert twice.legs[0].foot.stiffness_n_m == pytest.approx(leg.foot.stiffness_n_m)


def test_feet_that_are_as_soft_as_any_may_be_stay_so():
    kind = effect("foot_compliance")
    softest = kind.parameters[0].low
    soft = kind.apply(believed(), (), {"stiffness_n_m": softest, "damping_n_s_m": 5.0})
    (trial,) = (t for t in trials(believed()) if t.name == TIPS)
    assert trial.change(soft, trial.size).legs[0].foot.stiffness_n_m == softest


def test_feet_of_which_the_file_speaks_have_no_such_tolerance():
    kind = effect("foot_compliance")
    soft = kind.apply(believed(), (), {"stiffness_n_m": 3e3, "damping_n_s_m": 5.0})
    assert TIPS not in {n.name for n in nuisances(soft, 0.005)}


@pytest.fixture(scope="module")
def model():
    with RobotModel(believed(), marvin(), [walked()], without=KNOWN, processes=1) as made:
        yield made


@pytest.mark.parametrize("where", ["all", "leg2"])
def test_it_is_idle_beside_soft_feet_that_have_a_name(model, where):
    sight = Sight(model, [0], ())
    k = [n.name for n in model.nuisances].index(TIPS)
    assert np.transpose(sight.box(()))[k].tolist() == list(tips(believed()).ends)
    assert np.transpose(sight.box((f"foot_compliance@{where}",)))[k].tolist() == [0.0, 0.0]
    assert np.transpose(sight.box(("gain_error@all",)))[k].tolist() == list(tips(believed()).ends)
