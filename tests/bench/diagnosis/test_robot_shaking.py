"""Legs that shake in the air: what play does that means over the phase do not show."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from walking_robots import believed, marvin, walked, walked_by

from bench.diagnosis.robot_features import Features
from bench.diagnosis.robot_judging import Judgement
from bench.diagnosis.robot_replay import play
from bench.diagnosis.robot_shaking import shaking, told
from sim.effects import effect

PLAY_RAD = math.radians(3.0)


@cache
def modelled():
    track = play(believed(), walked())
    return tuple(track.at(j, t) for j, t in enumerate(walked().sample_s))


def shaken(recorded):
    judged = Judgement(recorded, modelled())
    return shaking(marvin(), [Features.of(recorded, marvin())], [judged])


def loose():
    robot = effect("backlash").apply(believed(), (), {"width_rad": PLAY_RAD})
    return walked_by(robot, 31)


def test_teeth_with_play_shake_legs_that_swing():
    more = shaken(loose())
    assert max(more, key=more.__getitem__) == "coxa swing"
    (sentence,) = told(more, walked().quantum_rad)
    assert sentence.startswith("coxa joints shake while their legs swing")


def test_a_robot_as_believed_shakes_no_more():
    assert told(shaken(walked_by(believed(), 32)), walked().quantum_rad) == ()


def test_noise_of_all_sensors_is_no_shaking():
    """Of a count, and in all joints alike."""
    random = np.random.default_rng(5)
    noisy = tuple(
        x + walked().quantum_rad * random.standard_normal(len(x)) for x in walked().position_rad
    )
    assert told(shaken(replace(walked(), position_rad=noisy)), walked().quantum_rad) == ()


@pytest.mark.parametrize(
    ("stance", "swing", "said"), [(0.0, 0.6, True), (0.0, 0.4, False), (0.7, 0.6, False)]
)
def test_what_shakes_more_on_the_ground_is_no_play(stance, swing, said):
    more = {"coxa stance": stance, "coxa swing": swing, "femur stance": 0.0, "femur swing": 0.0}
    assert bool(told(more, 1.0)) is said
