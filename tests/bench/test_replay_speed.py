"""What the benchmark of replays compares is the same robot that does the same."""

from __future__ import annotations

import numpy as np
import pytest

from bench.replay_speed import RISEN_S, compiled, in_bullet
from busemu.tables import load_robot
from sim.stepped import TICK_S


@pytest.mark.parametrize("name", ["marvin", "phantomx"])
def test_compiled_bodies_and_pybullet_step_alike(name):
    robot = load_robot(name)
    ours, engine = compiled(robot)[0], in_bullet(robot)[0]
    assert ours.shape == engine.shape
    risen = round((RISEN_S + 0.5) / TICK_S)
    femurs = [j.endswith(".femur") for j in (servo.joint for servo in robot.servos)]
    assert np.ptp(engine[risen:, femurs], axis=0).min() > 0.15
    apart = np.sqrt(np.mean((ours - engine)[risen:] ** 2))
    assert apart < 0.005  # a count of the sensor; feet come to stand elsewhere as it rises
