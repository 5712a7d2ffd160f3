"""Whether a servo with PID gains adds its punch is not known: either way there is nothing amiss."""

from datetime import date

import numpy as np
import pendulum_logs
import pytest
import tomli_w
from pendulum_logs import JOINT, POSITION, logs, robot

from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.fit import Fit, bounds
from bench.diagnosis.joint.improved import additions
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.joint.nuisances import PUNCH, nuisances
from bench.diagnosis.joint.screening import vectors_to_try
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from busemu.tables import load_robot
from sim.effects import effect
from sim.entries import Section
from sim.model import read_model

NONE = {"punch_left_out": {"share": 1.0}}
MOTIONS = ("slow", "fast", "steps")
ASKED = ("dead_zone", "punch", "coulomb_friction", "gain_error", "zero_offset")
ALONE = Hypothesis()


@pytest.fixture(autouse=True)
def an_xl_320(tmp_path_factory, monkeypatch):
    """The pendulum of these tests on an XL-320, with Marvin's drive."""
    document = robot().document | {"servo": [dict(robot().document["servo"][0])]}
    document["bus"] = document["bus"] | {"servo_model": "XL-320"}
    document["drive"] = {"XL-320": load_robot("marvin").document["drive"]["XL-320"]}
    document["supply"] = load_robot("marvin").document["supply"]
    del document["effect"]
    path = tmp_path_factory.mktemp("rig") / "xl-320.toml"
    path.write_text(tomli_w.dumps(document), "utf-8")
    monkeypatch.setattr(pendulum_logs, "ROBOT", str(path))


def seen(truth=None, motions=MOTIONS, settings=None):
    made = logs(truth, motions=motions, registers=(POSITION,), settings=settings)
    return observe(made, robot(), JOINT)


def diagnosed(truth):
    effects = {name: effect(name) for name in ASKED}
    return diagnose_joint(read_model(robot()), robot(), seen(truth), effects=effects)


def left_out(found):
    (k,) = (k for k, n in enumerate(found.model.nuisances) if n.name == PUNCH)
    return found.after.z[k] * found.model.nuisances[k].deviation


def model_of(told):
    return JointModel(read_model(robot()), robot(), told)


def free(model, hypothesis):
    low, high = bounds(model, hypothesis)
    names = [n.name for n in model.nuisances]
    return {name for name, a, b in zip(names, low, high, strict=False) if a < b}


@pytest.mark.parametrize(("truth", "share"), [(NONE, 1.0), ({}, 0.0)], ids=["none", "all"])
@pytest.mark.slow
def test_a_punch_that_is_added_or_not_is_no_finding(truth, share):
    found = diagnosed(truth)
    assert found.diagnosis.verdict == "consistent"
    assert left_out(found) == pytest.approx(share, abs=0.15)


@pytest.mark.slow
def test_a_dead_zone_beyond_the_punch_is_a_finding():
    found = diagnosed(NONE | {"dead_zone": {"margin_rad": 0.02}})
    (cause,) = found.diagnosis.causes
    assert cause.effect == "dead_zone"
    low, high = cause.parameters["margin_rad"].ci95
    assert low < 0.02 < high


@pytest.mark.slow
def test_the_better_model_leaves_out_what_the_servo_does():
    made = {a.effect.name: a.values for a in additions([diagnosed(NONE)], date(2026, 1, 2))}
    assert made["punch_left_out"]["share"] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("law", ["pid", "compliance", "operating_modes"])
def test_only_a_law_that_no_manual_writes_down_may_leave_its_punch_out(law):
    drive = Section(robot().path, "", robot().document).section("drive").section("XL-320")
    names = {n.name for n in nuisances(drive, law=law)}
    assert (PUNCH in names) == (law == "pid")


def test_a_punch_of_nothing_leaves_nothing_out():
    assert PUNCH in free(model_of(seen(motions=("slow",))), ALONE)
    model = model_of(seen(motions=("slow",), settings={"punch": 0}))
    assert PUNCH not in free(model, ALONE)


def test_more_punch_than_the_register_has_counts_from_all_of_it():
    model = model_of(seen(motions=("slow",)))
    assert PUNCH not in free(model, Hypothesis(effect_knobs(effect("punch"))))
    assert PUNCH in free(model, Hypothesis(effect_knobs(effect("dead_zone"))))


def test_the_duty_follows_the_punch_that_is_left_out():
    model = model_of(seen(motions=("slow",)))
    (k,) = (k for k, n in enumerate(model.nuisances) if n.name == PUNCH)
    assert model.turns_controller(ALONE, k)
    added, none = np.zeros(len(model.nuisances)), np.zeros(len(model.nuisances))
    none[k] = 1.0 / model.nuisances[k].deviation
    law, other = (model.law(ALONE, z, 0, 0.01) for z in (added, none))
    assert np.abs(law - other).max() == pytest.approx(32 / 1023, abs=1e-5)


def test_a_punch_that_is_left_out_stands_in_for_nothing():
    model = model_of(seen(motions=("slow",)))
    _, high = bounds(model, ALONE)
    names = [n.name for n in model.nuisances]
    asked, knobs = effect("dead_zone"), effect_knobs(effect("dead_zone"))

    def punches(*at_their_ends):
        z = np.where([n in at_their_ends for n in names], high, 0.0)
        tried = vectors_to_try(model, Fit(ALONE, z, {}, 0.0), asked, knobs)
        return len(tried), {vector[names.index(PUNCH)] for vector in tried}

    once, shares = punches(PUNCH)
    assert shares == {1.0}
    assert punches(PUNCH, "gain") == (2 * once, {1.0})
    assert punches("gain") == (2 * once, {0.0})
