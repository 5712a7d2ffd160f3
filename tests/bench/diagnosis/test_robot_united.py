"""One effect that was found at two places, as one at both."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import NEEDED, RobotGain
from bench.diagnosis.robot.search import RobotSearch
from busemu.tables import load_robot
from sim.model import read_model

BASE = read_model(load_robot("marvin"))
FEMUR, TIBIA, COXA = (f"joint_compliance@{s}" for s in ("femur", "tibia", "coxa"))
BOTH, ALL, OTHER = "joint_compliance@femur+tibia", "joint_compliance@all", "payload@all"
NUISANCES = np.array([0.5, -1.0])
WIDE = 2.0


class Uniting(RobotSearch):
    """A search in which a fit that is asked for costs so much more than what was there."""

    def __init__(self, more=0.0):
        self.model = SimpleNamespace(base=BASE, placed=placed_effects(BASE))
        self.sight = SimpleNamespace(inflation=lambda fit, name: WIDE)
        self.more, self.asked, self.last = more, [], None
        self._say = lambda stage: None

    def thoroughly(self, names, knobs, noise=None, nuisances=None):
        self.asked.append((dict(zip(names, knobs, strict=True)), nuisances.tolist()))
        return RobotFit(tuple(names), np.append(nuisances, knobs), noise, -100.0 + self.more)

    def around(self, found):
        self.last = found


def taken_at(*names):
    knobs = np.arange(1.0, 1.0 + len(names))
    now = RobotFit(names, np.append(NUISANCES, knobs), {}, -100.0)
    taken = [RobotGain(n, now, 40.0 + k, 1.0, 20.0 + k) for k, n in enumerate(names)]
    return now, taken, [(gain, f"tried beside {gain.name}") for gain in taken]


def united(search, *names):
    now, taken, tried = taken_at(*names)
    return now, taken, tried, *search._united(now, taken, tried)


@pytest.mark.parametrize("more", [-5.0, 0.9 * NEEDED * WIDE])
def test_a_spring_in_femurs_and_one_in_tibiae_are_one_in_both(more):
    search = Uniting(more)
    _, before, steps, now, taken, tried = united(search, FEMUR, TIBIA, OTHER)
    assert search.asked == [({OTHER: 3.0, BOTH: 1.5}, NUISANCES.tolist())]
    assert [gain.name for gain in taken] == [BOTH, OTHER]
    (both, other) = taken
    assert other is before[2]
    assert (both.nats, both.held_out, both.inflation) == (40.0 + 41.0 - more, 41.0, WIDE)
    assert now is both.fit is search.last
    assert tried == [(both, *steps[0]), steps[2], steps[1]]


def test_they_stay_two_where_one_does_worse():
    search = Uniting(1.1 * NEEDED * WIDE)
    begun, before, steps, now, taken, tried = united(search, FEMUR, TIBIA)
    assert (now, taken, tried) == (begun, before, steps)
    assert search.last is begun


def test_what_is_at_nested_places_is_one_at_the_wider():
    search = Uniting()
    *_, taken, _ = united(search, FEMUR, ALL)
    assert [gain.name for gain in taken] == [ALL]


@pytest.mark.parametrize("names", [(FEMUR, COXA), (FEMUR, "gain_error@tibia"), (FEMUR, OTHER)])
def test_what_is_not_one_at_any_place_is_not_asked_for(names):
    search = Uniting()
    begun, before, steps, now, taken, tried = united(search, *names)
    assert (now, taken, tried) == (begun, before, steps)
    assert search.asked == []


def test_what_no_group_was_left_out_of_has_no_gain_there():
    search = Uniting()
    now, taken, tried = taken_at(FEMUR, TIBIA)
    taken[1] = RobotGain(TIBIA, now, 41.0, 1.0, None)
    _, (both,), _ = search._united(now, taken, tried)
    assert both.held_out is None
