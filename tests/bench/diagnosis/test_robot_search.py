"""Which effects of a screening are fitted, and which tolerances are tried by name."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot_effects import placed_effects
from bench.diagnosis.robot_nuisances import SAME, nuisances
from bench.diagnosis.robot_screen import Screened
from bench.diagnosis.robot_search import (
    A_KIND,
    CONFIRMED,
    PROMISING,
    STRETCHED,
    stretched,
    worth_fitting,
)
from busemu.tables import load_robot
from sim.model import read_model


def one(name, nats):
    return Screened(name, nats, 1.0, 0.1)


RANKING = [one(f"effect{k}@all", 100.0 - k) for k in range(2 * CONFIRMED)]


def names(found):
    return [screened.name for screened in found]


def test_the_best_of_a_screening_are_fitted():
    assert worth_fitting(RANKING, ()) == RANKING[:CONFIRMED]


def test_few_places_of_one_effect_are_fitted():
    places = [one(f"same@{k}", 200.0 - k) for k in range(A_KIND + 2)]
    found = worth_fitting([*places, *RANKING], ())
    assert names(found)[: A_KIND + 1] == [*names(places)[:A_KIND], "effect0@all"]


def test_what_a_tolerance_stands_for_is_fitted_however_little_it_promises():
    last = one("ground_tilt.pitch@all", 0.1 * PROMISING)
    found = worth_fitting([*RANKING, last], {last.name})
    assert found == [*RANKING[:CONFIRMED], last]


def test_no_effect_is_fitted_twice():
    found = worth_fitting(RANKING, {RANKING[0].name})
    assert found == RANKING[:CONFIRMED]


@pytest.mark.parametrize("name", ["marvin", "phantomx"])
def test_every_tolerance_of_the_robot_has_the_name_of_an_effect(name):
    robot = read_model(load_robot(name))
    known = placed_effects(robot)
    of_robot = {n.name: n.same for n in nuisances(robot, 0.005) if n.same}
    assert of_robot == SAME
    assert all(same in known for several in SAME.values() for same in several)


def test_a_tolerance_at_its_end_is_tried_by_name_and_no_other():
    some = [
        SimpleNamespace(reach=2.0, same=("ground_tilt.pitch@all",)),
        SimpleNamespace(reach=2.0, same=("link_mass@trunk", "payload@all")),
        SimpleNamespace(reach=4.0, same=()),
    ]
    at = np.array([-1.01 * STRETCHED * 2.0, 0.99 * STRETCHED * 2.0, 4.0])
    assert stretched(some, at) == {"ground_tilt.pitch@all"}
    assert stretched(some, -2.0 * np.sign(at)) == {
        "ground_tilt.pitch@all",
        "link_mass@trunk",
        "payload@all",
    }
