"""Whether a stall torque was told with friction or before it: either way there is nothing amiss."""

from datetime import date
from math import prod

import pendulum_logs
import pytest
import tomli_w
from pendulum_logs import JOINT, POSITION, logs, robot

from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.improved import additions
from bench.diagnosis.joint.model import JointModel
from bench.diagnosis.joint.nuisances import STALL
from bench.diagnosis.observed import observe
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import read_model

MOTIONS = ("slow", "fast", "steps")
WEAK = 0.89  #: of a motor, within what specimens scatter by
ASKED = ("torque_constant", "coulomb_friction", "gain_error", "zero_offset", "dead_zone")


def an_xl_320(path, more=None):
    """The pendulum of these tests on an XL-320, with Marvin's drive."""
    marvin = load_robot("marvin").document
    document = robot().document | {"servo": [dict(robot().document["servo"][0])]}
    document["bus"] = document["bus"] | {"servo_model": "XL-320"}
    document["drive"] = {"XL-320": marvin["drive"]["XL-320"] | (more or {})}
    document["supply"] = marvin["supply"]
    document.pop("effect", None)
    path.write_text(tomli_w.dumps(document), "utf-8")
    return str(path)


@pytest.fixture(autouse=True)
def rig(tmp_path, monkeypatch):
    monkeypatch.setattr(pendulum_logs, "ROBOT", an_xl_320(tmp_path / "xl-320.toml"))


def drive():
    return read_model(robot()).joints[0].drive


def seen(truth=None, motions=MOTIONS):
    return observe(logs(truth, motions=motions, registers=(POSITION,)), robot(), JOINT)


def nuisances():
    return {
        n.name: n for n in JointModel(read_model(robot()), robot(), seen(None, ("slow",))).nuisances
    }


def test_what_friction_takes_at_stall_is_the_share_that_is_in_doubt():
    sheet = drive().data_sheet
    motor = drive().torque_constant_nm_a * sheet.stall_current_a
    assert nuisances()[STALL].deviation == pytest.approx(1.0 - sheet.stall_torque_nm / motor)
    assert nuisances()[STALL].ends == (-1.0, 0.0)
    assert not nuisances()[STALL].stands_in


def test_a_torque_constant_of_the_file_is_no_stall_torque(tmp_path, monkeypatch):
    constant = {"value": drive().torque_constant_nm_a, "source": "measured"}
    told = {"torque_constant_nm_a": constant}
    monkeypatch.setattr(pendulum_logs, "ROBOT", an_xl_320(tmp_path / "told.toml", told))
    assert STALL not in nuisances()


@pytest.mark.slow
def test_a_weak_motor_whose_stall_torque_was_told_before_friction_is_no_finding():
    lost = drive().lost_at_stall
    truth = {"stall_torque": {"scale": 1.0 - lost}, "torque_constant": {"scale": WEAK}}
    effects = {name: effect(name) for name in ASKED}
    found = diagnose_joint(read_model(robot()), robot(), seen(truth), effects=effects)
    assert found.diagnosis.verdict == "consistent"
    made = {a.effect.name: a.values for a in additions([found], date(2026, 1, 2))}
    factors = [made.get(name, {"scale": 1.0})["scale"] for name in truth]
    assert prod(factors) == pytest.approx(WEAK * (1.0 - lost), rel=0.02)
    assert factors[0] < 1.0
