"""What a servo check found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .experiment import RAW_DATA, Comparison
from .lines import Line
from .position_error import TorqueSensor
from .series import Floats

#: Robots of the thesis; others have nothing to be set beside.
THESIS = ("marvin", "phantomx")


@dataclass(frozen=True, slots=True, eq=False)
class ServoCheck:
    """Torque against position error of one blocked joint; arrays of shape (samples,)."""

    robot: str
    joint: str
    repeats: int
    supply_v: float
    error_rad: Floats
    torque_nm: Floats  #: NaN where nobody knew it
    load: Floats  #: ``load_register`` as duty, NaN where not read at that instant
    rising: NDArray[np.bool_]  #: the goal was on its way into the block, not back
    sensor: TorqueSensor
    load_register: str
    load_refresh_s: float  #: how often the servo renews it, as its control table says; 0 is always
    gain_per_rad: float  #: measured: duty a radian
    gain_r2: float
    line: Line | None  #: torque against error, of both ways; the spread is that of repeats
    friction_nm: float  #: measured: half of what lies between the two ways
    stall_nm: float  #: measured
    rmse_nm: float  #: torque from position error against the true one

    @property
    def expected_stall_nm(self) -> float:
        """Stall torque of the drive at the voltage measured [N m]."""
        return self.sensor.stall_at_nm(self.supply_v)

    @property
    def expected_slope_nm_rad(self) -> float:
        """What the motor gives a radian of error [N m/rad], before friction takes its part."""
        return self.sensor.law.gain_ccw_per_rad * (self.expected_stall_nm + self.sensor.friction_nm)

    def numbers(self) -> dict[str, Any]:
        """All numbers, as JSON can hold them."""
        torque: dict[str, Any] = {}
        if self.line is not None:
            torque = {
                "slope_nm_rad": self.line.slope,
                "slope_spread_nm_rad": self.line.spread,
                "straightness_r2": self.line.r2,
                "stall_torque_nm": self.stall_nm,
                "friction_nm": self.friction_nm,
                "rmse_nm": self.rmse_nm,
                "rmse_of_stall": self.rmse_nm / self.sensor.stall_nm,
            }
        return {
            "joint": self.joint,
            "repeats": self.repeats,
            "samples": len(self.error_rad),
            "supply_v": self.supply_v,
            "expected": {
                "full_duty_error_rad": self.sensor.full_error_rad,
                "slope_nm_rad": self.expected_slope_nm_rad,
                "stall_torque_nm": self.expected_stall_nm,
                "gain_duty_per_rad": self.sensor.law.gain_ccw_per_rad,
                "friction_nm": self.sensor.friction_nm,
                "resolution_rad": self.sensor.count_rad,
            },
            "measured_law": {"gain_duty_per_rad": self.gain_per_rad, "r2": self.gain_r2},
            "measured_torque": torque,
        }

    def comparisons(self) -> tuple[Comparison, ...]:
        """Numbers beside the thesis's."""
        if self.line is None or self.robot not in THESIS:
            return ()
        rated = self.sensor.stall_nm
        return (
            Comparison(
                "torque against position error",
                f"straight (R2 {self.line.r2:.3f}) to {self.sensor.full_error_rad:.3f} rad, then "
                f"{self.stall_nm:.3f} N m",
                f"a straight line that ends at the stall torque ({rated:g} N m rated)",
            ),
            Comparison(
                "RMSE of torque",
                f"{self.rmse_nm / rated:.3f} x stall",
                "only shown, in figures 29 and 33",
                f"ours is position error against true torque; {RAW_DATA}",
            ),
        )

    def findings(self) -> tuple[str, ...]:
        """What a reader should know."""
        expected = self.sensor.law.gain_ccw_per_rad
        found = [
            f"position law: {self.gain_per_rad:.2f} duty/rad from {self.load_register}, "
            f"{self.gain_per_rad / expected - 1.0:+.1%} from the control table's {expected:.2f}"
        ]
        reached = min(float(np.max(self.error_rad)), -float(np.min(self.error_rad)))
        if reached < self.sensor.full_error_rad:
            found.append(
                f"the error came only to {reached:.3f} rad on one side, short of full duty at "
                f"{self.sensor.full_error_rad:.3f} rad: the block gave way, or there was none"
            )
        if self.line is None:
            found.append(
                "nobody beside the robot knew the torque, so the recordings give the position law "
                "only"
            )
            return tuple(found)
        slope = self.line.slope / self.expected_slope_nm_rad - 1.0
        found.append(
            f"torque: {self.line.slope:.2f} N m/rad, {slope:+.1%} from the drive's constants; "
            f"friction holds {self.friction_nm:.3f} N m either way, so a torque read off the "
            f"position error is open by {self.friction_nm / self.sensor.stall_nm:.1%} of stall"
        )
        return tuple(found)
