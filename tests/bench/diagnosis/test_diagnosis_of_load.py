"""What load friction knows of the torque through its gear: no data sheet says, no finding either.

Friction that is the same both ways, but knows the load's inertia, looks as if it were unlike.
"""

from datetime import date

import numpy as np
import pytest
from pendulum_logs import JOINT, POSITION, logs, robot

from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.fit import bounds, fit
from bench.diagnosis.joint.improved import PLACES, additions
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.joint.nuisances import LOAD_OF_GEAR, NUISANCES
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from sim.drive import fields
from sim.effects import effect
from sim.model import read_model
from sim.rollout import Candidate, Load

ASKED = ("load_friction", "directional_load_friction")
RATIO = 0.2
ALIKE = Hypothesis(effect_knobs(effect("load_friction")))
UNLIKE = Hypothesis(effect_knobs(effect("directional_load_friction")))


def seen(share):
    truth = {"load_friction": {"ratio": RATIO}, "load_of_gear": {"share": share}}
    return observe(logs(truth, registers=(POSITION,)), robot(), JOINT)


def the_one(model):
    (k,) = (k for k, n in enumerate(model.nuisances) if n.name == LOAD_OF_GEAR)
    return k


@pytest.fixture(
    scope="module",
    params=[0.0, 1.0],
    ids=["of gravity", "of the gear"],
)
def found(request):
    effects = {name: effect(name) for name in ASKED}
    one = diagnose_joint(read_model(robot()), robot(), seen(request.param), effects=effects)
    return request.param, one


@pytest.mark.slow
def test_friction_that_is_the_same_both_ways_is_said_to_be(found):
    _, one = found
    (cause,) = one.diagnosis.causes
    assert cause.effect == "load_friction"
    assert cause.parameters["ratio"].value == pytest.approx(RATIO, rel=0.1)


@pytest.mark.slow
def test_the_better_model_says_what_the_friction_knows(found):
    share, one = found
    made = {a.effect.name: a.values for a in additions([one], date(2026, 1, 2))}
    assert made.get("load_of_gear", {"share": 0.0})["share"] == pytest.approx(share, abs=0.2)


def test_held_to_gravity_it_would_be_told_as_unlike():
    model = JointModel(read_model(robot()), robot(), seen(1.0))
    z = np.zeros(len(model.nuisances) + 2)
    z[-2:] = 1.0
    alike = fit(model, ALIKE, z[:-1], held=[the_one(model)])
    unlike = fit(model, UNLIKE, z, held=[the_one(model)])
    assert alike.cost > unlike.cost + 20.0


def test_without_load_friction_there_is_nothing_that_it_could_know():
    model = JointModel(read_model(robot()), robot(), seen(0.0))
    k = the_one(model)
    for hypothesis, ends in ((Hypothesis(), (0.0, 0.0)), (ALIKE, (0.0, 1.0)), (UNLIKE, (0.0, 1.0))):
        low, high = bounds(model, hypothesis)
        assert (low[k], high[k]) == ends


@pytest.mark.parametrize(
    ("name", "field"),
    [(LOAD_OF_GEAR, fields.LOAD_OF_GEAR), ("punch_left_out", fields.PUNCH_LEFT_OUT)],
)
def test_a_share_is_of_what_the_robot_file_leaves(name, field):
    """As the effect that stands for it in a better model has it: never more than all."""
    (nuisance,) = (n for n in NUISANCES if PLACES.get(n.name, ("",))[0] == name)
    (joint,) = effect(name).apply(read_model(robot()), (), {"share": 0.8}).joints
    (more,) = effect(name).apply(read_model(robot()), (), {"share": 0.9}).joints
    believed = Candidate(joint.drive.column(), Load(1e-3, np.zeros(1), np.zeros(1)), 5.0, 0.0)
    assert nuisance.change(believed, 0.5).drive[field] == pytest.approx(more.drive.column()[field])


@pytest.mark.slow
def test_friction_of_what_the_gear_passes_on_alone_may_be_called_either():
    truth = {
        "directional_load_friction": {"driving": 0.0, "backdriving": RATIO},
        "load_of_gear": {"share": 1.0},
    }
    observed = observe(logs(truth, registers=(POSITION,)), robot(), JOINT)
    effects = {name: effect(name) for name in ASKED}
    one = diagnose_joint(read_model(robot()), robot(), observed, effects=effects)
    (cause,) = one.diagnosis.causes
    assert cause.effect == "directional_load_friction"
    assert cause.parameters["backdriving"].value == pytest.approx(RATIO, rel=0.1)
    (rival,) = cause.indistinguishable_from
    assert rival.effect == "load_friction"
    assert rival.probability == pytest.approx(cause.probability)
    assert one.diagnosis.next_experiment == ()
