"""The numbers of a gait, from the ``[gait]`` section of a robot file."""

from __future__ import annotations

from dataclasses import dataclass

from busemu.tables import Robot, RobotError

from ..legs import PARTS, quantity

KEYS = ("neutral", "period_s", "stride_m", "lift_m", "duty_factor", "cycle_s")


@dataclass(frozen=True, slots=True)
class Gait:
    """A tripod gait. Joint angles as in the robot file; the stride is that of ``v = 1``."""

    neutral_coxa_rad: float
    neutral_femur_rad: float
    neutral_tibia_rad: float
    period_s: float  #: one stance and one swing of a leg
    stride_m: float  #: way of a middle leg's foot along the trunk during its stance, at v = 1
    lift_m: float  #: height of the swing above the stance
    duty_factor: float  #: share of the period that a foot is in stance
    cycle_s: float = 0.0  #: period of the control cycle; 0: as fast as the bus allows

    def __post_init__(self) -> None:
        if not (self.period_s > 0.0 and self.stride_m > 0.0 and self.lift_m > 0.0):
            raise ValueError("period_s, stride_m and lift_m of a gait must be positive")
        if not 0.5 <= self.duty_factor < 1.0:
            raise ValueError(
                f"duty_factor must be 0.5 to below 1, not {self.duty_factor}: "
                "with less there are moments without a tripod on the ground"
            )
        if not self.cycle_s >= 0.0:
            raise ValueError(f"cycle_s must not be negative, got {self.cycle_s}")

    @classmethod
    def of(cls, robot: Robot) -> Gait:
        """Take the gait from a robot file. Raises :class:`RobotError` naming what is missing."""
        section = robot.document.get("gait", {})
        if unknown := sorted(set(section) - set(KEYS)):
            raise RobotError(
                f"{robot.path}: [gait] unknown key {', '.join(unknown)}; known are "
                f"{', '.join(KEYS)}"
            )
        coxa, femur, tibia = (quantity(robot.document, "gait", "neutral", part) for part in PARTS)
        try:
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
        except RobotError:
            raise
        except ValueError as error:
            raise RobotError(f"{robot.path}: [gait] {error}") from None
