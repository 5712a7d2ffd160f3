"""Which effects of a screening are fitted, and which tolerances are tried by name."""

from collections import defaultdict
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.joint.nuisances import SHARE
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.exact import REFINED, SHARES, WORTH, ExactFits
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import APART_NATS, HOPELESS, NEEDED, RobotGain
from bench.diagnosis.robot.nuisances import COMMON, SAME, RobotNuisance, nuisances
from bench.diagnosis.robot.screen import (
    A_KIND,
    CONFIRMED,
    PROMISING,
    STRETCHED,
    Screened,
    stretched,
    worth_fitting,
)
from bench.diagnosis.robot.search import RobotSearch
from bench.diagnosis.robot.sought import Pair
from bench.diagnosis.robot.steps import (
    BEHIND,
    BESIDE,
    BEST,
    HELD_OUT,
    HINTED,
    LESS,
    PROMISED,
    RIVALS,
    SOUND_RAD,
    WORSE,
    much_worse,
)
from bench.diagnosis.watch import OutOfTimeError
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
    every = nuisances(robot, 0.005)
    assert {n.name: n.same for n in every if n.common} == SAME
    zeros = {joint.name: f"zero_offset@{joint.name}" for joint in robot.joints}
    own = {n.name.removeprefix("zero "): n.same for n in every if n.same and not n.common}
    assert own == {joint: (name,) for joint, name in zeros.items()}
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
    """A search whose exact replays give what was promised; squares of whole recordings are given.

    ``found_there`` is what is gained by a fit that begins at a large try, ``more`` what is gained
    beside that once traces are taken anew, ``ordinary`` what is gained without an effect by a fit
    that begins where one with it has led.
    """

    def __init__(self, squares, large=(), found_there=0.0, refined=None, ordinary=0.0):
        curves = SimpleNamespace(tries=lambda name: [1.0, *large])
        anything = SimpleNamespace(parameter=SimpleNamespace(unit=""), knob=None)
        placed = defaultdict(lambda: anything)
        self.model = SimpleNamespace(curves=curves, following=nullcontext, placed=placed)
        self.more, self.ordinary = refined or {}, ordinary
        self.which, self.squares, self.said = [0], squares, []
        self.found_there, self.promised, self.last = found_there, {}, None
        self.far = {}  #: knobs of what stands for a tolerance at its end
        self.sight = SimpleNamespace(held={})

    def _say(self, stage):
        self.said.append(stage.split()[1])

    def replayed(self, found):
        return found

    def around(self, found):
        self.last = found

    def _beyond(self, now):
        return self.far

    def refined(self, settled):
        return replace(settled, cost=settled.cost - self.more.get(settled.names, 0.0))

    def begun(self, names, knobs, noise=None, nuisances=None, most=np.inf):
        gained = self.ordinary
        if nuisances is None:
            large = max(knobs, default=0.0) >= 8.0
            gained = self.found_there if large else self.promised[tuple(names)]
        return RobotFit(tuple(names), np.asarray(knobs), noise, -gained)

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


def chosen(search, some, now=None, named=()):
    search.promised = {gain.fit.names: gain.nats for gain in some}
    return search._chosen(now or fit("", 0.0), some, named)


def holding(search, some, now=None, named=()):
    return chosen(search, some, now, named)[0]


def test_the_best_gain_is_taken():
    assert holding(Exact({}), gains(30.0, 20.0)).name == "effect0@all"


@pytest.mark.parametrize(
    ("trunk", "weight", "taken"),
    [
        (30.0, 20.0, "payload@all"),
        (30.0, 9.0, "link_mass@trunk"),  # beyond what fits end apart by
        (30.0, 40.0, "payload@all"),
    ],
)
def test_a_weight_on_a_trunk_is_likelier_than_a_trunk_as_heavy(trunk, weight, taken):
    own = {"link_mass@trunk": trunk, "payload@all": weight}
    some = [RobotGain(name, fit(name, x), x, 1.0, None) for name, x in own.items()]
    best = max(some, key=lambda gain: gain.nats)
    assert holding(Exact({}), [best, *(gain for gain in some if gain is not best)]).name == taken
    assert holding(Exact({(taken,): 1.1 * WORSE}), some).name != taken


def test_what_makes_a_whole_recording_worse_is_not_taken_however_much_it_gains():
    for worse, taken in ((0.9, "effect0@all"), (1.1, "effect1@all")):
        search = Exact({("effect0@all",): worse * WORSE})
        assert holding(search, gains(30.0, 20.0)).name == taken


@pytest.mark.parametrize(
    ("square", "begun", "much"),
    [
        (0.9 * WORSE, 0.1, False),
        (1.1 * WORSE, 0.1, True),
        (1.9 * WORSE, 2.0, False),
        (2.1 * WORSE, 2.0, True),
    ],
)
def test_a_whole_recording_is_much_worse_beyond_what_it_was_and_what_chance_makes(
    square, begun, much
):
    assert much_worse(square * SOUND_RAD**2, begun * SOUND_RAD**2) is much


def test_half_of_the_truth_may_make_a_whole_recording_worse_meanwhile():
    worse = {("effect0@all",): 1.1 * WORSE, ("effect1@all",): 9.0 * WORSE}
    assert holding(Exact(worse), gains(20.0, 30.0)).name == "effect1@all"


@pytest.mark.parametrize(("whole", "left"), [(0.9, 2), (1.1, 1)])
def test_in_the_end_what_makes_a_whole_recording_worse_goes(whole, left):
    search = Exact({("effect0@all", "effect1@all"): whole * WORSE})
    both = RobotFit(("effect0@all", "effect1@all"), np.zeros(2), {}, -50.0)
    search.sight = SimpleNamespace(without=lambda found, name: fit("effect0@all", 30.0))
    search.settle = lambda found: found
    base = fit("", 0.0)
    now, taken = search._standing(base, both, gains(30.0, 20.0))
    assert [gain.name for gain in taken] == list(both.names[:left])
    assert now.names == both.names[:left]
    search.squares[("effect0@all",)] = whole * WORSE
    now, taken = search._standing(base, fit("effect0@all", 30.0), gains(30.0))
    assert (now is base) is (taken == []) is (left == 1)


@pytest.mark.parametrize(
    ("lost", "own", "kept"),
    [
        (1.1 * NEEDED, 1.0, 2),
        (0.9 * NEEDED, 1.0, 1),
        (3.3 * NEEDED, 3.0, 2),
        (2.7 * NEEDED, 3.0, 1),
        (5.5 * NEEDED, 30.0, 2),  # divided by no more than its gain was
        (4.5 * NEEDED, 30.0, 1),
    ],
)
def test_those_are_dropped_again_without_which_the_rest_does_as_well(lost, own, kept):
    search = Exact({})
    both = RobotFit(("effect0@all", "effect1@all"), np.zeros(2), {}, -500.0)
    left = {
        "effect0@all": fit("effect1@all", 0.0),
        "effect1@all": fit("effect0@all", 500.0 - lost),
    }
    search.sight = SimpleNamespace(
        without=lambda now, name: left[name], inflation=lambda now, name: own
    )
    taken = [replace(gain, inflation=5.0) for gain in gains(400.0, 100.0)]
    now, rest = search._prune(both, taken)
    assert rest == taken[:kept]
    assert now is (both if kept == 2 else left["effect1@all"])


@pytest.mark.parametrize(("nats", "deeper"), [(31.0, True), (29.0, False)])
def test_what_is_left_without_the_last_goes_on_as_it_was_before_that(nats, deeper):
    """Where the last has led the others astray, no small step leads back."""
    one, astray = fit("effect0@all", nats), fit("effect0@all", 30.0)
    search = Exact({("effect0@all", "effect1@all"): 1.1 * WORSE})
    search.sight = SimpleNamespace(without=lambda found, name: astray)
    search.settle = lambda found: found
    both = RobotFit(("effect0@all", "effect1@all"), np.zeros(2), {}, -50.0)
    taken = [replace(gain, fit=at) for gain, at in zip(gains(30.0, 20.0), (one, both), strict=True)]
    now, left = search._standing(fit("", 0.0), both, taken)
    assert now is (one if deeper else astray)
    assert left == taken[:1]


def test_what_promises_most_and_what_stands_for_a_tolerance_is_tried():
    every = (*range(PROMISED + 2), 0.5 * HINTED)
    some = gains(*(1.1 * HINTED - 0.01 * k for k in every[:-1]), every[-1])
    for named, tried in (((), some[:PROMISED]), ((some[-1].name,), [*some[:PROMISED], some[-1]])):
        search = Exact({})
        *_, found = chosen(search, list(some), named=named)
        assert search.said[: len(tried)] == [gain.name for gain in tried]
        assert [gain.name for gain in found] == [gain.name for gain in tried]  # and no other
        assert [gain.nats for gain in found] == pytest.approx([gain.nats for gain in tried])
    search = Exact({})
    assert holding(search, gains(0.9 * HINTED)) is None
    assert search.said == []
    # what is called noise has what is the matter in it: a little less than a name needs is tried
    chosen(search, gains(0.9 * NEEDED))
    assert search.said[:1] == ["effect0@all"]


def every(some):
    """Names of gains, so that all of them are tried."""
    return {gain.name for gain in some}


def test_what_was_not_fitted_to_the_end_is_as_far_behind_the_best_as_it_was_before():
    some = gains(*(60.0 - 10.0 * k for k in range(BEST + 1)))
    more = {some[0].fit.names: 5.0}
    taken, _, found = chosen(Exact({}, refined=more), some, named=every(some))
    assert taken.nats >= 65.0
    assert found[BEST].nats == pytest.approx(taken.nats - 10.0 * BEST)


def test_what_stands_for_a_tolerance_begins_beyond_its_end():
    search, some = Exact({}), gains(30.0, 20.0)
    search.far = {some[1].name: 5.0}
    tried = []
    search.begun = lambda names, knobs, *_, most: tried.append((names[-1], *knobs)) or some[0].fit
    search._tried(fit("", 0.0), some, {some[1].name})
    assert tried == [(some[0].name, 0.0), (some[1].name, 5.0)]


def test_beside_another_a_name_begins_as_well_where_that_has_not_taken_its_part():
    search, some = Exact({}), gains(30.0)
    search.far = {some[0].name: 5.0}
    begun, better = [], replace(some[0].fit, cost=-50.0)

    def begins(names, knobs, *_, most):
        begun.append(tuple(knobs))
        return better if knobs[0] == 2.0 * LESS else some[0].fit

    search.begun = begins
    now = RobotFit(("first@all",), np.array([2.0]), {}, 0.0)
    (tried,) = search._tried(now, some, set())
    assert begun == [(2.0, 5.0), (2.0 * LESS, 5.0)]
    assert tried.fit is better
    begun.clear()
    search.sight.held["first@all"] = 2.0  # as play is that shaking has named
    search._tried(now, some, set())
    assert begun == [(2.0, 5.0)]


def test_what_falls_far_behind_the_best_that_was_tried_is_not_gone_on_with():
    search, some = Exact({}), gains(30.0, 20.0, 50.0)
    search.promised = {gain.fit.names: gain.nats for gain in some}
    plain, asked = search.begun, []
    search.begun = lambda *told, most: asked.append(most) or plain(*told)
    search._tried(fit("", 0.0), some, set())
    assert asked == [np.inf, -30.0 + RIVALS, -30.0 + RIVALS]


@pytest.mark.parametrize(("behind", "fitted"), [(0.9, 2), (1.1, 1)])
def test_the_next_best_is_fitted_to_the_end_if_it_is_not_far_behind(behind, fitted):
    search, asked = Exact({}), []
    plain = search.refined
    search.refined = lambda found: asked.append(found.names) or plain(found)
    some = gains(300.0, 300.0 - behind * HOPELESS)
    *_, tried = chosen(search, some)
    assert len([names for names in asked if names]) == fitted
    assert tried[1].nats == pytest.approx(some[1].nats)
    assert (tried[1].because == BEHIND) is (fitted == 1)


@pytest.mark.parametrize(
    ("there", "first", "nats"),
    [
        (70.0, "effect1@all", 70.0),  # it is ahead, begun where the best has led
        (50.0, "effect0@all", 50.0),  # it is nearer
        (35.0, "effect0@all", 45.0),  # it was deeper before
    ],
)
def test_what_is_behind_begins_once_more_from_where_the_best_has_led(there, first, nats):
    search, begun, some = Exact({}), [], gains(60.0, 45.0)
    plain = search.begun

    def begins(names, knobs, noise=None, nuisances=None, most=np.inf):
        if nuisances is None or not names:
            led = plain(names, knobs, noise, nuisances, most)
            return (
                replace(led, z=np.append(0.1 if names == some[0].fit.names else 0.2, led.z))
                if names
                else led
            )
        begun.append((tuple(names), tuple(nuisances), most))
        return RobotFit(tuple(names), np.asarray(knobs), noise, -there)

    search.begun = begins
    taken, _, found = chosen(search, some)
    assert begun == [(some[1].fit.names, (0.1,), -45.0)]
    assert taken.name == first
    assert {gain.name: gain.nats for gain in found} == {"effect0@all": 60.0, "effect1@all": nats}


@pytest.mark.parametrize(("behind", "asked"), [(0.9, True), (1.1, False)])
def test_what_is_far_behind_in_place_of_another_is_not_asked_of_groups_left_out(behind, asked):
    steps = [tuple(gains(30.0, 20.0)), (gains(20.0, 5.0, 50.0)[2],)]
    both = RobotFit(("effect0@all", "effect2@all"), np.zeros(2), {}, -50.0)
    search, limits, groups = Exact({}), [], []

    def thoroughly(names, knobs, noise, *, most):
        limits.append(most)
        return replace(both, names=tuple(names), cost=-50.0 + behind * HOPELESS)

    search.thoroughly = thoroughly
    search._left_out = lambda found: groups.append(found.names)
    now, *_ = search._exchanged(both, [step[0] for step in steps], steps)
    assert now is both
    assert limits == [-50.0 + HOPELESS]
    assert (("effect1@all", "effect2@all") in groups) is asked


@pytest.mark.parametrize(("gained", "first"), [(60.0, "effect1@all"), (40.0, "effect0@all")])
def test_the_next_best_takes_its_place_if_it_does_better_beside_what_was_found_later(gained, first):
    steps = [tuple(gains(30.0, 20.0)), (gains(20.0, 5.0, 50.0)[2],)]
    taken, tried = [step[0] for step in steps], list(steps)
    both = RobotFit(("effect0@all", "effect2@all"), np.zeros(2), {}, -50.0)
    search = Exact({})
    search.promised = {("effect1@all", "effect2@all"): gained}
    now, taken, tried = search._exchanged(both, taken, tried)
    assert now.names == (first, "effect2@all")
    assert now.cost == -max(50.0, gained)
    assert taken[0].name == tried[0][0].name == first
    assert taken[0] is tried[0][0]  # by which its rivals are found
    assert {gain.name for gain in tried[0]} == {"effect0@all", "effect1@all"}
    assert taken[0].nats == 30.0 + max(0.0, gained - 50.0)
    assert search.last is now


@pytest.mark.parametrize(
    ("weight", "more", "first"),
    [
        ("effect0@all", 0.9 * APART_NATS, "effect0@all"),
        ("effect0@all", 1.1 * APART_NATS, "effect1@all"),
        ("effect3@all", 0.9 * APART_NATS, "effect1@all"),
    ],
)
def test_the_less_likely_of_two_that_are_one_takes_no_place_by_chance(
    monkeypatch, weight, more, first
):
    monkeypatch.setattr("bench.diagnosis.robot.search.ONE_WITH", {"effect1@all": weight})
    steps = [tuple(gains(30.0, 20.0)), (gains(20.0, 5.0, 50.0)[2],)]
    both = RobotFit(("effect0@all", "effect2@all"), np.zeros(2), {}, -50.0)
    search = Exact({})
    search.promised = {("effect1@all", "effect2@all"): 50.0 + more}
    now, *_ = search._exchanged(both, [step[0] for step in steps], steps)
    assert now.names[0] == first


def test_what_was_found_alone_is_exchanged_for_nothing():
    search, now = Exact({}), fit("effect0@all", 30.0)
    some = gains(30.0, 20.0)
    assert search._exchanged(now, some[:1], [tuple(some)]) == (now, some[:1], [tuple(some)])
    assert search.said == []


def test_what_groups_left_out_do_worse_with_is_not_exchanged():
    step = tuple(replace(gain, held_out=5.0) for gain in gains(30.0, 20.0))
    later = gains(20.0, 5.0, 50.0)[2]
    both = RobotFit(("effect0@all", "effect2@all"), np.zeros(2), {}, -50.0)
    for worse, first in ((0.0, "effect1@all"), (5.1 + step[1].apart, "effect0@all")):
        search = Exact({})
        search.promised = {("effect1@all", "effect2@all"): 60.0}
        search._left_out = lambda fit, worse=worse: worse if "effect1@all" in fit.names else 0.0
        now, taken, _ = search._exchanged(both, [step[0], later], [step, (later,)])
        assert now.names[0] == taken[0].name == first


def test_an_exchange_that_time_runs_out_in_changes_nothing():
    some = gains(30.0, 20.0, 25.0, 15.0, 20.0)
    tried = [tuple(some[:2]), tuple(some[2:4]), tuple(some[4:])]
    taken = [step[0] for step in tried]
    before = list(taken), list(tried)
    now = RobotFit(tuple(gain.name for gain in taken), np.zeros(3), {}, -50.0)
    search = Exact({})
    search.promised = {("effect1@all", *now.names[1:]): 60.0}

    def say(stage):
        if "effect3" in stage:
            raise OutOfTimeError(stage)

    search._say = say
    with pytest.raises(OutOfTimeError):
        search._exchanged(now, taken, tried)
    assert (taken, tried) == before


def test_the_best_few_are_compared_by_what_is_ordinary_beside_each_of_them():
    some = gains(*(30.0 - k for k in range(BEST + 1)))
    more = {gain.fit.names: 10.0 * k for k, gain in enumerate(some)}
    taken, *_ = chosen(Exact({}, refined=more), some, named=every(some))
    assert taken.name == f"effect{BEST - 1}@all"
    assert taken.nats >= 30.0 + 9.0 * (BEST - 1)


class Strained(RobotSearch):
    """A search whose believed fit has its tolerances where they are told."""

    def __init__(self, base, z):
        every = tuple(nuisances(base, 0.005))
        self.model = SimpleNamespace(base=base, nuisances=every, placed=placed_effects(base))
        self.now = RobotFit((), np.array([z.get(n.name, 0.0) for n in every]), {}, 0.0)


def test_what_is_beyond_a_tolerance_is_twice_its_end_on_its_side():
    base = read_model(load_robot("marvin"))
    search = Strained(base, {"gain": -2.0, "mass tibia": 2.0, "mass trunk": -2.0, "grip": 1.0})
    knobs = search._beyond(search.now)
    known = search.model.placed
    assert {name: known[name].knob.value(z) for name, z in knobs.items()} == pytest.approx(
        {
            "gain_error@all": 1.0 - 4.0 * COMMON["gain"][1],
            "link_mass@tibia": 1.0 + 4.0 * COMMON["mass"][1],
            "link_mass@trunk": 1.0 - 4.0 * COMMON["mass"][1],
        }
    )


class Retraced(ExactFits):
    """A search in which each of some times that traces are taken anew gains so much."""

    def __init__(self, gains):
        self.model = SimpleNamespace(retrace=lambda settings, z: self.at.append(settings))
        self.which, self.gains, self.at = [0], iter(gains), []

    def fitted(self, names, start, noise):
        return RobotFit(names, start, noise, np.nan)

    def settle(self, found, begun=None):
        return replace(begun, cost=begun.cost - next(self.gains))


def test_traces_are_taken_anew_while_that_is_worth_it():
    enough, little = 1.1 * WORTH, 0.9 * WORTH
    for gained, cost in (([little, 99.0], little), ([enough, little, 99.0], enough + little)):
        search = Retraced([*gained, *[99.0] * REFINED])
        found = search.refined(fit("a@all", 0.0))
        assert found.cost == pytest.approx(-cost)
        assert search.at[0] == (("a@all", 0.0),)


@pytest.mark.parametrize("found_there", [5.0, 500.0])
def test_what_is_taken_is_looked_for_from_far_too(found_there):
    search = Exact({}, [8.0], found_there)
    some = gains(30.0, 20.0)
    taken, _, found = chosen(search, some)
    assert taken.nats == max(30.0, found_there)
    assert any(taken is gain for gain in found)  # by which its rivals are found


@pytest.mark.parametrize("much", [20.0, 50.0])
def test_of_what_is_begun_twice_the_better_is_tried(much):
    (little,) = gains(30.0)
    more = replace(little, fit=replace(little.fit, z=np.array([8.0])))
    search = Exact({}, found_there=much)
    taken, _, found = chosen(search, [more, little])
    assert taken.nats == max(much, 30.0)
    assert len(found) == 1


def test_what_is_ordinary_may_begin_where_an_effect_has_led():
    for ordinary, left in ((0.0, 30.0), (10.0, 20.0), (30.0 - 0.9 * NEEDED, None)):
        some = gains(30.0, 5.0)
        search = Exact({}, ordinary=ordinary)
        taken, now, found = chosen(search, some)
        assert (None if taken is None else taken.nats) == left
        assert now.cost == -ordinary
        assert found[0].nats == pytest.approx(30.0 - ordinary)
        assert search.last is (now if taken is None else taken.fit)


def test_groups_left_out_are_asked_of_a_fit_where_it_is_known_what_all_does_there():
    search, asked = Exact({}), []
    search._left_out = lambda found: asked.append((found.names, search.last)) or found.cost
    taken, *_ = chosen(search, gains(30.0, 20.0), begun := fit("", 0.0))
    assert asked[0] == ((), begun)
    assert asked[0][1] is begun
    assert taken.held_out == 30.0


def test_where_what_is_ordinary_does_better_a_gain_is_over_that_on_groups_left_out_too():
    search, asked = Exact({}, ordinary=10.0), []
    costs = {(): iter((100.0, 93.0))}
    search._left_out = lambda found: (
        asked.append(found.names) or next(costs.setdefault(found.names, iter((60.0, 60.0, np.nan))))
    )
    taken, now, _ = chosen(search, gains(30.0))
    assert (taken.nats, now.cost) == (20.0, -10.0)
    assert taken.held_out == 93.0 - 60.0
    assert asked.count(("effect0@all",)) == 2  # once from afar, and not again where traces are new


def test_where_nothing_holds_what_is_ordinary_stays_as_it_was():
    search, begun = Exact({}, ordinary=99.0), fit("", 0.0)
    assert chosen(search, gains(0.9 * HINTED), begun) == (None, begun, ())
    assert search.last is begun


def test_what_was_found_far_away_is_not_looked_for_there_again():
    search = Exact({}, [8.0], 500.0)
    far = RobotFit(("a",), np.array([7.0]), {}, -30.0)
    assert search._from_far(far) is far


def reasons(search, some, now=None):
    return [gain.because for gain in chosen(search, some, now, named=every(some))[2]]


def test_what_is_not_taken_is_told_why():
    better = "another one did better"
    some = gains(*(60.0 - 10.0 * k for k in range(BEST + 1)))
    assert reasons(Exact({}), some) == ["", *[better] * (BEST - 1), BEHIND]
    few = "less than the 7 nats that a name needs"
    assert reasons(Exact({}), gains(0.9 * NEEDED)) == [few]
    beside = f"less than the {BESIDE:.0f} nats that a name needs beside what is named"
    search = Exact({})
    search.begun = lambda names, knobs, noise, *, most: RobotFit(
        tuple(names), np.append([1.0], knobs[-1:]), noise, -0.9 * BESIDE
    )
    now = fit("effect9@all", 0.0)
    more = [replace(g, fit=replace(g.fit, names=(*now.names, g.name))) for g in gains(30.0)]
    assert reasons(search, more, now) == [beside]
    search = Exact({})
    search._left_out = lambda found: 100.0 if found.names else 50.0
    (why,) = reasons(search, gains(30.0))
    assert "left out in turn are no better" in why


class Beginning(RobotSearch):
    """A search that tells where its fits begin, and at what cost they settle."""

    def __init__(self, settled=0.0):
        self.model = SimpleNamespace(
            nuisances=[None, None],
            bend=lambda settings, z: self.done.append(("bend", settings, z.tolist())),
            recentre=lambda settings, z, which: self.done.append(("replay", settings, z.tolist())),
            following=nullcontext,
        )
        wide = np.full(3, 2.0)
        self.sight = SimpleNamespace(box=lambda names: (-wide, wide))
        self.which, self.done, self.settled = [0], [], settled

    def fitted(self, names, start, noise):
        self.done.append(("fit", start.tolist()))
        return RobotFit(names, start, noise, 0.0)

    def settle(self, found, begun=None, most=np.inf):
        self.done.append(("settle", most))
        return replace(found, cost=self.settled)

    def refined(self, settled):
        self.done.append("refine")
        return settled

    def replayed(self, found):
        return found


@pytest.mark.parametrize(
    ("nuisances", "there"), [(None, [0.0, 0.0]), (np.array([1.0, 9.0]), [1, 2])]
)
def test_a_hypothesis_begins_as_believed_or_where_it_is_told(nuisances, there):
    search = Beginning()
    found = search.begun(("a@all",), np.array([1.5]), None, nuisances)
    at = (("a@all", 1.5),)
    assert found.settings == at
    begun = [("bend", at, there), ("replay", at, there), ("fit", [*there, 1.5])]
    assert search.done == [*begun, ("settle", np.inf)]


@pytest.mark.parametrize(("settled", "done"), [(6.0, True), (8.0, False)])
def test_what_begins_to_cost_too_much_is_not_refined(settled, done):
    search = Beginning(settled=settled)
    found = search.thoroughly(("a@all",), np.array([1.5]), most=7.0)
    assert ("refine" in search.done) is done
    assert found.cost == settled


class Leading(ExactFits):
    """A search whose curves always lead to 6, while exact replays cost least elsewhere."""

    def __init__(self, least):
        self.model = SimpleNamespace(recentre=self._recentre, ahead=self._ahead)
        self.which, self.at, self.asked, self.least = [0], [], [], least
        self.beside = []

    def _recentre(self, settings, z, which):
        self.at = [z for _, z in settings]

    def _ahead(self, robots, which):
        assert which == self.which
        self.beside.append([z for ((_, z),), _ in robots])

    def replayed(self, found):
        self.asked.append(found.z[0])
        self.model.recentre(found.settings, found.nuisances, self.which)
        return replace(found, cost=self.cost(found.z[0]))

    def cost(self, z):
        return float(10.0 * (z - self.least) ** 2)

    def fitted(self, names, start, noise):
        assert self.at == start.tolist()  # residuals are those of the best
        return RobotFit(names, np.array([6.0]), noise, 0.0)


@pytest.mark.parametrize(("most", "left"), [(-61.0, True), (-59.0, False)])
def test_a_fit_that_cannot_come_to_so_little_is_left_where_that_shows(most, left):
    """It stands at 40 and curves lead to -10; with as much again they would lead to -60.

    Half of what they lead to is told.
    """
    search = Leading(4.0)
    search.cost = lambda z: 40.0
    search.fitted = lambda names, start, noise: RobotFit(names, np.array([6.0]), noise, -10.0)
    found = search.settle(RobotFit(("a",), np.array([0.0]), {}, 0.0), most=most)
    assert (found.cost, found.z[0]) == ((15.0, 6.0) if left else (40.0, 0.0))
    assert (len(search.asked) == 1) is left


def test_a_fit_that_has_settled_is_told_as_it_is_wherever_it_would_go_on():
    search, costs, led = Leading(4.0), iter((40.0, 30.0, 20.0)), iter((0.0, 0.0, 19.0))
    search.replayed = search._on_the_way = lambda *fits: replace(fits[-1], cost=next(costs))
    search.fitted = lambda names, start, noise: RobotFit(names, start, noise, next(led))
    assert search.settle(RobotFit(("a",), np.array([0.0]), {}, 0.0), most=12.0).cost == 20.0


@pytest.mark.parametrize(("least", "share"), [(6.2, 1.0), (3.5, 0.6), (1.7, 0.3), (0.6, 0.1)])
def test_as_much_of_the_way_that_curves_lead_is_gone_as_does_best(least, share):
    search = Leading(least)
    begun = search.replayed(RobotFit(("a",), np.array([0.0]), {}, 0.0))
    search.asked.clear()
    found = search.settle(search.fitted(("a",), begun.z, {}), begun)
    (first, *_) = (z for z in search.asked if z == pytest.approx(6.0 * share))
    assert found.cost <= search.cost(first) < begun.cost
    asked = [6.0 * each for each in SHARES[: SHARES.index(share) + 2]]  # and none beyond
    assert search.asked[: len(asked)] == pytest.approx(asked)
    assert search.beside[0] == asked[:2]
    if share in SHARES[1:]:
        assert search.beside[1] == pytest.approx([6.0 * each for each in SHARES[2:]])
    beyond = [6.0 * each for each in SHARES[SHARES.index(share) + 2 :]]
    assert search.asked[len(asked)] not in beyond
    assert search.at == found.z.tolist()


def test_shares_of_the_way_are_tried_until_one_is_better_than_where_it_began():
    search = Leading(0.0)
    begun = search.replayed(RobotFit(("a",), np.array([0.0]), {}, 0.0))
    costs = dict(zip([6.0 * share for share in SHARES], (5.0, 7.0, 6.0, -1.0), strict=True))
    search.cost = lambda z: costs.get(z, 0.0)
    assert search.settle(search.fitted(("a",), begun.z, {}), begun).z == [6.0 * SHARES[-1]]


@pytest.mark.parametrize("stiff", [True, False])
def test_a_robot_that_no_engine_can_run_costs_more_than_any(stiff):
    off_rad = float("inf") if stiff else 1e-4
    search = Beginning()
    search.model.recentre = lambda *_: off_rad
    search.sight = SimpleNamespace(at=lambda found: replace(found, cost=-50.0))
    asked = RobotFit(("a",), np.array([1.0]), {}, -99.0)
    assert ExactFits.replayed(search, asked).cost == (np.inf if stiff else -50.0)


def test_of_a_way_into_what_no_engine_can_run_the_rest_is_gone():
    search = Leading(6.0)
    search.cost = lambda z: np.inf if z > 3.0 else 10.0 - z
    begun = search.replayed(RobotFit(("a",), np.array([0.0]), {}, 0.0))
    found = search.settle(search.fitted(("a",), begun.z, {}), begun)
    assert 0.0 < found.z[0] <= 3.0
    assert np.isfinite(found.cost)


def test_what_is_nowhere_better_than_it_was_stays():
    search = Leading(1.0)
    begun = search.replayed(RobotFit(("a",), np.array([1.0]), {}, 0.0))
    assert search.settle(search.fitted(("a",), begun.z, {}), begun) is begun
    assert search.at == [1.0]


@pytest.mark.parametrize(
    ("gained", "outside", "holds"),
    [
        (1.1 * NEEDED, 1.1 * HELD_OUT, True),
        (1.1 * NEEDED, 0.9 * HELD_OUT, False),
        (0.9 * BESIDE, 0.9 * HELD_OUT, False),
        (1.1 * BESIDE, -0.9 * APART_NATS, True),
        (1.1 * BESIDE, -1.1 * APART_NATS, False),
    ],
)
def test_what_gains_nothing_on_groups_left_out_must_gain_more_and_lose_little(
    gained, outside, holds
):
    search = Exact({})
    search._left_out = lambda fit: -outside if fit.names else 0.0
    assert (holding(search, gains(gained)) is not None) is holds


@pytest.mark.parametrize(
    ("once", "holds"), [(0.0, False), (0.9 * NEEDED, False), (1.1 * NEEDED, True)]
)
def test_what_voltages_tell_is_not_deflated(once, holds):
    """A supply of 0.87 gained 34 nats, nearly all of them of voltages: 6 deflated by 5.7."""
    now = RobotFit((), np.zeros(0), {}, 0.0, once=50.0)
    found = RobotFit(("effect0@all",), np.zeros(1), {}, -once, once=50.0 - once)
    gain = RobotGain("effect0@all", found, once, 5.7, 30.0)
    assert gain.counting(now) == pytest.approx(once)
    assert Exact({})._holds(gain, now) is holds


@pytest.mark.parametrize(("shown", "holds"), [(0.0, False), (0.9, False), (1.1, True)])
def test_what_registers_show_by_themselves_asks_no_group(shown, holds):
    """A gain of 0.75 in a leg that stands: groups left out cost more, as where feet stick does."""
    now = RobotFit((), np.zeros(0), {}, 0.0, once=50.0)
    left = 50.0 - shown * BESIDE
    found = RobotFit(("effect0@all",), np.zeros(1), {}, -40.0, once=left)
    gain = RobotGain("effect0@all", found, 40.0, 1.2, -3.0 * APART_NATS)
    assert Exact({})._holds(gain, now) is holds


def test_what_joints_tell_is_deflated_beside_voltages():
    now = RobotFit((), np.zeros(0), {}, 100.0, once=30.0)
    gain = RobotGain("a", RobotFit(("a",), np.zeros(1), {}, 60.0, once=10.0), 40.0, 4.0, None)
    assert gain.counting(now) == pytest.approx(20.0 + 20.0 / 4.0)
    worse = RobotGain("a", RobotFit(("a",), np.zeros(1), {}, 60.0, once=50.0), 40.0, 4.0, None)
    assert worse.counting(now) == pytest.approx(-20.0 + 60.0 / 4.0)


@pytest.mark.parametrize(("delay_s", "holds"), [(1.1e-3, False), (2.4e-3, False), (2.6e-3, True)])
def test_a_delay_within_a_firmwares_ticks_is_no_finding(delay_s, holds):
    placed = placed_effects(read_model(load_robot("marvin")))
    name = "transport_delay@femur"
    z = placed[name].knob.at(delay_s)
    late = RobotGain(name, RobotFit((name,), np.array([z]), {}, -99.0), 99.0, 1.0, 30.0)
    search = Exact({})
    search.model.placed = placed
    assert search._holds(late, fit("", 0.0)) is holds


def test_an_effect_beside_others_must_gain_more():
    for nats, taken in ((0.5 * (NEEDED + BESIDE), False), (1.1 * BESIDE, True)):
        some = [replace(one, fit=fit(one.name, nats)) for one in gains(nats)]
        assert holding(Exact({}), gains(nats)) is not None
        beside = holding(Exact({}), some, now=fit("other@all", 0.0))
        assert (beside is not None) is taken


NOTHING = SimpleNamespace(
    beside=lambda now, gains: gains,
    asked=lambda gains: set(),
    after=lambda fitted: NOTHING,
    rivals=lambda now: NOTHING,
    at={},
    pairs=(),
)


class Stepping(RobotSearch):
    """A search each of whose steps takes an effect, and gains as much as the one before."""

    def __init__(self):
        own = {"levels": (), "left_out": lambda without: False}
        placed = {f"effect{k}@all": SimpleNamespace(effect=effect(k), **own) for k in range(9)}
        self.model = SimpleNamespace(placed=placed, nuisances=[])
        self.steps = []
        self._say = lambda _: None
        self.around = lambda found: None
        self.screen = lambda now: SimpleNamespace(rank=list)
        self.sight = None
        self._sought = lambda names: NOTHING
        self._exchanged = lambda now, taken, tried: (now, taken, tried)
        self._alike = lambda *_: ()
        self._prune = self._standing_as_taken
        self.settle = lambda found: replace(found, cost=found.cost - 1.0)
        self._worth_looking = lambda first, named: []

    @staticmethod
    def _standing_as_taken(now, taken):
        return now, taken

    def _standing(self, base, now, taken):
        return now, taken

    def _step(self, some, now, step):
        self.steps.append(step)
        return []

    def _chosen(self, now, promised, named):
        name = f"effect{len(now.names)}@all"
        gain = RobotGain(name, fit_of((*now.names, name)), 99.0, 1.0, None)
        return gain, now, (gain,)


def effect(k):
    return SimpleNamespace(name=f"effect{k}")


def fit_of(names):
    return RobotFit(tuple(names), np.zeros(len(names)), {}, 0.0)


@pytest.mark.parametrize("enough", [1, 2, 9])
def test_of_a_fit_that_is_done_nothing_more_is_asked(enough):
    search = Stepping()
    found = search.run(most=3, base=fit_of(()), done=lambda now: len(now.names) >= enough)
    assert len(found.taken) == min(enough, 3)
    assert search.steps == list(range(min(enough, 3)))
    assert found.fit.cost == found.taken[-1].fit.cost - 1.0  # settled, as those without a name are


def test_beside_a_fit_that_is_done_nothing_is_tried_but_what_had_gained_in_its_place():
    search, seen = Stepping(), []
    chosen = search._chosen
    every, rest = (SimpleNamespace(**vars(NOTHING)) for _ in range(2))
    every.beside = None  # all that is sought is tried at the first step, and never again
    every.rivals = rest.rivals = lambda now: rest
    rest.at, rest.after = {"effect1@all": 1.0}, lambda fitted: every
    search._sought = lambda names: SimpleNamespace(**vars(NOTHING) | {"after": rest.after})
    search._worth_looking = lambda first, named: ["effect0@all", "effect1@all", "effect2@all"]
    ranked = []
    search.screen = lambda now: SimpleNamespace(rank=lambda some: ranked.append(list(some)) or [])

    def twice(now, promised, named):
        seen.append(now.names)
        if len(now.names) == 2:
            return None, now, ()
        return chosen(now, promised, named)

    search._chosen = twice
    found = search.run(most=3, base=fit_of(()), done=lambda now: True)
    assert [gain.name for gain in found.taken] == ["effect0@all", "effect1@all"]
    assert [len(names) for names in seen] == [0, 1, 2]
    assert [len(names) for names in ranked] == [3, 0, 0]


class Kept:
    """What is sought, by how many steps have been told to it."""

    pairs, at = (), {}

    def __init__(self, told=0):
        self.told = told

    def beside(self, now, promised):
        return [*promised, f"sought {self.told}"]

    def asked(self, promised):
        return {*promised, f"asked {self.told}"}

    def after(self, fitted):
        return Kept(self.told + len(fitted))


def test_what_is_sought_is_tried_at_every_step_as_the_steps_before_have_it():
    search, seen = Stepping(), []
    chosen = search._chosen
    search._sought = lambda names: Kept()

    def seeing(now, promised, named):
        seen.append((promised, named))
        return chosen(now, promised, named)

    search._chosen = seeing
    search.run(most=2, base=fit_of(()))
    assert seen == [([f"sought {k}"], {f"sought {k}", f"asked {k}"}) for k in (0, 1)]


@pytest.mark.parametrize(
    ("without", "gone"),
    [
        ((), set()),
        (("payload",), {"payload@all", "link_mass@trunk"}),  # a heavier trunk is a weight on it
        (("gain_error",), {"gain_error@all", "gain_error@tibia"}),
    ],
)
def test_what_is_left_out_of_the_catalogue_has_no_other_name(without, gone):
    every = placed_effects(read_model(load_robot("marvin")))
    asked = ("payload@all", "link_mass@trunk", "link_mass@tibia", "gain_error@all")
    names = [*asked, "gain_error@tibia"]
    search, ranked = Stepping(), []
    search.model.placed = {name: every[name] for name in names}
    search._worth_looking = lambda first, named: names
    search.screen = lambda now: SimpleNamespace(rank=lambda some: ranked.append(list(some)) or [])
    search.run(most=1, base=fit_of(()), without=without)
    assert ranked == [[name for name in names if name not in gone]]


def test_what_is_one_at_two_places_is_told_as_one():
    search = Stepping()
    search._united = lambda now, taken, tried: (now, taken[:1], tried)
    assert [gain.name for gain in search.run(most=2, base=fit_of(())).taken] == ["effect0@all"]


def test_what_is_taken_stays_when_time_is_up_before_a_pair():
    search = Stepping()

    def late(*_):
        raise OutOfTimeError("trying a pair")

    search._together = late
    found = search.run(base=fit_of(()))
    assert [gain.name for gain in found.taken] == ["effect0@all"]
    assert found.fit.names == found.taken[0].fit.names


@pytest.mark.parametrize("most", [2, 3])
def test_a_pair_is_tried_at_the_first_step_and_counts_as_two(most):
    search, asked = Stepping(), []
    sought = SimpleNamespace(**vars(NOTHING))
    sought.pairs, sought.after = ("a pair",), lambda fitted: sought
    search._sought = lambda names: sought

    def together(pairs, now, tried, chosen):
        asked.append((pairs, chosen.name))
        fit = fit_of(("effect0@all", "effect1@all"))
        return [(RobotGain(name, fit, 99.0, 1.0, None),) for name in fit.names]

    search._together = together
    found = search.run(most=most, base=fit_of(()))
    assert [gain.name for gain in found.taken] == [f"effect{k}@all" for k in range(most)]
    assert [[gain.name for gain in step] for step in found.tried] == [
        *[[f"effect{k}@all"] for k in range(most)],
        ["effect0@all"],
    ]
    assert found.tried[0][0] is found.taken[0]
    assert asked == [(("a pair",), "effect0@all")]


@pytest.mark.parametrize("alone", [0, 1, 2])
def test_what_a_gain_hides_is_sought_where_nothing_more_holds_beside_what_is_taken(alone):
    """Of three effects at most; then the search goes on."""
    search, asked = Stepping(), []
    chosen = search._chosen

    def some(now, promised, named):
        if len(now.names) >= alone:
            return None, now, ("what was tried",)
        return chosen(now, promised, named)

    def hidden(now, more_v, names):
        asked.append((now.names, more_v, names))
        fit = fit_of((*now.names, "supply@all", "gain@all"))
        return [(RobotGain(name, fit, 99.0, 1.0, None),) for name in fit.names[-2:]]

    search._chosen, search._hidden = some, hidden
    search._united = lambda now, taken, tried: (now, taken, tried)
    search._worth_looking = lambda first, named: ["effect0@all"]
    search.screen = lambda now: SimpleNamespace(rank=lambda some: [])
    found = search.run(base=fit_of(()), volts=lambda now: -0.1 * (1 + len(now.names)))
    first = tuple(f"effect{k}@all" for k in range(alone))
    pair = ("supply@all", "gain@all") if alone < 2 else ()
    assert tuple(gain.name for gain in found.taken) == (*first, *pair)
    assert asked == ([(first, -0.1 * (1 + alone), ["effect0@all"])] if pair else [])
    assert [[getattr(g, "name", g) for g in step] for step in found.tried] == [
        *([name] for name in (*first, *pair)),
        *([["what was tried"]] * (2 if alone == 0 else 1)),
    ]


def test_no_hidden_pair_is_sought_where_something_holds():
    search = Stepping()
    search._hidden = None
    assert len(search.run(most=3, base=fit_of(())).taken) == 3


@pytest.mark.parametrize(("far", "alone", "pairs"), [(True, 1, 1), (False, 1, 0), (True, 2, 0)])
def test_far_from_what_was_recorded_the_next_is_tried_with_a_first_that_stays_alone(
    far, alone, pairs
):
    """Only where the second step finds nothing; then no third is looked for."""
    search, asked, fars = Stepping(), [], []
    chosen = search._chosen
    second = RobotGain("effect5@all", fit_of(("effect5@all",)), 50.0, 1.0, None)

    def once(now, promised, named):
        if len(now.names) < alone or len(now.names) > 1:
            gain, now, _ = chosen(now, promised, named)
            return gain, now, (gain, second)
        return None, replace(now, cost=-7.0), (replace(second, name="effect6@all"),)

    def together(pairs, now, tried, first):
        if not pairs:
            return []
        asked.append((pairs, now.names, tried, first.fit.cost))
        fit = fit_of(("effect0@all", "effect5@all"))
        return [(RobotGain(name, fit, 99.0, 1.0, None),) for name in fit.names]

    search._chosen, search._together = once, together
    found = search.run(most=3, base=fit_of(()), far=lambda fit: fars.append(fit.names) or far)
    if alone > 1:
        assert [gain.name for gain in found.taken] == [f"effect{k}@all" for k in range(3)]
        assert not fars
    elif pairs:
        (told,) = asked
        pair = Pair(("effect0@all", "effect5@all"), (0.0, 0.0), anyhow=True)
        assert told == ((pair,), (), found.tried[2], -7.0)  # beside the fit that step came to
        names = [gain.name for gain in found.taken]
        assert names == ["effect0@all", "effect5@all"]  # and no third
        assert [len(step) for step in found.tried] == [1, 1, 2, 1]
    else:
        assert [gain.name for gain in found.taken] == ["effect0@all"]
    assert fars == ([("effect0@all",)] if alone == 1 else [])
