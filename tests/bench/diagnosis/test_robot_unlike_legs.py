"""Legs of unlike masses: the weight is aside, as if the trunk's centre were."""

import math

import numpy as np
import pytest

from bench.diagnosis.robot.nuisances import CENTRES, legs_aside_m, nuisances
from busemu.tables import load_robot
from sim.model import read_model

MASSES = 0.05
DRAWN = 4000
CENTRE_M = 0.003 / math.sqrt(3.0)
STRAIGHT = dict.fromkeys(("coxa", "femur", "tibia"), 0.0)


def outward_m(leg, segment, centre_m):
    """How far from its root a link of a leg that is stretched out has its centre."""
    whole, _, _ = leg.foot_m(STRAIGHT)
    beyond = list(STRAIGHT)[list(STRAIGHT).index(segment) :]
    return whole - sum(leg.lengths_m[s] for s in beyond) + centre_m


def drawn_aside_m(robot, random):
    """Deviations of where the weight of robots is, their links up to 5 % off, by x and y."""
    mass = {body.name: body.mass for body in robot.bodies}
    moments = []
    for leg in robot.legs:
        for segment in STRAIGHT:
            link = mass[f"{leg.name}.{segment}"]
            out = outward_m(leg, segment, link.centre_m[0])
            x = leg.x_m + out * math.cos(leg.yaw_rad)
            y = leg.y_m + out * math.sin(leg.yaw_rad)
            moments.append((link.mass_kg * x, link.mass_kg * y))
    off = random.uniform(-MASSES, MASSES, (DRAWN, len(moments)))
    return (off @ np.array(moments) / robot.trunk.mass.mass_kg).std(axis=0)


@pytest.mark.parametrize("name", ["marvin", "phantomx"])
def test_legs_of_unlike_masses_are_a_centre_aside(name):
    robot = read_model(load_robot(name))
    drawn = drawn_aside_m(robot, np.random.default_rng(1))
    told = legs_aside_m(robot)
    assert tuple(told) == CENTRES
    assert list(told.values()) == pytest.approx(drawn.tolist(), rel=0.05)
    by_name = {n.name: n for n in nuisances(robot, 0.005)}
    for own, aside in zip(CENTRES, drawn.tolist(), strict=True):
        assert by_name[own].deviation == pytest.approx(math.hypot(CENTRE_M, aside), rel=0.02)
    assert by_name["centre z"].deviation == CENTRE_M


def test_an_arm_has_no_legs_that_are_unlike():
    assert legs_aside_m(read_model(load_robot("marvin-leg"))) == {}
