"""Friction that gives way before it slips: no data sheet has it, and it is no finding."""

from datetime import date

import numpy as np
import pytest
from pendulum_logs import JOINT, POSITION, logs, robot

from bench.diagnosis.joint import diagnosis as joint
from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.fit import Fit, bounds, fit
from bench.diagnosis.joint.improved import additions
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.joint.nuisances import PRESLIDING
from bench.diagnosis.joint.screening import vectors_to_try
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from sim.effects import effect
from sim.model import read_model

MOTIONS = ("slow", "fast", "steps")
ASKED = ("dead_zone", "punch", "coulomb_friction", "gain_error", "load_friction")
SIZE_RAD = 8e-4
GIVES_WAY = {"presliding": {"breakaway_rad": SIZE_RAD}}


def seen(truth=None, motions=MOTIONS):
    return observe(logs(truth, motions=motions, registers=(POSITION,)), robot(), JOINT)


@pytest.fixture(scope="module")
def found():
    effects = {name: effect(name) for name in ASKED}
    return diagnose_joint(read_model(robot()), robot(), seen(GIVES_WAY), effects=effects)


@pytest.mark.slow
def test_where_tolerances_stand_in_for_something_nothing_is_called_consistent(monkeypatch):
    effects = {"dead_zone": effect("dead_zone")}
    for stand_in, verdict in ((False, "consistent"), (True, "unexplained")):
        monkeypatch.setattr(joint, "strained", lambda model, found, say=stand_in: say)
        one = diagnose_joint(read_model(robot()), robot(), seen(), effects=effects).diagnosis
        assert (one.verdict, bool(one.unexplained)) == (verdict, stand_in)


def the_one(model):
    (k,) = (k for k, n in enumerate(model.nuisances) if n.name == PRESLIDING)
    return k


@pytest.mark.slow
def test_friction_that_gives_way_is_no_finding(found):
    assert found.diagnosis.verdict == "consistent"
    k = the_one(found.model)
    size = found.after.z[k] * found.model.nuisances[k].deviation
    assert size == pytest.approx(SIZE_RAD, rel=0.35)


@pytest.mark.slow
def test_the_better_model_has_it(found):
    made = {a.effect.name: a.values for a in additions([found], date(2026, 1, 2))}
    assert made["presliding"]["breakaway_rad"] == pytest.approx(SIZE_RAD, rel=0.35)


@pytest.mark.slow
def test_recordings_are_followed_worse_without_it(found):
    model = found.model
    stiff = fit(model, Hypothesis(), np.zeros(len(model.nuisances)), held=[the_one(model)])
    assert stiff.cost > found.before.cost + 20.0


def test_it_goes_from_nothing_to_a_thousandth_and_stands_in_for_nothing():
    model = JointModel(read_model(robot()), robot(), seen(motions=("slow",)))
    k = the_one(model)
    low, high = bounds(model, Hypothesis())
    assert (low[k], high[k] * model.nuisances[k].deviation) == (0.0, pytest.approx(1e-3))
    z = np.zeros(len(model.nuisances))
    z[k] = high[k]
    asked = effect("dead_zone")
    tried = vectors_to_try(model, Fit(Hypothesis(), z, {}, 0.0), asked, effect_knobs(asked))
    assert {vector[k] for vector in tried} == {high[k]}
