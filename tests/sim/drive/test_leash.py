"""Loads that are led along a path by a spring and a damper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from one_joint_rigs import candidate, level, pendulum, plain_drive, position, replay, swinging

from sim.drive import lanes
from sim.drive.parameters import Friction
from sim.rollout import Batch, Candidate, Replay
from sim.stepped import TICK_S

LEASH_RAD_S = 8.0
SOFT = plain_drive(gear_stiffness_nm_rad=50.0, gear_damping_nm_s_rad=0.02)


def led(one: Candidate, to: Replay, leash_rad_s: float = LEASH_RAD_S) -> np.ndarray:
    return Batch([to], 1).run([one], [0], leash_rad_s)[0]


def path_of(out: np.ndarray) -> np.ndarray:
    """The path of a rollout that was sampled at every tick."""
    return out[:, [lanes.OUT_POSITION, lanes.OUT_VELOCITY]]


def test_a_free_load_comes_to_its_path_as_a_spring_and_a_critical_damper_bring_it() -> None:
    aside = 0.3
    to = replay(position_rad=aside, duration_s=1.0)
    to = replace(to, path=np.zeros((len(to.samples), 2)))
    angle = position(led(candidate(load=level()), to))
    reach = LEASH_RAD_S * to.samples
    assert angle == pytest.approx(aside * (1.0 + reach) * np.exp(-reach), abs=0.01 * aside)


@pytest.mark.parametrize("drive", [plain_drive(), SOFT])
def test_the_way_that_a_servo_goes_by_itself_pulls_at_nothing(drive: object) -> None:
    one = candidate(replace(drive, friction=Friction(coulomb_nm=0.02)))  # type: ignore[type-var]
    to = swinging(1.0)
    free = led(one, to, 0.0)
    again = led(one, replace(to, path=path_of(free)))
    assert again == pytest.approx(free, abs=1e-9)


def test_without_a_leash_a_path_changes_nothing() -> None:
    one, to = candidate(), swinging(1.0)
    there = replace(to, path=np.ones((10, 2)))
    assert (led(one, there, 0.0) == led(one, to, 0.0)).all()
    assert (led(one, to) == led(one, to, 0.0)).all()  # nor does a leash without a path


def test_a_path_is_of_the_instants_at_which_samples_are_taken() -> None:
    """A sample that is shown late lies on the path that was shown late."""
    late = 20 * TICK_S
    one, to = candidate(load=pendulum(0.2)), swinging(1.0)
    free = led(one, to, 0.0)
    shown = led(replace(one, skew_s=-late), to, 0.0)
    there = led(replace(one, skew_s=-late), replace(to, path=path_of(shown)))
    assert position(there)[100:] == pytest.approx(position(shown)[100:], abs=2e-3)
    assert np.abs(position(shown) - position(free)).max() > 0.02
