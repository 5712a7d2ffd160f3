"""The numbers of a gait, from the ``[gait]`` section of a robot file."""

from __future__ import annotations

import math
from dataclasses import dataclass

from busemu.tables import Robot, RobotError

from ..legs import PARTS, quantity

KEYS = ("neutral", "period_s", "stride_m", "lift_m", "duty_factor", "cycle_s")

#: What a number of a gait may be: lowest, highest, unit. Wider than any robot here needs; a foot
#: beyond a leg's reach is refused by the shaping. Assumed.
BOUNDS = {
    "neutral_coxa_rad": (-math.pi, math.pi, "rad"),
    "neutral_femur_rad": (-math.pi, math.pi, "rad"),
    "neutral_tibia_rad": (-math.pi, math.pi, "rad"),
    "period_s": (0.05, 100.0, "s"),
    "stride_m": (1e-4, 2.0, "m"),
    "lift_m": (1e-4, 2.0, "m"),
    "cycle_s": (0.0, 1.0, "s"),
}


@dataclass(frozen=True, slots=True)
class Gait:
    """A tripod gait. Joint angles as in the robot file; the stride is that of ``v = 1``.

    Raises ``ValueError`` for a number beyond :data:`BOUNDS`, and for a duty factor below 0.5.
    """

    neutral_coxa_rad: float
    neutral_femur_rad: float
    neutral_tibia_rad: float
    period_s: float  #: one stance and one swing of a leg
    stride_m: float  #: way of a middle leg's foot along the trunk during its stance, at v = 1
    lift_m: float  #: height of the swing above the stance
    duty_factor: float  #: share of the period that a foot is in stance
    cycle_s: float = 0.0  #: period of the control cycle; 0: as fast as the bus allows

    def __post_init__(self) -> None:
        for name, (low, high, unit) in BOUNDS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(
                    f"{name} = {value:.10g} {unit} is not within {low:g} to {high:g} {unit}"
                )
        if not 0.5 <= self.duty_factor < 1.0:
            raise ValueError(
                f"duty_factor = {self.duty_factor:.10g} (ratio) is not within 0.5 to below 1 "
                "(ratio): with less there are moments without a tripod on the ground"
            )

    @classmethod
    def of(cls, robot: Robot) -> Gait:
        """Take the gait from a robot file. Raises :class:`RobotError` naming what is missing."""
        section = robot.document.get("gait", {})
        if unknown := sorted(set(section) - set(KEYS)):
            raise RobotError(
                f"{robot.path}: [gait] unknown key {', '.join(unknown)}; known are "
                f"{', '.join(KEYS)}"
            )
        try:
            coxa, femur, tibia = (
                quantity(robot.document, "gait", "neutral", part) for part in PARTS
            )
            return cls(
                neutral_coxa_rad=coxa,
                neutral_femur_rad=femur,
                neutral_tibia_rad=tibia,
                period_s=quantity(robot.document, "gait", "period_s"),
                stride_m=quantity(robot.document, "gait", "stride_m"),
                lift_m=quantity(robot.document, "gait", "lift_m"),
                duty_factor=quantity(robot.document, "gait", "duty_factor"),
                cycle_s=quantity(robot.document, "gait", "cycle_s")
                if "cycle_s" in section
                else 0.0,
            )
        except RobotError as error:
            raise RobotError(f"{robot.path}: {error}") from None
        except ValueError as error:
            raise RobotError(f"{robot.path}: [gait] {error}") from None
