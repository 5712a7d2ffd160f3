"""What a replay of a whole robot costs: compiled bodies, against the same in PyBullet.

A hexapod rises and lifts every other leg. The drives, their goals and the instants of these are the
same in both, as ``tests/bench/test_replay_speed.py`` holds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from sim.drive.bank import command_column
from sim.drive.fields import Array
from sim.floating.rollout import Start, rollout
from sim.model import read_model
from sim.stepped import TICK_S
from sim.tree import PhysicalRobot
from sim.world import BulletPlant

from .rollout_speed import command

SECONDS, RISEN_S = 4.0, 2.0
GOAL_TICKS = 20  #: between two goals
LIFT_RAD, PERIOD_S = 0.25, 1.0
LIMIT_RAD_S = 3.0
EVERY = 10


def goals(robot: Robot, physical: PhysicalRobot) -> Iterator[tuple[int, int, int, DriveCommand]]:
    """Ticks after which drives are told, numbers of the joints, servo IDs, and what they are told.

    It rises, then every other leg is up while those between stand.
    """
    mounts = {servo.joint: servo for servo in robot.servos}
    legs = [leg.name for leg in physical.legs]
    for tick in range(0, round(SECONDS / TICK_S), GOAL_TICKS):
        angle = 2.0 * math.pi * max(0.0, tick * TICK_S - RISEN_S) / PERIOD_S
        for number, joint in enumerate(physical.joints):
            turn = angle + math.pi * (legs.index(joint.leg) % 2)
            goal = physical.neutral_rad[joint.segment]
            if joint.segment == "femur" and angle > 0.0:
                goal += LIFT_RAD * max(0.0, math.sin(turn))
            told = command(mounts[joint.name].to_servo(goal))
            limited = replace(told, velocity_limit_rad_s=LIMIT_RAD_S)
            yield tick, number, joint.servo_id, limited


def compiled(robot: Robot) -> tuple[Array, float]:
    """Joints' angles at every tick [rad] (ticks, joints), and the time [s] it took."""
    physical = read_model(robot)
    events = np.array(
        [
            [tick + 1, number, field, value]
            for tick, number, _, told in goals(robot, physical)
            for field, value in enumerate(command_column(told).tolist())
        ]
    )
    rest = physical.posture(physical.rest_rad)
    start = Start(rest, (0.0, 0.0, physical.height_m(physical.rest_rad)))
    still = np.repeat(command_column(DriveCommand())[:, None], len(physical.joints), axis=1)
    rollout(physical, start, still, events, EVERY, EVERY)  # compiled, or loaded
    begun_s = time.perf_counter()
    seen = rollout(physical, start, still, events, round(SECONDS / TICK_S), EVERY)
    return seen.angle_rad, time.perf_counter() - begun_s


def in_bullet(robot: Robot) -> tuple[Array, float]:
    """The same in PyBullet. The world is there already; only the steps count."""
    plant = BulletPlant(robot)
    waiting = list(goals(robot, plant.robot))
    mounts = [(robot.by_joint[j.name], j.servo_id) for j in plant.robot.joints]
    seen, took_s = [], 0.0
    for tick in range(round(SECONDS / TICK_S)):
        begun_s = time.perf_counter()
        plant.advance(tick * TICK_S)
        took_s += time.perf_counter() - begun_s
        seen.append([mount.to_joint(plant.sample(i).position_rad) for mount, i in mounts])
        while waiting and waiting[0][0] == tick:
            _, _, servo, told = waiting.pop(0)
            plant.command(servo, told)
    plant.close()
    return np.array(seen), took_s


def measured(times: int = 3) -> list[tuple[str, float, float, str]]:
    """What, the time of a replay [s], that of its floor [s], and the floor's name."""
    rows = []
    for name in ("marvin", "phantomx"):
        robot = load_robot(name)
        ours_s = min(compiled(robot)[1] for _ in range(times))
        bullet_s = min(in_bullet(robot)[1] for _ in range(times))
        what = f"{SECONDS:g} s of a {name} on its legs"
        rows.append((what, ours_s, bullet_s, "the same in PyBullet"))
    return rows
