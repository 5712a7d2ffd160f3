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

from .model import read_model
from .observer import Camera
from .tree import Body, PhysicalRobot
from .world import Pixels, World

SQUARE_M = 0.10
OVERSAMPLING = 2  #: rendered so many times larger, then averaged
FIELD_DEG = 31.0
SIDE_RAD = math.radians(-58.0)  #: where the camera stands, about +z from the x axis (right)
ABOVE_RAD = math.radians(32.0)
TARGET_UP = 0.35  #: share of the standing height that the camera looks at
BEYOND_M = 0.15  #: what a rig's outermost link may reach beyond its joint; assumed
LIGHT_SQUARE = np.array([236.0, 239.0, 243.0])
DARK_SQUARE = np.array([198.0, 206.0, 216.0])
SKY = np.array([250.0, 251.0, 253.0])
HAZE_M = (1.1, 2.6)  #: distance from the robot at which the ground begins to fade, and has faded


@dataclass(frozen=True, slots=True)
class Pose:
    """A robot at one instant; a rig's base stands at the origin, all zero.

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
    physical = read_model(robot)
    reach_m = _reach_m(physical)
    camera = _camera(physical, reach_m, width_px, height_px)
    floor = _Floor(camera, reach_m)
    world = World(physical, step_s=0.001)
    try:
        for pose in poses:  # the robot stays at the origin, where the light is, and the floor moves
            world.place((0.0, 0.0, pose.z_m), pose.quaternion(), pose.joints_rad)
            colours, robot_there = world.photograph(camera)
            yield _average(floor.under(colours, robot_there, pose.x_m, pose.y_m))
    finally:
        world.close()


def _reach_m(robot: PhysicalRobot) -> float:
    if not robot.legs:
        return BEYOND_M + max(_outward_m(robot, body) for body in robot.bodies)
    return max(
        math.hypot(leg.x_m, leg.y_m) + leg.foot_m(robot.neutral_rad)[0] for leg in robot.legs
    )


def _outward_m(robot: PhysicalRobot, body: Body) -> float:
    """How far a body's joint can be from the axis of a rig's base, with all stretched out."""
    if body.parent is None:
        return math.hypot(*body.at_m[:2])
    return _outward_m(robot, robot.body(body.parent)) + math.hypot(*body.at_m)


def _middle_m(robot: PhysicalRobot) -> float:
    if not robot.legs:
        return robot.bodies[0].at_m[2]
    return TARGET_UP * robot.height_m(robot.neutral_rad)


def _camera(robot: PhysicalRobot, reach_m: float, width: int, height: int) -> Camera:
    up = _middle_m(robot)
    distance = 1.6 * reach_m / (math.tan(math.radians(FIELD_DEG) / 2) * min(width / height, 1.5))
    flat = distance * math.cos(ABOVE_RAD)
    return Camera(
        eye_m=(
            flat * math.cos(SIDE_RAD),
            flat * math.sin(SIDE_RAD),
            up + distance * math.sin(ABOVE_RAD),
        ),
        target_m=(0.0, 0.0, up),
        field_deg=FIELD_DEG,
        width_px=width * OVERSAMPLING,
        height_px=height * OVERSAMPLING,
    )


class _Floor:
    """The chequered ground as one camera sees it: where each pixel's ray meets the ground."""

    def __init__(self, camera: Camera, reach_m: float) -> None:
        eye, target = np.array(camera.eye_m), np.array(camera.target_m)
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, ahead)
        half = math.tan(math.radians(camera.field_deg) / 2)
        wide = half * camera.width_px / camera.height_px
        rows = (1.0 - 2.0 * (np.arange(camera.height_px) + 0.5) / camera.height_px) * half
        columns = (2.0 * (np.arange(camera.width_px) + 0.5) / camera.width_px - 1.0) * wide
        rays = ahead + rows[:, None, None] * up + columns[None, :, None] * right
        down = rays[:, :, 2] < -1e-6
        far = np.where(down, -eye[2] / np.where(down, rays[:, :, 2], -1.0), 0.0)
        self._x_m = eye[0] + far * rays[:, :, 0]
        self._y_m = eye[1] + far * rays[:, :, 1]
        away = np.hypot(self._x_m, self._y_m)
        haze = (away - HAZE_M[0]) / (HAZE_M[1] - HAZE_M[0])
        self._haze = np.where(down, np.clip(haze, 0.0, 1.0), 1.0)[:, :, None]
        self._shadow = np.clip(6.0 - 5.0 * away / reach_m, 0.0, 1.0)  # none far from the robot

    def under(
        self, colours: Pixels, robot_there: NDArray[np.bool_], x_m: float, y_m: float
    ) -> Pixels:
        """Paint the ground wherever the robot, now at x and y, is not; its shadow stays."""
        along = np.floor((self._x_m + x_m) / SQUARE_M)
        dark = (along + np.floor((self._y_m + y_m) / SQUARE_M)) % 2 == 1
        ground = np.where(dark[:, :, None], DARK_SQUARE, LIGHT_SQUARE)
        shade = colours.sum(axis=2, dtype=np.float64)
        lit = np.median(shade[~robot_there])
        shadow = np.clip(1.0 - shade / lit, 0.0, 0.4) * self._shadow
        ground *= 1.0 - shadow[:, :, None]
        ground += self._haze * (SKY - ground)
        return np.where(robot_there[:, :, None], colours, ground.round().astype(np.uint8))


def _average(pixels: Pixels) -> Pixels:
    height, width = pixels.shape[0] // OVERSAMPLING, pixels.shape[1] // OVERSAMPLING
    blocks = pixels.reshape(height, OVERSAMPLING, width, OVERSAMPLING, 3)
    averaged: Pixels = blocks.mean(axis=(1, 3)).round().astype(np.uint8)
    return averaged
