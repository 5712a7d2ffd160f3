"""Inverse kinematics against forward kinematics built here from Denavit-Hartenberg matrices."""

import numpy as np
import pytest
from dh_oracle import feet_by_matrices

from busemu.tables import RobotError, load_robot
from hal.legs import Legs, UnreachableError, quantity

ROBOTS = ("phantomx", "marvin")


@pytest.mark.parametrize("name", ROBOTS)
def test_forward_kinematics_is_that_of_the_matrices(name):
    robot = load_robot(name)
    legs = Legs.of(robot)
    rng = np.random.default_rng(1)
    for _ in range(50):
        angles = rng.uniform(-1.5, 1.5, (6, 3))
        assert legs.feet_m(angles) == pytest.approx(feet_by_matrices(robot, angles), abs=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_angles_put_the_foot_where_it_was_asked(name):
    robot = load_robot(name)
    legs = Legs.of(robot)
    rng = np.random.default_rng(2)
    low, high = (-1.2, -0.1, -2.2), (1.2, 1.0, -0.7)
    for _ in range(200):
        angles = rng.uniform(low, high, (6, 3))
        feet = feet_by_matrices(robot, angles)
        found = legs.angles_rad(feet)
        assert found == pytest.approx(angles, abs=1e-4)
        assert feet_by_matrices(robot, found) == pytest.approx(feet, abs=1e-6)


def test_an_unreachable_foot_raises_with_the_leg_and_the_distances():
    legs = Legs.of(load_robot("phantomx"))
    feet = legs.feet_m(legs.stretched(0.0, 0.4, -1.8))
    feet[3, 2] -= 0.2
    with pytest.raises(
        UnreachableError, match=r"leg4: foot at .* the leg reaches 0\.072 to 0\.204"
    ):
        legs.angles_rad(feet)
    feet[3] = [*legs.hips_m[3] + legs.coxa_m * np.array([0.70711, -0.70711]), 0.05]
    with pytest.raises(UnreachableError, match="leg4"):  # too near
        legs.angles_rad(feet)


def test_a_missing_number_of_the_robot_file_is_named():
    with pytest.raises(RobotError, match=r"link\.coxa\.length_m"):
        quantity({"link": {"coxa": {}}}, "link", "coxa", "length_m")
    with pytest.raises(RobotError, match="must be a number"):
        quantity({"a": {"value": "long"}}, "a")
