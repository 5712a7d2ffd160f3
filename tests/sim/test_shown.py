"""The angle a servo shows is its sensor's, of the instant that the robot file says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from busemu.tables.robots import parse_robot
from sim.world import BulletPlant

Make = Callable[..., BulletPlant]
SERVO, GOAL_RAD = 1, 0.6


def having(name: str, **parameters: float) -> Robot:
    """The pendulum with one effect."""
    robot = load_robot("pendulum")
    told = {key: {"value": value, "source": "assumed"} for key, value in parameters.items()}
    document: Mapping[str, Any] = {
        **robot.document,
        "effect": [{"name": name, "parameters": told}],
    }
    return parse_robot(document, robot.path)


def swinging(plant: BulletPlant) -> BulletPlant:
    gains = {"gain_cw_per_rad": 4.0, "gain_ccw_per_rad": 4.0}
    plant.command(SERVO, DriveCommand(True, goal_position_rad=GOAL_RAD, **gains))
    return plant


def shown(plant: BulletPlant, t_s: Sequence[float] | np.ndarray) -> np.ndarray:
    """What the servo shows at some instants of a swing [rad]."""
    swinging(plant)
    found = []
    for now_s in t_s:
        plant.advance(float(now_s))
        found.append(plant.sample(SERVO).position_rad)
    return np.array(found)


def settled(plant: BulletPlant) -> tuple[float, float]:
    """What is shown in the end, and the shaft's own angle, in the servo's frame [rad]."""
    (at,) = shown(plant, [4.0])
    (mount,) = load_robot("pendulum").servos
    return float(at), mount.to_servo(plant.observe()[f"rig/{mount.joint}_rad"])


def test_a_zero_offset_is_shown_though_the_controller_takes_it_out(make: Make) -> None:
    plain, _ = settled(make(load_robot("pendulum")))
    at, shaft = settled(make(having("zero_offset", offset_rad=0.1)))
    assert at - shaft == pytest.approx(0.1, abs=1e-4)
    assert at == pytest.approx(plain, abs=0.02)  # the load is another at another angle


def test_a_wave_of_the_encoder_is_shown(make: Make) -> None:
    wave = {"amplitude_rad": 0.05, "periods": 3.0, "phase_rad": 0.4}
    at, shaft = settled(make(having("encoder_nonlinearity", **wave)))
    assert at - shaft == pytest.approx(0.05 * math.sin(3.0 * shaft + 0.4), abs=1e-4)


@pytest.mark.parametrize("skew_s", [-0.0042, -0.0305])
def test_a_skew_shows_an_older_angle_of_the_same_motion(make: Make, skew_s: float) -> None:
    t_s = np.arange(0.05, 0.6, 0.00137)
    plain = shown(make(load_robot("pendulum")), t_s + skew_s)
    late = shown(make(having("read_skew", skew_s=skew_s)), t_s)
    assert late == pytest.approx(plain, abs=1e-12)
    assert np.ptp(plain) > 0.1


def test_before_the_beginning_there_is_only_the_beginning(make: Make) -> None:
    first, later = shown(make(having("read_skew", skew_s=-0.2)), [0.1, 0.6])
    start = make(load_robot("pendulum")).sample(SERVO).position_rad
    assert first == start
    assert later != start


def test_an_angle_that_is_not_there_yet_is_the_present_one_gone_on_with(make: Make) -> None:
    t_s = np.arange(0.05, 0.6, 0.00137)
    plain = make(load_robot("pendulum"))
    now, soon = shown(plain, t_s), shown(make(load_robot("pendulum")), t_s + 0.002)
    early = shown(make(having("read_skew", skew_s=0.002)), t_s)
    assert np.abs(early - soon).max() < 0.2 * np.abs(now - soon).max()
