"""What-ifs of one joint: batched compiled rollouts against the same, one by one, in other ways.

The pendulum of the robot files follows a goal that swings; every candidate has another supply
voltage. What is compared is the same rollout by the same law of the drive (an engine moves the
weight only in PyBullet), as ``tests/bench/test_rollout_speed.py`` holds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np

from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from sim.drive import fields, lanes, lockstep
from sim.drive.bank import command_column
from sim.drive.fields import Array
from sim.model import read_model
from sim.one_joint import one_joint_load
from sim.rollout import Batch, Candidate, Load, Replay
from sim.world import BulletPlant

RIG = "pendulum"
SECONDS, GOAL_EVERY_S, SAMPLE_EVERY_S = 2.0, 0.01, 0.01
GAIN_PER_RAD = 5.0
PLAIN = "--plain"  #: asks this module for the time of one rollout that is not compiled


def command(goal_rad: float) -> DriveCommand:
    """A position law with a goal."""
    return DriveCommand(
        torque_enable=True,
        goal_position_rad=goal_rad,
        gain_cw_per_rad=GAIN_PER_RAD,
        gain_ccw_per_rad=GAIN_PER_RAD,
    )


def goals() -> list[tuple[float, float]]:
    """Instants [s] and goals [rad], servo frame."""
    t = np.arange(0.0, SECONDS, GOAL_EVERY_S)
    return list(zip(t.tolist(), (0.8 * np.sin(5.0 * t) * np.sin(1.3 * t)).tolist(), strict=True))


def replay() -> Replay:
    """The goals as they came at the port, and the instants of samples."""
    written = [(t, fields.GOAL_POSITION, goal) for t, goal in goals()]
    samples = np.arange(1.0, round(SECONDS / SAMPLE_EVERY_S) + 1) * np.float64(SAMPLE_EVERY_S)
    return Replay(command_column(command(0.0)), np.array(written, np.float64), samples, 0.0)


def candidates(robot: Robot, count: int, *, rigid: bool) -> list[Candidate]:
    """Servos alike but for the voltage of their supplies, which falls by a tenth at most."""
    physical = read_model(robot)
    hangs = one_joint_load(physical)
    centre = robot.by_joint[physical.joints[0].name].to_servo(hangs.centre_rad)
    load = Load.pendulum(hangs.inertia_kg_m2, hangs.gravity_nm, centre, hangs.moment_nm)
    one = Candidate.of(physical, 0, load, rigid=rigid)
    return [replace(one, voltage_v=one.voltage_v * (1.0 - 0.1 * k / count)) for k in range(count)]


def in_bullet(robot: Robot) -> tuple[Array, float]:
    """Positions [rad] of the first candidate in PyBullet, and the time [s] its rollout took.

    The world is there already; only the rollout counts.
    """
    plant = BulletPlant(robot)
    servo = plant.robot.joints[0].servo_id
    waiting = goals()
    seen = []
    begun_s = time.perf_counter()
    plant.command(servo, command(0.0))
    for k in range(1, round(SECONDS / SAMPLE_EVERY_S) + 1):
        while waiting and waiting[0][0] < k * SAMPLE_EVERY_S - 1e-9:
            t_s, goal = waiting.pop(0)
            plant.advance(t_s)
            plant.command(servo, command(goal))
        plant.advance(k * SAMPLE_EVERY_S)
        seen.append(plant.sample(servo).position_rad)
    took_s = time.perf_counter() - begun_s
    plant.close()
    return np.array(seen), took_s


def batched(robot: Robot, count: int, *, rigid: bool) -> tuple[Array, float]:
    """Positions [rad] of the first candidate, and the time [s] that one of ``count`` takes."""
    batch, some = Batch([replay()]), candidates(robot, count, rigid=rigid)
    batch.run(some[:2], [0, 0])  # compiled, or loaded
    begun_s = time.perf_counter()
    out = batch.run(some, [0] * count)
    took_s = (time.perf_counter() - begun_s) / count
    return out[0][:, lanes.OUT_POSITION], took_s


def plain(robot: Robot) -> tuple[Array, float]:
    """The same for one candidate alone, on one thread, and nothing compiled.

    Numba must have been told before it was imported: ``NUMBA_DISABLE_JIT=1``.
    """
    (one,) = candidates(robot, 1, rigid=False)
    lockstep.LANES = 1  # lanes without a job cost nothing only where vectors are made of them
    batch = Batch([replay()], 1)
    begun_s = time.perf_counter()
    out = batch.run([one], [0])
    return out[0][:, lanes.OUT_POSITION], time.perf_counter() - begun_s


def plain_s() -> float:
    """The time [s] of :func:`plain`, in a process where nothing is compiled."""
    told = subprocess.run(
        [sys.executable, "-m", "bench.rollout_speed", PLAIN],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        check=True,
        capture_output=True,
        text=True,
    )
    return float(told.stdout)


def measured(count: int = 4000, times: int = 5) -> list[tuple[str, float, float, str]]:
    """What, the time of a rollout [s], that of its floor [s], and the floor's name."""
    robot = load_robot(RIG)
    bullet_s = min(in_bullet(robot)[1] for _ in range(times))
    gear_s = min(batched(robot, count, rigid=False)[1] for _ in range(times))
    rigid_s = min(batched(robot, count, rigid=True)[1] for _ in range(times))
    return [
        ("2 s of a joint with a gear, batched", gear_s, bullet_s, "the same alone in PyBullet"),
        ("2 s of a joint, rigid, batched", rigid_s, bullet_s, "with a gear alone in PyBullet"),
        ("2 s of a joint with a gear, batched", gear_s, plain_s(), "a plain NumPy loop"),
    ]


if __name__ == "__main__" and sys.argv[1:] == [PLAIN]:
    print(plain(load_robot(RIG))[1])
