"""What the benchmark of rollouts compares is the same rollout."""

from __future__ import annotations

import numpy as np
import pytest

from bench.rollout_speed import RIG, batched, in_bullet, plain_s
from busemu.tables import load_robot
from sim.model import read_model

WITHIN_RAD = 0.005  # a count of the sensor: the two engines' laws see another count now and then


@pytest.fixture(scope="module")
def robot():
    return load_robot(RIG)


def test_a_batch_and_pybullet_roll_out_the_same_pendulum(robot):
    batch, _ = batched(robot, 4, rigid=False)
    engine, _ = in_bullet(robot)
    assert read_model(robot).joints[0].drive.sensor_step_rad == pytest.approx(WITHIN_RAD, rel=0.1)
    assert np.ptp(engine) > 1.0
    assert np.abs(batch - engine).max() < WITHIN_RAD


def test_the_plain_loop_says_how_long_it_took():
    assert plain_s() > 0.0
