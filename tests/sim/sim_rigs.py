"""What the tests of the simulator share."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from busemu.plant import DriveCommand
from busemu.tables import Robot
from busemu.tables.robots import parse_robot
from sim.world import BulletPlant, World

# Position laws as the servos have them at power-on: XL-320 p_gain 32, AX-12A slope 32 counts.
LAWS: Mapping[str, Mapping[str, float]] = {
    "marvin": {"gain_cw_per_rad": 5.06, "gain_ccw_per_rad": 5.06},
    "phantomx": {
        "gain_cw_per_rad": 6.11,
        "gain_ccw_per_rad": 6.11,
        "margin_cw_rad": 0.00511,
        "margin_ccw_rad": 0.00511,
        "punch_duty": 0.0313,
    },
}


def hold(plant: BulletPlant, robot: Robot, posture: Mapping[str, float], **more: Any) -> None:
    """Torque on, every joint to its segment's angle [rad]."""
    for servo in robot.servos:
        goal = servo.to_servo(posture[servo.joint.split(".")[1]])
        command = DriveCommand(
            torque_enable=True, goal_position_rad=goal, **{**LAWS[robot.name], **more}
        )
        plant.command(servo.servo_id, command)


def stand(plant: BulletPlant, robot: Robot, settle_s: float = 3.0) -> None:
    """From lying to neutral, and wait until it is still."""
    hold(plant, robot, plant.robot.neutral_rad, velocity_limit_rad_s=1.0)
    plant.advance(settle_s)


def changed(robot: Robot, *keys: Any, to: Any) -> Robot:
    """The robot with one entry of its file changed; ``to=None`` removes it."""
    document = copy.deepcopy(dict(robot.document))
    table: Any = document
    for key in keys[:-1]:
        table = table[key]
    if to is None:
        del table[keys[-1]]
    else:
        table[keys[-1]] = to
    return parse_robot(document, robot.path)


def with_effect(robot: Robot, name: str, where: list[str], **values: float) -> Robot:
    """The robot with an effect at the end of its file's."""
    parameters = {key: {"value": value, "source": "assumed"} for key, value in values.items()}
    table = {"name": name, "where": where, "parameters": parameters}
    return changed(robot, "effect", to=[*robot.document.get("effect", []), table])


def swing(world: World, joint: str, amplitude_rad: float) -> float:
    """Period [s] of the only joint of a rig let go from an amplitude, over two swings."""
    step_s = world.step_s
    position, velocity, none = np.zeros(1), np.zeros(1), np.zeros(1)
    world.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), {joint: amplitude_rad})
    before, crossings, step = amplitude_rad, [], 0
    while len(crossings) < 5:
        world.step(none)
        world.read(position, velocity)
        step += 1
        after = float(position[0])
        if before * after < 0.0:
            crossings.append((step - after / (after - before)) * step_s)
        before = after
    return 0.5 * (crossings[4] - crossings[0])
