"""Pictures of a robot: from poses to frames, seen by a camera that follows it.

The ground is a chequered plane fixed to the world, so that motion shows; each square has sides of
:data:`SQUARE_M`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot

from .robot import PhysicalRobot, read_physics
from .world import Camera, Pixels, World

SQUARE_M = 0.10
OVERSAMPLING = 2  #: rendered so many times larger, then averaged
FIELD_DEG = 28.0
SIDE_RAD = math.radians(-58.0)  #: where the camera stands, about +z from the x axis (right)
ABOVE_RAD = math.radians(32.0)
TARGET_UP = 0.35  #: share of the standing height that the camera looks at
LIGHT_SQUARE = np.array([236.0, 239.0, 243.0])
DARK_SQUARE = np.array([198.0, 206.0, 216.0])
SKY = np.array([250.0, 251.0, 253.0])
HAZE_M = (1.1, 2.6)  #: distance from the robot at which the ground begins to fade, and has faded


@dataclass(frozen=True, slots=True)
class Pose:
    """A robot at one instant.

    Trunk frame in the world, angles as ``observe()`` gives them (yaw the heading, pitch nose up,
    roll right side down); joint angles [rad] by joint name, in the joints' frame.
    """

    x_m: float
    y_m: float
    z_m: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    joints_rad: Mapping[str, float]

    def quaternion(self) -> tuple[float, float, float, float]:
        """Orientation (x, y, z, w): yaw about z, then pitch about x, then roll about y."""
        sx, cx = math.sin(self.pitch_rad / 2), math.cos(self.pitch_rad / 2)
        sy, cy = math.sin(self.roll_rad / 2), math.cos(self.roll_rad / 2)
        sz, cz = math.sin(self.yaw_rad / 2), math.cos(self.yaw_rad / 2)
        return (
            cz * sx * cy - sz * cx * sy,
            cz * cx * sy + sz * sx * cy,
            sz * cx * cy + cz * sx * sy,
            cz * cx * cy - sz * sx * sy,
        )


def render(
    robot: Robot, poses: Iterable[Pose], *, width_px: int = 480, height_px: int = 320
) -> Iterator[Pixels]:
    """Yield one frame a pose: shape (height, width, 3), uint8, red-green-blue, row 0 on top.

    The camera keeps its distance and direction to the trunk, so the robot stays in the middle and
    the ground moves. Raises :class:`sim.entries.PhysicsError` when the robot's physical part cannot
    be used and ``KeyError`` for a joint it does not have.
    """
    physical = read_physics(robot)
    world = World(physical, step_s=0.001)
    reach_m = _reach_m(physical)
    try:
        for pose in poses:
            world.place((pose.x_m, pose.y_m, pose.z_m), pose.quaternion(), pose.joints_rad)
            camera = _camera(physical, pose, reach_m, width_px, height_px)
            colours, robot_there = world.photograph(camera)
            yield _average(_on_ground(camera, colours, robot_there, reach_m))
    finally:
        world.close()


def _reach_m(robot: PhysicalRobot) -> float:
    mounts = max(math.hypot(leg.x_m, leg.y_m) for leg in robot.legs)
    return mounts + robot.foot_m(robot.neutral_rad)[0]


def _camera(robot: PhysicalRobot, pose: Pose, reach_m: float, width: int, height: int) -> Camera:
    up = TARGET_UP * robot.height_m(robot.neutral_rad)
    wide = width / height
    distance = 1.5 * reach_m / (math.tan(math.radians(FIELD_DEG) / 2) * min(wide, 1.5))
    flat = distance * math.cos(ABOVE_RAD)
    return Camera(
        eye_m=(
            pose.x_m + flat * math.cos(SIDE_RAD),
            pose.y_m + flat * math.sin(SIDE_RAD),
            up + distance * math.sin(ABOVE_RAD),
        ),
        target_m=(pose.x_m, pose.y_m, up),
        field_deg=FIELD_DEG,
        width_px=width * OVERSAMPLING,
        height_px=height * OVERSAMPLING,
    )


def _on_ground(
    camera: Camera, colours: Pixels, robot_there: NDArray[np.bool_], reach_m: float
) -> Pixels:
    """Paint the chequered ground wherever the robot is not, keeping the shadow near the robot."""
    eye, target = np.array(camera.eye_m), np.array(camera.target_m)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    half = math.tan(math.radians(camera.field_deg) / 2)
    rows = (1.0 - 2.0 * (np.arange(camera.height_px) + 0.5) / camera.height_px) * half
    wide = half * camera.width_px / camera.height_px
    columns = (2.0 * (np.arange(camera.width_px) + 0.5) / camera.width_px - 1.0) * wide
    rays = ahead + rows[:, None, None] * up + columns[None, :, None] * right
    down = rays[:, :, 2] < -1e-6
    far = np.where(down, -eye[2] / np.where(down, rays[:, :, 2], -1.0), 0.0)
    x, y = eye[0] + far * rays[:, :, 0], eye[1] + far * rays[:, :, 1]
    dark = (np.floor(x / SQUARE_M) + np.floor(y / SQUARE_M)) % 2 == 1
    ground = np.where(dark[:, :, None], DARK_SQUARE, LIGHT_SQUARE)
    shade = colours.astype(float).mean(axis=2)
    lit = np.percentile(shade[~robot_there], 50)
    away = np.hypot(x - target[0], y - target[1])
    shadow = np.clip(1.0 - shade / lit, 0.0, 0.4) * np.clip(6.0 - 5.0 * away / reach_m, 0.0, 1.0)
    ground = ground * (1.0 - shadow)[:, :, None]
    haze = np.where(down, np.clip((away - HAZE_M[0]) / (HAZE_M[1] - HAZE_M[0]), 0.0, 1.0), 1.0)
    ground += haze[:, :, None] * (SKY - ground)
    return np.where(robot_there[:, :, None], colours, ground.round().astype(np.uint8))


def _average(pixels: Pixels) -> Pixels:
    height, width = pixels.shape[0] // OVERSAMPLING, pixels.shape[1] // OVERSAMPLING
    blocks = pixels.reshape(height, OVERSAMPLING, width, OVERSAMPLING, 3)
    averaged: Pixels = blocks.mean(axis=(1, 3)).round().astype(np.uint8)
    return averaged
