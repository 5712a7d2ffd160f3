"""Walks of a Marvin whose stall torque was told before friction took its part."""

import pytest
import tomli_w
from walking_robots import believed, but, marvin, walked, walked_by, walked_with

from bench.diagnosis.joint.nuisances import STALL
from bench.diagnosis.robot.improved import of_nuisances
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.nuisances import nuisances
from bench.diagnosis.robot.search import RobotSearch
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import read_model

KNOWN = but(STALL)


def lost():
    return believed().joints[0].drive.lost_at_stall


def fitted(course):
    with RobotModel(believed(), marvin(), [course], without=KNOWN, processes=1) as model:
        found = RobotSearch(model).believed()
        return dict(zip([n.name for n in model.nuisances], found.nuisances, strict=True))


@pytest.mark.slow
def test_a_stall_torque_told_before_friction_is_a_tolerance_of_the_robot():
    before = effect(STALL).apply(believed(), (), {"scale": 1.0 - lost()})
    assert fitted(walked_by(before, 31))[STALL] == pytest.approx(-1.0, abs=0.15)


@pytest.mark.slow
def test_a_stall_torque_of_the_shaft_is_left_as_it_is():
    assert fitted(walked_with({}, 32))[STALL] == pytest.approx(0.0, abs=0.15)


def test_what_was_fitted_of_it_stands_in_the_better_model():
    every = nuisances(believed(), 0.005)
    z = [-0.5 if n.name == STALL else 0.0 for n in every]
    (made,) = of_nuisances(believed(), every, z, "a test")
    assert made.effect is effect(STALL)
    assert made.values["scale"] == pytest.approx(1.0 - 0.5 * lost())


def test_at_its_end_it_stands_in_for_nothing():
    (one,) = [n for n in nuisances(believed(), 0.005) if n.name == STALL]
    assert one.ends == (-1.0, 0.0)
    assert not one.far(-1.0, 0.9)


@pytest.mark.slow
def test_a_torque_constant_of_the_file_is_no_stall_torque(tmp_path):
    document = {**marvin().document, "drive": {**marvin().document["drive"]}}
    constant = {"value": believed().joints[0].drive.torque_constant_nm_a, "source": "measured"}
    document["drive"]["XL-320"] = {**document["drive"]["XL-320"], "torque_constant_nm_a": constant}
    path = tmp_path / "told.toml"
    path.write_text(tomli_w.dumps(document), "utf-8")
    robot = load_robot(str(path))
    with RobotModel(read_model(robot), robot, [walked()], without=KNOWN, processes=1) as model:
        assert STALL not in [n.name for n in model.nuisances]
