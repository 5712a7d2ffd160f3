"""Two effects that show only together, tried as one."""

from collections import defaultdict
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import APART_NATS, RobotGain
from bench.diagnosis.robot.nuisances import RobotNuisance
from bench.diagnosis.robot.search import RobotSearch, with_next
from bench.diagnosis.robot.sought import GAIN, SAG, SUPPLY, Pair, opposed
from bench.diagnosis.robot.steps import BESIDE, WORSE

SPRING, TIPS = "joint_compliance@femur+tibia", "foot_compliance@all"
PAIR = Pair((SPRING, TIPS), (8.0, 3.0))


def fit_of(names):
    names = tuple(names)
    return RobotFit(names, np.zeros(len(names)), {}, 0.0)


class Pairing(RobotSearch):
    """A search in which fits gain what is told of their names; of a pair that begins, ``at_once``.

    ``settled`` is what is gained without one of a pair, ``outside`` on groups that are left out.
    """

    def __init__(self, gained, *, at_once=None, settled=0.0, outside=99.0, square=1.0):
        self.gained, self.at_once, self.settled = gained, at_once, settled
        self.outside, self.square = outside, square
        anything = SimpleNamespace(parameter=SimpleNamespace(unit=""))
        placed = dict.fromkeys(PAIR.names, anything)
        self.model = SimpleNamespace(following=nullcontext, placed=placed)
        self.sight = SimpleNamespace(
            without=lambda fit, name: fit_of(n for n in fit.names if n != name),
            inflation=lambda fit, name: 2.0,
        )
        self._say = lambda stage: None
        self.last = None

    def begun(self, names, knobs, noise=None, nuisances=None, most=np.inf):
        self.most, self.nuisances = most, nuisances
        gained = self.gained if self.at_once is None else self.at_once
        return RobotFit(names, np.asarray(knobs), noise, -gained)

    def refined(self, settled):
        return replace(settled, cost=-self.gained)

    def replayed(self, found):
        return found

    def settle(self, found, begun=None):
        return replace(found, cost=-self.settled)

    def around(self, found):
        self.last = found

    def _left_out(self, found):
        return -self.outside if set(PAIR.names) <= set(found.names) else 0.0

    def _whole_square(self, found):
        return self.square if found.names else 1.0


ENOUGH_OF_BOTH = 2.2 * BESIDE  # divided by an inflation of 2


def single(name, nats):
    return RobotGain(name, replace(fit_of((name,)), cost=-nats), nats, 2.0, None)


def test_two_that_show_only_together_are_taken_together():
    search, now = Pairing(400.0, settled=10.0), fit_of(())
    tried = [single("backlash@tibia", 70.0), single(SPRING, 20.0)]
    (spring,), (tips,) = search._together([PAIR], now, tried, tried[0])
    assert (spring.name, tips.name) == PAIR.names
    assert spring.fit is tips.fit is search.last
    assert spring.fit.names == PAIR.names
    np.testing.assert_array_equal(spring.fit.z, PAIR.knobs)
    assert (spring.nats, tips.nats) == (390.0, 380.0)
    assert spring.held_out == tips.held_out == 99.0
    assert spring.inflation == 2.0
    assert search.most == -70.0  # what will not even do as well as the best alone is left there


def test_a_pair_begins_beside_what_is_taken():
    (gain,), _ = Pairing(400.0)._together([PAIR], fit_of(("other@all",)), [], None)
    assert gain.fit.names == ("other@all", *PAIR.names)


@pytest.mark.parametrize(
    ("search", "tried"),
    [
        (Pairing(70.0 + 0.9 * BESIDE), [single("backlash@tibia", 70.0)]),
        (Pairing(70.0 + 0.9 * ENOUGH_OF_BOTH), [single("backlash@tibia", 70.0)]),
        (Pairing(400.0, at_once=70.0 + 0.9 * BESIDE), [single("backlash@tibia", 70.0)]),
        (Pairing(400.0), [single(SPRING, 400.0 - 0.9 * ENOUGH_OF_BOTH)]),
        (Pairing(400.0, settled=400.0 - 0.9 * ENOUGH_OF_BOTH), []),
        (Pairing(400.0, outside=-1.1 * APART_NATS), []),
        (Pairing(400.0, square=1.1 * WORSE), []),
    ],
)
def test_two_of_which_one_would_do_or_which_do_not_hold_are_no_pair(search, tried):
    now = fit_of(())
    best = next((gain for gain in tried if gain.name not in PAIR.names), None)
    assert search._together([PAIR], now, tried, best) == []
    assert search.last is (now if best is None else best.fit)


def test_the_same_with_a_little_more_is_a_pair():
    for search, tried in (
        (Pairing(70.0 + ENOUGH_OF_BOTH), [single("backlash@tibia", 70.0)]),
        (Pairing(400.0), [single(SPRING, 400.0 - ENOUGH_OF_BOTH)]),
        (Pairing(400.0, settled=400.0 - ENOUGH_OF_BOTH), []),
        (Pairing(400.0, outside=-0.9 * APART_NATS), []),
        (Pairing(400.0, square=0.9 * WORSE), []),
    ):
        best = next((gain for gain in tried if gain.name not in PAIR.names), None)
        assert len(search._together([PAIR], fit_of(()), tried, best)) == 2


def test_nothing_is_replayed_where_no_pair_is_sought():
    search = Pairing(400.0)
    assert search._together([], fit_of(()), [], None) == []
    assert search.last is None


class Several(Pairing):
    """Pairs that gain what is told of their first names."""

    def __init__(self, gained):
        super().__init__(0.0)
        self.every = gained
        self.model.placed = defaultdict(lambda: next(iter(self.model.placed.values())))
        self.model.placed["any"] = SimpleNamespace(parameter=SimpleNamespace(unit=""))

    def begun(self, names, knobs, *_, **more):
        self.gained = self.every[names[0]]
        return super().begun(names, knobs, **more)

    def _left_out(self, found):
        return 0.0


@pytest.mark.parametrize(
    ("gained", "taken", "beside"),
    [
        ((400.0, 300.0, 200.0), "a", ["b"]),
        ((300.0, 400.0, 200.0), "b", ["a"]),
        ((300.0, 200.0, 400.0), "c", []),  # which stands beside another second one
        ((400.0, 3.0, 200.0), "a", []),  # b does not hold
    ],
)
def test_of_several_pairs_that_is_taken_which_gains_most_beside_others_of_its_second(
    gained, taken, beside
):
    search = Several(dict(zip("abc", gained, strict=True)))
    pairs = [Pair((first, last), (1.0, 1.0)) for first, last in ("ax", "bx", "cy")]
    (first, *others), (second,) = search._together(pairs, fit_of(()), [], None)
    assert (first.name, second.name) == (taken, dict(pair.names for pair in pairs)[taken])
    assert [other.name for other in others] == beside
    assert search.last is first.fit is second.fit


# --- a supply that a gain hides

SUPPLY_V = 10.0


def hiding():
    """A sight of a robot whose knobs are their values, with what is never exactly as believed."""
    bounds = SimpleNamespace(low=0.5, high=1.5)
    one = SimpleNamespace(knob=SimpleNamespace(at=float), parameter=bounds)
    placed = dict.fromkeys((GAIN, SUPPLY, SAG), one)
    supply = SimpleNamespace(supply=SimpleNamespace(voltage_v=SUPPLY_V))
    every = [
        RobotNuisance("friction", "", 0.3, ""),
        RobotNuisance("supply", "", 0.02, "", same=(SUPPLY,)),
        RobotNuisance("mass trunk", "", 0.03, "", same=("link_mass@trunk", "payload@all")),
        RobotNuisance("gain", "", 0.03, "", same=(GAIN,)),
    ]
    curves = SimpleNamespace(first_z=lambda name: {SAG: 0.25}[name])
    return SimpleNamespace(
        model=SimpleNamespace(placed=placed, base=supply, nuisances=every, curves=curves)
    )


BARE = RobotFit((), np.array([1.0, -2.0, 1.0, 2.0]), {}, 0.0)


def test_a_supply_begins_as_servos_show_it_and_a_gain_as_it_hides_that():
    """The supply's tolerance has 4 % less already, the gain's 6 % more."""
    first, second = opposed(hiding(), BARE, -0.6, (GAIN, SUPPLY, SAG))
    assert (first.names, second.names) == ((SUPPLY, GAIN), (SAG, GAIN))
    assert first.knobs == pytest.approx((0.90, 1.06 * 0.96 / 0.90))
    assert second.knobs == pytest.approx((0.25, 1.06 * 0.96 / 0.90))
    assert first.anyhow
    (more,) = opposed(hiding(), BARE, 0.6, (GAIN, SUPPLY, SAG))  # no source gives more
    assert more.names == (SUPPLY, GAIN)
    assert more.knobs == pytest.approx((1.02, 1.06 * 0.96 / 1.02))


@pytest.mark.parametrize(("volts", "knobs"), [(-99.0, (0.5, 1.5)), (99.0, (1.5, 1.06 * 0.64))])
def test_registers_that_show_nonsense_begin_at_the_bounds(volts, knobs):
    first, *_ = opposed(hiding(), BARE, volts, (GAIN, SUPPLY))
    assert first.knobs == pytest.approx(knobs)


@pytest.mark.parametrize(
    ("volts", "names", "expected"),
    [
        (0.0, (GAIN, SUPPLY, SAG), []),
        (-0.6, (SUPPLY, SAG), []),
        (-0.6, (GAIN,), []),
        (-0.6, (GAIN, SAG), [SAG]),
        (-0.6, (GAIN, SUPPLY), [SUPPLY]),
    ],
)
def test_nothing_is_sought_that_servos_do_not_show_or_that_is_not_looked_for(
    volts, names, expected
):
    assert [pair.names[0] for pair in opposed(hiding(), BARE, volts, names)] == expected


@pytest.mark.parametrize("own", [GAIN, SUPPLY, SAG])
def test_beside_one_of_them_no_pair_is_sought(own):
    """With the other one free, what is missing shows by itself."""
    fit = replace(BARE, names=(own,), z=np.append(BARE.z, 1.0))
    assert opposed(hiding(), fit, -0.6, (GAIN, SUPPLY, SAG)) == ()
    other = replace(fit, names=("ground_tilt.pitch@all",))
    assert len(opposed(hiding(), other, -0.6, (GAIN, SUPPLY, SAG))) == 2


def test_what_a_gain_hides_is_fitted_beside_what_is_taken():
    search, asked = Pairing(400.0), []
    search.sight = hiding()
    search._together = lambda *given: asked.append(given) or ["a pair"]
    assert search._hidden(BARE, -0.6, (GAIN, SUPPLY)) == ["a pair"]
    assert asked == [(opposed(hiding(), BARE, -0.6, (GAIN, SUPPLY)), BARE, (), None)]


# --- the first that was taken, and what gained most in its place


def at(name, nats, knob):
    return RobotGain(name, RobotFit((name,), np.array([5.0, knob]), {}, -nats), nats, 2.0, None)


FIRST = at("torque_limit@femur", 900.0, 1.5)


def test_what_gained_most_in_place_of_the_first_is_tried_with_it_each_as_it_was_alone():
    enough = 2.0 * BESIDE  # divided by an inflation of 2
    tried = [at("payload@all", enough, 2.0), FIRST, at("link_mass@tibia", enough + 1.0, 9.0)]
    names = (FIRST.name, "link_mass@tibia")
    assert with_next(FIRST, tried) == (Pair(names, (1.5, 9.0), anyhow=True),)


@pytest.mark.parametrize(
    "others",
    [[], [at("payload@all", 1.9 * BESIDE, 2.0)], [at("torque_limit@all", 800.0, 1.0)]],
)
def test_what_gained_little_or_is_the_same_effect_is_not_tried_with_the_first(others):
    assert with_next(FIRST, [FIRST, *others]) == ()


def test_a_pair_that_begins_far_behind_is_fitted_to_the_end_where_that_is_asked():
    search, now = Pairing(400.0, at_once=-900.0), fit_of(())
    first = single(SPRING, 70.0)
    first = replace(first, fit=replace(first.fit, z=np.array([3.0, 0.0])))
    assert search._together([PAIR], now, [first], first) == []
    found = search._together([replace(PAIR, anyhow=True)], now, [first], first)
    assert [gain.name for (gain,) in found] == list(PAIR.names)
    assert [gain.nats for (gain,) in found] == [400.0, 330.0]  # over the other one alone
    assert (search.most, search.nuisances.tolist()) == (np.inf, [3.0])
    worse = Pairing(60.0, at_once=-900.0)
    assert worse._together([replace(PAIR, anyhow=True)], now, [first], first) == []
    assert worse.last is first.fit
