"""Walks of a Marvin whose servos do not add their punch, as some firmware may not."""

from dataclasses import replace

import pytest
from walking_robots import believed, but, marvin, walked, walked_by, walked_with

from bench.diagnosis.joint.nuisances import PUNCH
from bench.diagnosis.robot.model import RobotModel, undocumented_punch
from bench.diagnosis.robot.search import RobotSearch
from busemu.tables import load_robot
from sim.drive import fields
from sim.effects import effect

KNOWN = but(PUNCH)


def left_out(course):
    with RobotModel(believed(), marvin(), [course], without=KNOWN, processes=1) as model:
        found = RobotSearch(model).believed()
        names = [n.name for n in model.nuisances]
        return found.nuisances[names.index(PUNCH)]


@pytest.mark.slow
def test_a_punch_that_no_servo_adds_is_a_tolerance_of_the_robot():
    without = effect("punch_left_out").apply(believed(), (), {"share": 1.0})
    assert left_out(walked_by(without, 21)) == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_a_punch_that_every_servo_adds_is_not_left_out():
    assert left_out(walked_with({}, 22)) == pytest.approx(0.0, abs=0.15)


@pytest.mark.parametrize(("name", "known"), [("marvin", True), ("phantomx", False)])
def test_only_a_law_that_no_manual_writes_down_may_leave_its_punch_out(name, known):
    robot = load_robot(name)
    assert undocumented_punch(robot, [walked()]) == known


def test_servos_without_a_punch_leave_none_out():
    told = walked()
    start, changes = told.start.copy(), told.events[told.events[:, 2] == fields.PUNCH]
    start[fields.PUNCH] = 0.0
    assert len(changes) == 0
    assert not undocumented_punch(marvin(), [replace(told, start=start)])
