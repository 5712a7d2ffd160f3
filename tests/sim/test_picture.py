"""Pictures: what must be on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from busemu.tables import Robot, load_robot
from sim.picture import Pose, render
from sim.robot import read_physics
from sim.urdf import COLOURS
from sim.world import World


def standing(robot: Robot) -> Pose:
    physical = read_physics(robot)
    height = physical.height_m(physical.neutral_rad)
    return Pose(0.0, 0.0, height, 0.0, 0.0, 0.0, physical.posture(physical.neutral_rad))


def test_a_frame_has_the_size_asked_for_and_shows_every_part(robot: Robot) -> None:
    (frame,) = render(robot, [standing(robot)], width_px=240, height_px=160)
    assert frame.shape == (160, 240, 3)
    assert frame.dtype == np.uint8
    for colour in COLOURS.values():
        hue = np.array(colour) / np.linalg.norm(colour)
        pixels = frame.reshape(-1, 3).astype(float)
        alike = pixels @ hue / np.maximum(np.linalg.norm(pixels, axis=1), 1.0)
        dark = pixels.max(axis=1) < 235  # not the ground
        assert (dark & (alike > 0.99)).sum() > 5


def test_the_whole_robot_is_in_the_frame(robot: Robot) -> None:
    (frame,) = render(robot, [standing(robot)], width_px=240, height_px=160)
    saturation = frame.max(axis=2).astype(int) - frame.min(axis=2)
    dark = frame.max(axis=2) < 80
    there = (saturation > 40) | dark
    assert there.sum() > 500
    edge = np.concatenate([there[0], there[-1], there[:, 0], there[:, -1]])
    assert not edge.any()


def test_the_ground_moves_under_a_walking_robot_and_the_robot_stays_in_the_middle() -> None:
    robot = load_robot("marvin")
    here = standing(robot)
    there = replace(here, x_m=0.1)  # one square further: light and dark swap
    twice = replace(here, x_m=0.2)
    a, b, c = (
        f.astype(int) for f in render(robot, [here, there, twice], width_px=120, height_px=80)
    )
    assert np.abs(a - b)[:10].mean() > 10.0
    assert np.abs(a - c).mean() < 0.5


def test_a_poses_quaternion_is_what_observe_reads_back() -> None:
    robot = read_physics(load_robot("marvin"))
    world = World(robot, step_s=0.001)
    pose = Pose(0.1, 0.2, 0.5, 0.3, -0.4, 1.9, {})
    world.place((pose.x_m, pose.y_m, pose.z_m), pose.quaternion(), {})
    seen = world.observe()
    world.close()
    for key in ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad"):
        assert seen[f"mocap/base_{key}"] == pytest.approx(getattr(pose, key)), key


@pytest.mark.parametrize("name", ["pendulum", "marvin-leg", "arm"])
def test_a_whole_rig_is_in_the_frame_and_moves(name: str) -> None:
    robot = load_robot(name)
    rest = read_physics(robot).posture(read_physics(robot).rest_rad)
    turned = {joint: angle + 0.3 for joint, angle in rest.items()}
    poses = [Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, joints) for joints in (rest, turned)]
    frames = list(render(robot, poses, width_px=240, height_px=160))
    for frame in frames:
        saturation = frame.max(axis=2).astype(int) - frame.min(axis=2)
        there = (saturation > 40) | (frame.max(axis=2) < 80)
        assert there.sum() > 40
        assert not np.concatenate([there[0], there[-1], there[:, 0], there[:, -1]]).any()
    assert (frames[0] != frames[1]).any()
