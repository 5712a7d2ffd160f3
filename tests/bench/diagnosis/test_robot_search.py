"""Which effects of a screening are fitted, and which tolerances are tried by name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot_effects import placed_effects
from bench.diagnosis.robot_fit import RobotFit
from bench.diagnosis.robot_nuisances import SAME, nuisances
from bench.diagnosis.robot_screen import Screened
from bench.diagnosis.robot_search import (
    A_KIND,
    BEHIND,
    BESIDE,
    CONFIRMED,
    EXACT,
    NEEDED,
    PROMISING,
    STRETCHED,
    WORSE,
    RobotGain,
    RobotSearch,
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


class Exact(RobotSearch):
    """A search whose exact replays give the same gains; squares of whole recordings are given."""

    def __init__(self, squares):
        self.model = SimpleNamespace(recentre=lambda settings, z, which: 0.0)
        self.which, self.squares, self.replayed = [0], squares, []

    def _say(self, stage):
        self.replayed.append(stage.split()[1])

    def settle(self, found):
        return found

    def _left_out(self, found):
        return None

    def _whole_square(self, found):
        return self.squares.get(found.names, 1.0)


def fit(name, nats):
    names = (name,) if name else ()
    return RobotFit(names, np.zeros(len(names)), {}, -nats)


def gains(*nats):
    return [
        RobotGain(f"effect{k}@all", fit(f"effect{k}@all", x), x, 1.0, None)
        for k, x in enumerate(nats)
    ]


def holding(search, some, named=()):
    return search._that_holds(fit("", 0.0), some, named)


def test_the_best_gain_of_exact_replays_is_taken():
    assert holding(Exact({}), gains(30.0, 20.0)).name == "effect0@all"


def test_what_makes_a_whole_recording_worse_is_not_taken_however_much_it_gains():
    for worse, taken in ((0.9, "effect0@all"), (1.1, "effect1@all")):
        search = Exact({("effect0@all",): worse * WORSE})
        assert holding(search, gains(30.0, 20.0)).name == taken


def test_what_stands_for_a_tolerance_is_replayed_behind_all_others():
    some = gains(*np.linspace(30.0, 20.0, EXACT + 2))
    search = Exact({})
    holding(search, some, {some[-1].name})
    assert search.replayed == [f"effect{k}@all" for k in (*range(EXACT), EXACT + 1)]


def test_what_is_far_behind_an_exact_gain_is_not_replayed():
    search = Exact({})
    holding(search, gains(100.0, 1.1 * 100.0 * BEHIND, 0.9 * 100.0 * BEHIND))
    assert search.replayed == ["effect0@all", "effect1@all"]


def test_an_effect_beside_others_must_gain_more():
    for nats, taken in ((0.5 * (NEEDED + BESIDE), False), (1.1 * BESIDE, True)):
        some = [replace(one, fit=fit(one.name, nats)) for one in gains(nats)]
        assert Exact({})._that_holds(fit("", 0.0), gains(nats), ()) is not None
        beside = Exact({})._that_holds(fit("other@all", 0.0), some, ())
        assert (beside is not None) is taken
