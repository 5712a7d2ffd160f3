"""Which effects of a screening are fitted, and which tolerances are tried by name."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.nuisances import SHARE
from bench.diagnosis.robot_effects import placed_effects
from bench.diagnosis.robot_fit import RobotFit
from bench.diagnosis.robot_gains import RobotGain
from bench.diagnosis.robot_nuisances import SAME, RobotNuisance, nuisances
from bench.diagnosis.robot_screen import (
    A_KIND,
    CONFIRMED,
    PROMISING,
    STRETCHED,
    Screened,
    stretched,
    worth_fitting,
)
from bench.diagnosis.robot_search import (
    BESIDE,
    BEST,
    KEPT,
    NEEDED,
    PART,
    SPRINGS,
    WORSE,
    WORTH,
    RobotSearch,
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
        RobotNuisance("a", "rad", 1.0, "", reach=2.0, same=("ground_tilt.pitch@all",)),
        RobotNuisance("b", "(ratio)", 1.0, "", reach=2.0, same=("link_mass@trunk", "payload@all")),
        RobotNuisance("c", "rad", 1.0, "", reach=4.0),
        RobotNuisance("d", SHARE, 1.0, "", reach=2.0, same=("punch@all",)),
    ]
    at = np.array([-1.01 * STRETCHED * 2.0, 0.99 * STRETCHED * 2.0, 4.0, 2.0])
    assert stretched(some, at) == {"ground_tilt.pitch@all"}
    assert stretched(some, -2.0 * np.sign(at)) == {
        "ground_tilt.pitch@all",
        "link_mass@trunk",
        "payload@all",
    }


class Exact(RobotSearch):
    """A search whose exact replays give the same gains; squares of whole recordings are given."""

    def __init__(self, squares, large=(), found_there=0.0, borne_out=1.0, refined=None):
        curves = SimpleNamespace(tries=lambda name: [1.0, *large])
        self.model = SimpleNamespace(
            recentre=self._recentre,
            retrace=lambda settings, z: None,
            curves=curves,
            following=nullcontext,
        )
        self.more = refined or {}  #: what is gained beside that once traces are taken anew
        self.which, self.squares, self.replayed = [0], squares, []
        self.found_there = found_there  #: what is gained by a fit that begins at a large try
        self.at, self.borne_out = [], borne_out

    def _recentre(self, settings, z, which):
        self.at = [z for _, z in settings]

    def _say(self, stage):
        self.replayed.append(stage.split()[1])

    def _replayed(self, found):
        return found

    def refined(self, settled):
        return replace(settled, cost=settled.cost - self.more.get(settled.names, 0.0))

    def settle(self, found, begun=None):
        borne_out = self.borne_out if found.z.max(initial=0.0) < 8.0 else 1.0
        return replace(found, cost=borne_out * found.cost)

    def _fit(self, names, start, noise):
        assert self.at == list(start)  # replayed exactly where the fit begins
        return RobotFit(names, start, noise, -self.found_there)

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


def test_what_promises_enough_or_stands_for_a_tolerance_is_replayed():
    some = gains(1.1 * NEEDED, 0.9 * NEEDED, 0.5 * NEEDED)
    search = Exact({})
    holding(search, some, {some[-1].name})
    assert search.replayed == ["effect0@all", "effect2@all", "what", "much"]


def test_what_is_promised_is_not_divided_before_it_is_replayed():
    (gain,) = gains(1.1 * NEEDED)
    search = Exact({})
    assert holding(search, [replace(gain, inflation=5.0)]) is None
    assert search.replayed == ["effect0@all", "what"]


def test_the_best_few_are_compared_by_what_is_ordinary_beside_each_of_them():
    some = gains(*(30.0 - k for k in range(BEST + 1)))
    more = {gain.fit.names: 10.0 * k for k, gain in enumerate(some)}
    taken = holding(Exact({}, refined=more), some)
    assert taken.name == f"effect{BEST - 1}@all"
    assert taken.nats == 30.0 + 9.0 * (BEST - 1)


class Retraced(RobotSearch):
    """A search in which each of some times that traces are taken anew gains so much."""

    def __init__(self, gains):
        self.model = SimpleNamespace(retrace=lambda settings, z: self.at.append(settings))
        self.which, self.gains, self.at = [0], iter(gains), []

    def _fit(self, names, start, noise):
        return RobotFit(names, start, noise, np.nan)

    def settle(self, found, begun=None):
        return replace(begun, cost=begun.cost - next(self.gains))


def test_traces_are_taken_anew_while_that_is_worth_it():
    for first, cost in ((0.9 * WORTH, -0.9 * WORTH), (1.1 * WORTH, -1.1 * WORTH - 99.0)):
        search = Retraced([first, 99.0, 99.0])
        found = search.refined(fit("a@all", 0.0))
        assert found.cost == pytest.approx(cost)
        assert search.at[0] == (("a@all", 0.0),)


@pytest.mark.parametrize("found_there", [5.0, 500.0])
def test_where_curves_promised_too_much_a_fit_begins_at_the_large_try(found_there):
    search = Exact({}, [8.0], found_there, borne_out=0.9 * KEPT)
    taken = holding(search, gains(30.0))
    assert taken.nats == max(0.9 * KEPT * 30.0, found_there)
    assert taken.fit.z.tolist() == ([8.0] if found_there > 30.0 else [0.0])


@pytest.mark.parametrize("found_there", [5.0, 500.0])
def test_what_is_taken_is_looked_for_from_far_too(found_there):
    search = Exact({}, [8.0], found_there, borne_out=1.1 * KEPT)
    some = gains(30.0, 20.0)
    taken = holding(search, some)
    assert taken.nats == pytest.approx(max(1.1 * KEPT * 30.0, found_there))
    assert taken in some
    assert search.replayed.count("much") == 1


def test_what_was_found_far_away_is_not_looked_for_there_again():
    search = Exact({}, [8.0], 500.0)
    far = RobotFit(("a",), np.array([7.0]), {}, -30.0)
    assert search._from_far(far) is far


class Sprung(RobotSearch):
    """A search in which much of a spring gains as given, by name; curves lead from 8 to 6."""

    def __init__(self, there):
        self.model = SimpleNamespace(
            recentre=self._recentre,
            curves=SimpleNamespace(tries=lambda name: [1.0, 8.0]),
            following=nullcontext,
        )
        self.sight = SimpleNamespace(inflation=lambda fit, name: 2.0)
        self.which, self.there, self.at = [0], there, None

    def _say(self, stage):
        pass

    def _recentre(self, settings, z, which):
        self.at = tuple(settings)

    def _fit(self, names, start, noise):
        assert self.at == tuple(zip(names, start[-len(names) :], strict=True))
        return RobotFit(names, np.append(start[:-1], 6.0), noise, np.nan)

    def _replayed(self, found):
        return replace(found, cost=-self.there.get(found.names[-1], 0.0))


def test_much_of_a_spring_is_looked_for_though_nothing_promises_it():
    search, now = Sprung({"joint_compliance@femur": 1.1 * NEEDED}), fit("tips@all", 0.0)
    (small,) = gains(NEEDED)
    some = search._with_springs([small], now, SPRINGS)
    assert {gain.name for gain in some} == {small.name, "joint_compliance@femur"}
    (spring,) = (gain for gain in some if gain.name != small.name)
    assert spring.nats == pytest.approx(1.1 * NEEDED)
    assert spring.fit.settings == (("tips@all", 0.0), ("joint_compliance@femur", 6.0))
    assert search.at == now.settings  # replays are where the others are judged from


def test_much_of_a_spring_takes_the_place_of_a_little_only_if_it_gains_more():
    name, now = "joint_compliance@all", fit("", 0.0)
    little = RobotGain(name, fit(name, 30.0), 30.0, 1.0, None)
    for there, nats in ((20.0, 30.0), (40.0, 40.0)):
        (gain,) = Sprung({name: there})._with_springs([little], now, frozenset({name}))
        assert gain.nats == nats


def test_a_spring_that_is_named_already_is_not_looked_for_again():
    name = "joint_compliance@all"
    assert Sprung({name: 99.0})._with_springs([], fit(name, 0.0), frozenset({name})) == []


class Leading(RobotSearch):
    """A search whose curves always lead to 6, while exact replays cost least at 1."""

    def __init__(self):
        self.model = SimpleNamespace(recentre=self._recentre)
        self.which, self.at = [0], []

    def _recentre(self, settings, z, which):
        self.at = [z for _, z in settings]

    def _replayed(self, found):
        return replace(found, cost=float(10.0 * (found.z[0] - 1.0) ** 2))

    def _fit(self, names, start, noise):
        return RobotFit(names, np.array([6.0]), noise, 0.0)


def test_where_curves_lead_to_worse_a_part_of_the_way_is_gone():
    search = Leading()
    begun = search._replayed(RobotFit(("a",), np.array([0.0]), {}, 0.0))
    found = search.settle(search._fit(("a",), begun.z, {}), begun)
    assert found.z.tolist() == [PART * 6.0]
    assert found.cost < begun.cost
    assert search.at == [PART * 6.0]


def test_what_is_nowhere_better_than_it_was_stays():
    search = Leading()
    begun = search._replayed(RobotFit(("a",), np.array([1.0]), {}, 0.0))
    assert search.settle(search._fit(("a",), begun.z, {}), begun) is begun
    assert search.at == [1.0]


def test_an_effect_beside_others_must_gain_more():
    for nats, taken in ((0.5 * (NEEDED + BESIDE), False), (1.1 * BESIDE, True)):
        some = [replace(one, fit=fit(one.name, nats)) for one in gains(nats)]
        assert Exact({})._that_holds(fit("", 0.0), gains(nats), ()) is not None
        beside = Exact({})._that_holds(fit("other@all", 0.0), some, ())
        assert (beside is not None) is taken
