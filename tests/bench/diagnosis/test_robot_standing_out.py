"""One leg, and one joint of it, that differ from the others: they are looked at alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from walking_robots import believed, but, marvin, walked_with

from bench.diagnosis.robot.effects import CARRYING, leg_of, placed_effects
from bench.diagnosis.robot.features import MEANS, RobotKind
from bench.diagnosis.robot.fit import Sight
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.screen import STANDS_OUT, Screen
from bench.diagnosis.robot.search import RobotSearch

JOINTS = [joint.name for joint in believed().joints]
LEGS = [leg.name for leg in believed().legs]
OFF_RAD = 0.012  #: a third of what a zero may be off, and more than it likes to be


def standing_out(misfits):
    """Of a screening that leaves so much of some joints, and 1 of each of the others."""
    screen = Screen.__new__(Screen)
    screen._model = SimpleNamespace(base=believed())
    screen._misfits = lambda: dict.fromkeys(JOINTS, 1.0) | misfits
    return screen.standing_out()


def test_no_leg_stands_out_where_all_are_alike():
    assert standing_out({}) == []
    assert standing_out({"leg2.tibia": 1.0 + 2.9 * (STANDS_OUT - 1.0)}) == []


def test_a_leg_stands_out_with_the_joints_that_do_the_worst_first():
    assert standing_out({"leg2.tibia": 3.0, "leg2.coxa": 9.0}) == [
        "leg2",
        "leg2.coxa",
        "leg2.tibia",
    ]


def test_a_leg_stands_out_without_a_joint_that_does():
    little = dict.fromkeys((f"leg4.{s}" for s in ("coxa", "femur", "tibia")), 0.0)
    others = {joint: 0.7 for joint in JOINTS if not joint.startswith(("leg3", "leg4"))}
    assert standing_out(others | little) == ["leg3", "leg3.coxa", "leg3.femur", "leg3.tibia"]


def test_no_more_than_two_legs_stand_out():
    found = standing_out({"leg1.coxa": 9.0, "leg2.coxa": 8.0, "leg3.coxa": 7.0})
    assert found == ["leg1", "leg1.coxa", "leg2", "leg2.coxa"]


def names(standing, named=()):
    search = RobotSearch.__new__(RobotSearch)
    search.model = SimpleNamespace(base=believed(), placed=placed_effects(believed()))
    return search._worth_looking(SimpleNamespace(standing_out=lambda: standing), named)


def test_places_in_legs_are_looked_at_where_they_stand_out():
    usual = set(names([]))
    assert {"gain_error@all", "gain_error@tibia", "backlash@femur+tibia"} <= usual
    assert not any(leg_of(name.partition("@")[2], LEGS) for name in usual)
    more = set(names(["leg2", "leg2.tibia"])) - usual
    places = {name.partition("@")[2] for name in more}
    assert places == {"leg2", "leg2.femur+tibia", "leg2.tibia"}
    assert {"backlash@leg2.femur+tibia", "gain_error@leg2.tibia", "foot_compliance@leg2"} <= more


def test_what_stands_for_a_tolerance_at_its_end_is_looked_at_wherever_it_is():
    usual = set(names([]))
    assert set(names([], {"zero_offset@leg3.tibia"})) - usual == {"zero_offset@leg3.tibia"}


def test_a_zero_is_off_in_one_joint_alone():
    known = placed_effects(believed())
    zeros = {one.place: one.where for one in known.values() if one.effect.name == "zero_offset"}
    assert zeros == {joint.name: (joint.name,) for joint in believed().joints}


def test_joints_and_the_two_that_carry_are_places_of_a_leg():
    known = placed_effects(believed())
    assert known["gain_error@leg3.tibia"].where == ("leg3.tibia",)
    assert known["backlash@leg3.femur+tibia"].where == tuple(f"leg3.{s}" for s in CARRYING)
    assert known["backlash@leg3"].where == ("leg3.coxa", "leg3.femur", "leg3.tibia")
    # gears wear where they carry; what is set in a servo is set one by one
    assert "gain_error@leg3.femur+tibia" not in known
    changed = known["gain_error@leg3.tibia"].apply(believed(), 1.5).joints
    scales = {joint.name: joint.drive.gain_scale for joint in changed}
    assert {name for name, scale in scales.items() if scale != 1.0} == {"leg3.tibia"}


@pytest.mark.parametrize(
    ("place", "leg"),
    [("leg3", "leg3"), ("leg3.tibia", "leg3"), ("all", ""), ("femur+tibia", ""), ("leg30", "")],
)
def test_a_place_is_in_a_leg_or_in_none(place, leg):
    assert leg_of(place, LEGS) == leg


@pytest.fixture(scope="module")
def model():
    known, courses = but("zero"), [walked_with({}, 3)]
    with RobotModel(believed(), marvin(), courses, without=known, processes=1) as made:
        yield made


@pytest.mark.parametrize(
    "of_row",
    [
        lambda k: (-1.0) ** k,  # no tolerance makes that: it is left
        lambda k: np.ones(len(k)),  # a zero does, and far more of it than believed
    ],
)
@pytest.mark.parametrize("joint", ["leg5.tibia", "leg1.coxa"])
@pytest.mark.slow
def test_a_joint_that_moves_otherwise_is_found_among_all_rows(model, joint, of_row):
    own = model.features[0].joint_row == JOINTS.index(joint)
    rows = {kind: model.recorded(0, kind) - x for kind, x in model.centre[0].items()}
    rows[RobotKind.JOINTS][own] += OFF_RAD * of_row(np.arange(own.sum()))
    noise = dict(Sight(model, [0], MEANS).fit().noise)
    found = Screen(model, noise, [rows]).standing_out()
    assert found[:2] == [joint.partition(".")[0], joint]
