"""Which gear is believed in: recordings of a rigid one, and of the spring of the robot file."""

import numpy as np
import pytest
from pendulum_logs import CONDITION, JOINT, logs, model_of, robot

from bench.diagnosis.joint import diagnosis as joint
from bench.diagnosis.joint import views
from bench.diagnosis.joint.fit import bounds, fit
from bench.diagnosis.joint.gear import SpringError, asked_again, believed
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.joint.nuisances import GEAR_LEVELS
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from sim.effects import effect
from sim.model import read_model

PLAY = Hypothesis(effect_knobs(effect("backlash")))
SOFT = Hypothesis(effect_knobs(effect("joint_compliance")))


@pytest.mark.parametrize("sprung", [False, True], ids=["rigid", "a spring"])
@pytest.mark.slow
def test_the_gear_that_recordings_follow_is_believed(sprung):
    told = observe(logs(motions=("fast", "steps"), sprung=sprung), robot(), JOINT)
    model, before = believed(read_model(robot()), robot(), told)
    assert model.sprung == sprung
    assert model.of(told).sprung == sprung
    assert len(before.z) == len(model.nuisances)


@pytest.mark.slow
def test_what_is_believed_is_fitted_from_more_and_less_friction_too():
    """An arm that falls with half its friction: from friction as believed a fit stops early."""
    little = {
        "coulomb_friction": {"more_nm": -0.01},
        "viscous_friction": {"more_nm_s_rad": -0.002},
        "torque_constant": {"scale": 1.1},
    }
    light = CONDITION | {"payload_kg": 0.05}
    told = observe(logs(little, ("steps",), condition=light, limp_s=0.5), robot(), JOINT)
    model, before = believed(read_model(robot()), robot(), told)
    early = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    assert before.cost < early.cost - 100.0


def free_levels(model, hypothesis):
    low, high = bounds(model, hypothesis)
    ends = dict(zip((n.name for n in model.nuisances), zip(low, high, strict=False), strict=False))
    return {name for name in GEAR_LEVELS if ends[name][0] < ends[name][1]}


def test_a_gear_that_is_a_spring_is_stiff_and_damped_as_the_recordings_say():
    model = model_of(logs(motions=("fast",), duration_s=0.3))
    assert free_levels(model, Hypothesis()) == set()
    assert free_levels(model, PLAY) == GEAR_LEVELS
    assert free_levels(model, SOFT) == {"gear_damping"}  # how stiff is the effect's own number
    assert free_levels(model, PLAY + SOFT.knobs) == {"gear_damping"}
    sprung = JointModel(read_model(robot()), robot(), model.observed, sprung=True)
    assert free_levels(sprung, Hypothesis()) == GEAR_LEVELS
    softest = bounds(sprung, Hypothesis())[0][
        [n.name for n in sprung.nuisances].index("gear_stiffness")
    ]
    assert softest == 0.0  # softer than the file says is a finding


@pytest.mark.parametrize("times", [0.2, 1.0, 5.0])
def test_play_is_found_whatever_the_damping_of_the_gear(times):
    """In a gear damped otherwise than its file says, teeth bounce otherwise: width was lost."""
    truth = {"backlash": {"width_rad": 0.03}, "gear_spring": {"damping_scale": times}}
    model = model_of(logs(truth, motions=("slow", "steps"), sprung=True))
    start = np.append(np.zeros(len(model.nuisances)), 1.0)
    found = fit(model, PLAY, start)
    assert PLAY.knobs[0].value(found.z[-1]) == pytest.approx(0.03, rel=0.15)


@pytest.mark.slow
def test_the_spring_of_the_file_is_no_compliance_where_it_was_taken_for_rigid(monkeypatch):
    """Which gear it is hangs on what is named: a name about gears asks once more."""
    told = observe(logs(motions=("fast", "steps"), sprung=True), robot(), JOINT)

    def taken_for_rigid(*known):
        model = JointModel(*known)
        return model, fit(model, Hypothesis(), np.zeros(len(model.nuisances)))

    monkeypatch.setattr(views, "believed", taken_for_rigid)
    effects = {"joint_compliance": effect("joint_compliance")}
    found = joint.diagnose_joint(read_model(robot()), robot(), told, effects=effects)
    assert found.model.sprung
    assert found.diagnosis.causes == ()


def test_a_rigid_gear_is_asked_again_once_something_is_named():
    """Without the name either gear may follow as well; with it the spring is seen."""
    name, told = "gain_error", {"gain_error": {"scale": 0.7}}
    hypothesis = Hypothesis(effect_knobs(effect(name)))
    for sprung in (True, False):
        model = model_of(logs(told, motions=("fast", "steps"), sprung=sprung))
        start = np.append(np.zeros(len(model.nuisances)), hypothesis.knobs[0].at(0.7))
        found, ask = fit(model, hypothesis, start), asked_again(model)
        if sprung:
            with pytest.raises(SpringError):
                ask(found)
            asked_again(model.of(model.observed, sprung=True))(found)  # has it already
        else:
            ask(found)
    ask(fit(model, PLAY, np.append(np.zeros(len(model.nuisances)), 0.5)))
