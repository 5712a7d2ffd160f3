"""What a robot file says of how sure it is widens the nuisances of a whole robot."""

import copy
import math

import pytest
from walking_robots import believed, but, marvin, walked_by

from bench.diagnosis.joint.nuisances import FARTHEST
from bench.diagnosis.robot.doubts import LEAST, doubted
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.nuisances import nuisances, with_nuisances
from bench.diagnosis.robot.search import AT_END, RobotSearch
from busemu.tables import load_robot, parse_robot
from sim.effects import effect
from sim.entries import PhysicsError
from sim.model import read_model

MARVIN = load_robot("marvin")
PHYSICS = read_model(MARVIN)
QUANTUM_RAD = 5e-3
TIBIAE = tuple(body.name for body in PHYSICS.bodies if body.name.endswith(".tibia"))


def told(*way, deviation):
    """Marvin with a deviation at one entry of its file."""
    document = copy.deepcopy(dict(MARVIN.document))
    table = document
    for key in way:
        table = table[key]
    table["deviation"] = deviation
    return parse_robot(document, MARVIN.path)


def of(robot):
    every = doubted(robot, nuisances(PHYSICS, QUANTUM_RAD))
    return {n.name: n for n in every}


def test_a_file_that_says_nothing_changes_nothing():
    plain = nuisances(PHYSICS, QUANTUM_RAD)
    assert doubted(MARVIN, plain) == plain


@pytest.mark.parametrize(
    ("way", "name"),
    [
        (("link", "tibia", "mass_kg"), "mass tibia"),
        (("contact", "friction"), "grip"),
        (("supply", "voltage_v"), "supply"),
        (("drive", "XL-320", "stall_torque_nm"), "motors"),
        (("drive", "XL-320", "coulomb_nm"), "gears"),
        (("drive", "XL-320", "motor_inertia_kg_m2"), "rotors"),
    ],
)
def test_a_number_in_doubt_widens_its_own_nuisance_alone(way, name):
    plain, wide = of(MARVIN), of(told(*way, deviation=0.2))
    assert wide[name].deviation == 0.2
    assert wide[name].reach == FARTHEST
    assert {n for n in wide if wide[n] != plain[n]} == {name}


def test_of_rotors_a_fifth_is_no_finding_where_a_file_does_not_say_how_sure_it_is():
    """No data sheet has theirs; who gives a deviation knows more."""
    told_of = told("drive", "XL-320", "motor_inertia_kg_m2", deviation=0.05)
    assert {n: one.doubt for n, one in of(MARVIN).items() if one.doubt} == {"rotors": 0.2}
    assert not any(one.doubt for one in of(told_of).values())


def test_a_number_in_great_doubt_stays_one_that_can_be():
    wide = of(told("link", "tibia", "mass_kg", deviation=1.0))["mass tibia"]
    least, most = wide.ends
    assert least == pytest.approx(LEAST - 1.0)
    assert most == FARTHEST
    lightest = with_nuisances(PHYSICS, [wide], [least])
    before, after = (next(b for b in r.bodies if "tibia" in b.name) for r in (PHYSICS, lightest))
    assert after.mass.mass_kg == pytest.approx(LEAST * before.mass.mass_kg)


def test_of_a_trunk_and_its_battery_only_what_is_in_doubt_counts():
    kg = {key: MARVIN.document["trunk"][key]["value"] for key in ("mass_kg", "battery_kg")}
    one = of(told("trunk", "battery_kg", deviation=0.5))["mass trunk"]
    assert one.deviation == pytest.approx(0.5 * kg["battery_kg"] / sum(kg.values()))
    document = told("trunk", "battery_kg", deviation=0.5).document
    document["trunk"]["mass_kg"]["deviation"] = 0.1
    both = of(parse_robot(document, MARVIN.path))["mass trunk"]
    off = math.hypot(0.5 * kg["battery_kg"], 0.1 * kg["mass_kg"])
    assert both.deviation == pytest.approx(off / sum(kg.values()))


def test_a_deviation_that_cannot_be_is_refused():
    with pytest.raises(PhysicsError, match="deviation"):
        of(told("link", "tibia", "mass_kg", deviation=-0.1))


@pytest.mark.slow
def test_a_mass_that_a_file_is_unsure_of_is_fitted_and_no_finding():
    heavy = effect("link_mass").apply(believed(), TIBIAE, {"scale": 1.6})
    course = walked_by(heavy, 41)
    sure, unsure = marvin(), told("link", "tibia", "mass_kg", deviation=0.3)
    found = {}
    for robot in (sure, unsure):
        with RobotModel(believed(), robot, [course], without=but("mass"), processes=1) as model:
            fit = RobotSearch(model).believed()
        (tibia,) = [n for n in model.nuisances if n.name == "mass tibia"]
        z = fit.nuisances[model.nuisances.index(tibia)]
        found[robot is unsure] = tibia.far(z, AT_END), z * tibia.deviation
    assert found[False][0]
    assert not found[True][0]
    assert found[True][1] == pytest.approx(0.6, abs=0.1)
