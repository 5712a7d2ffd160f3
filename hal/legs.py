"""Legs: where the feet are, and which joint angles put them there.

Frames. Trunk: x to the right, y forward, z up, origin at the height of the coxa axes. Joint angles
[rad]: the coxa turns about z, counter-clockwise seen from above; femur and tibia pitch, positive
lifts the foot; all zero is a leg stretched out level along ``yaw_rad``. Arrays: a row a leg, in the
order of the robot file; columns coxa, femur, tibia, or x, y, z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from busemu.tables import Robot, RobotError

Array = npt.NDArray[np.float64]

PARTS = ("coxa", "femur", "tibia")
#: How far beyond its reach [share of the leg's length] a foot may be asked to go, for rounding.
REACH_TOLERANCE = 1e-9


class UnreachableError(ValueError):
    """A foot position no joint angles reach: names the leg, the position and the distances."""


def quantity(document: Mapping[str, Any], *path: str) -> float:
    """Take a number from a robot document: plain, or a table with ``value`` and ``source``.

    Raises :class:`RobotError` naming the entry that is missing or is no number.
    """
    entry: Any = document
    for key in path:
        if not isinstance(entry, Mapping) or key not in entry:
            raise RobotError(f"the robot file needs {'.'.join(path)}")
        entry = entry[key]
    value = entry.get("value") if isinstance(entry, Mapping) else entry
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RobotError(f"the robot file's {'.'.join(path)} must be a number, not {value!r}")
    try:
        return float(value)
    except OverflowError:  # TOML knows whole numbers of any length
        raise RobotError(
            f"the robot file's {'.'.join(path)} = {value!s:.40}... is beyond any bounds"
        ) from None


@dataclass(frozen=True)
class Legs:
    """The legs of a robot: hips on the trunk, and the three links that all legs share."""

    names: tuple[str, ...]
    hips_m: Array  #: (legs, 2): x, y of each coxa axis
    yaw_rad: Array  #: (legs,): outward direction of each leg
    coxa_m: float
    femur_m: float
    tibia_m: float

    @classmethod
    def of(cls, robot: Robot) -> Legs:
        """Take the legs from a robot file. Raises :class:`RobotError`."""
        document = robot.document
        rows = document.get("leg", [])
        if not rows:
            raise RobotError(f"{robot.path}: no [[leg]] is listed, so this robot cannot walk")
        try:
            return cls(
                names=tuple(str(row["name"]) for row in rows),
                hips_m=np.array([[quantity(row, "x_m"), quantity(row, "y_m")] for row in rows]),
                yaw_rad=np.array([quantity(row, "yaw_rad") for row in rows]),
                coxa_m=quantity(document, "link", "coxa", "length_m"),
                femur_m=quantity(document, "link", "femur", "length_m"),
                tibia_m=quantity(document, "link", "tibia", "length_m"),
            )
        except RobotError as error:
            raise RobotError(f"{robot.path}: {error}") from None

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names leg by leg: the order of a flattened array of angles."""
        return tuple(f"{leg}.{part}" for leg in self.names for part in PARTS)

    def feet_m(self, angles_rad: Array) -> Array:
        """Forward kinematics: feet in the trunk's frame, (legs, 3), of angles (legs, 3)."""
        coxa, femur, tibia = angles_rad.T
        pitch = femur + tibia
        radius = self.coxa_m + self.femur_m * np.cos(femur) + self.tibia_m * np.cos(pitch)
        heading = self.yaw_rad + coxa
        return np.stack(
            (
                self.hips_m[:, 0] + radius * np.cos(heading),
                self.hips_m[:, 1] + radius * np.sin(heading),
                self.femur_m * np.sin(femur) + self.tibia_m * np.sin(pitch),
            ),
            axis=1,
        )

    def angles_rad(self, feet_m: Array) -> Array:
        """Inverse kinematics, knee up: angles (legs, 3) of feet (legs, 3) in the trunk's frame.

        In closed form: the coxa points at the foot, femur and tibia are a planar arm of two links.
        Raises :class:`UnreachableError`.
        """
        x, y = (feet_m[:, :2] - self.hips_m).T
        cos_yaw, sin_yaw = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        outward, sideways = x * cos_yaw + y * sin_yaw, y * cos_yaw - x * sin_yaw
        coxa = np.arctan2(sideways, outward)
        reach = np.hypot(outward, sideways) - self.coxa_m
        height = feet_m[:, 2]
        femur_m, tibia_m = self.femur_m, self.tibia_m
        square = reach * reach + height * height
        bend = (square - femur_m**2 - tibia_m**2) / (2.0 * femur_m * tibia_m)
        if np.abs(bend).max() > 1.0 + REACH_TOLERANCE:
            self._refuse(feet_m, bend, np.sqrt(square))
        tibia = -np.arccos(np.clip(bend, -1.0, 1.0))
        femur = np.arctan2(height, reach) - np.arctan2(
            tibia_m * np.sin(tibia), femur_m + tibia_m * np.cos(tibia)
        )
        return np.stack((coxa, femur, tibia), axis=1)

    def _refuse(self, feet_m: Array, bend: Array, distance_m: Array) -> None:
        leg = int(np.argmax(np.abs(bend)))
        x, y, z = feet_m[leg]
        raise UnreachableError(
            f"{self.names[leg]}: foot at ({x:.3f}, {y:.3f}, {z:.3f}) m is {distance_m[leg]:.3f} m "
            f"from the femur's axis; the leg reaches {abs(self.femur_m - self.tibia_m):.3f} to "
            f"{self.femur_m + self.tibia_m:.3f} m"
        )

    def stretched(self, coxa: float, femur: float, tibia: float) -> Array:
        """Give every leg the same joint angles [rad]: (legs, 3)."""
        for angle in (coxa, femur, tibia):
            if not math.isfinite(angle):
                raise ValueError(f"a joint angle must be finite, got {angle}")
        return np.tile((coxa, femur, tibia), (len(self.names), 1)).astype(np.float64)
