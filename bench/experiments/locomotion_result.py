"""What a set of walks was like."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.legs import PARTS

from ..figures.path import Displacement
from .experiment import RAW_DATA, Comparison
from .series import Floats, rms

#: Safe continuous torque, as a share of the stall torque; source: the thesis.
TORQUE_LIMIT = 0.75

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class JointCourse:
    """One joint over the steady part of a walk; arrays of shape (samples,), joint's frame."""

    joint: str
    phase: Floats  #: 0 at touch-down to 1; NaN outside a whole steady cycle
    stance: Flags
    goal_rad: Floats
    position_rad: Floats
    torque_nm: Floats  #: from position error and velocity
    static_nm: Floats  #: from the position error alone, as the thesis does it
    true_nm: Floats  #: NaN where nobody knew it

    @property
    def swing(self) -> Flags:
        """Which samples lie in swing."""
        return ~self.stance & ~np.isnan(self.phase)


@dataclass(frozen=True, slots=True, eq=False)
class LegCourse:
    """One leg over the steady part of a walk; feet (samples, 3) in the trunk's frame [m]."""

    leg: str
    period_s: float
    duty_factor: float
    phase: Floats
    stance: Flags
    commanded_m: Floats
    measured_m: Floats  #: by the joints read, not by anyone who saw the foot
    joints: tuple[JointCourse, ...]

    def stride_m(self, *, commanded: bool) -> float:
        """Way of the foot along the trunk in a stance [m]: commanded, or by the joints read."""
        feet = self.commanded_m if commanded else self.measured_m
        edges = np.flatnonzero(np.diff(self.stance.astype(np.int8)))
        ways = []
        for run in np.split(np.arange(len(self.stance)), edges + 1):
            if self.stance[run[0]] and run[0] > 0 and run[-1] < len(self.stance) - 1:
                ways.append(float(feet[run[0], 1] - feet[run[-1], 1]))
        return float(np.mean(ways)) if ways else float("nan")

    @property
    def sag_m(self) -> float:
        """How much lower the trunk hangs on this foot in stance than commanded [m]."""
        difference = self.measured_m[self.stance, 2] - self.commanded_m[self.stance, 2]
        return float(np.mean(difference))


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """One repeat."""

    repeat: int
    seconds: float
    legs: tuple[LegCourse, ...]
    moved: Displacement | None  #: in its steady part; ``None`` where nobody watched
    self_contact_n: Floats | None  #: over all of it


@dataclass(frozen=True, slots=True, eq=False)
class Locomotion:
    """Walks of one robot, one a repeat."""

    robot: str
    stalls_nm: Mapping[str, float]  #: by joint, of the data sheet
    count_rad: float
    legs: tuple[str, ...]
    walks: tuple[Walk, ...]

    def courses(self, part: str, leg: str | None = None) -> Iterator[JointCourse]:
        """Courses of one kind of joint, over repeats and legs, or of one leg."""
        for walk in self.walks:
            for course in walk.legs:
                if leg in (None, course.leg):
                    yield course.joints[PARTS.index(part)]

    def stance_error_rad(self, part: str, leg: str | None = None) -> float:
        """Mean of goal minus position in stance [rad]."""
        errors = [(c.goal_rad - c.position_rad)[c.stance] for c in self.courses(part, leg)]
        return float(np.mean(np.concatenate(errors)))

    def tracking_rms_rad(self, part: str) -> float:
        """RMS of goal minus position over stance and swing [rad]."""
        return rms(np.concatenate([c.goal_rad - c.position_rad for c in self.courses(part)]))

    def torque_of_stall(self, part: str, *, true: bool = False) -> Floats:
        """Torques of one kind of joint over all samples, in stall torques; recovered or true."""
        return np.concatenate(
            [
                (c.true_nm if true else c.torque_nm) / self.stalls_nm[c.joint]
                for c in self.courses(part)
            ]
        )

    def rmse_of_stall(self, part: str, *, stance: bool, static: bool = False) -> float:
        """RMS of recovered minus true torque, in stall torques, in stance or swing; or NaN."""
        every = [
            ((c.static_nm if static else c.torque_nm) - c.true_nm)[c.stance if stance else c.swing]
            / self.stalls_nm[c.joint]
            for c in self.courses(part)
        ]
        return rms(np.concatenate(every))

    @property
    def period_s(self) -> float:
        """Period of the locked gait [s]."""
        return float(np.median([course.period_s for walk in self.walks for course in walk.legs]))

    @property
    def duty_factor(self) -> float:
        """Share of the period in stance, as commanded."""
        return float(np.mean([course.duty_factor for walk in self.walks for course in walk.legs]))

    def stride_m(self, *, commanded: bool) -> float:
        """Mean way of a foot along the trunk in a stance [m]."""
        return float(
            np.nanmean([c.stride_m(commanded=commanded) for walk in self.walks for c in walk.legs])
        )

    @property
    def speeds_m_s(self) -> list[float]:
        """Speed in the steady part of each walk that was watched [m/s]."""
        return [walk.moved.speed_m_s for walk in self.walks if walk.moved is not None]

    @property
    def self_collision_share(self) -> float:
        """Share of the time in which links of the robot touch each other; NaN if unwatched."""
        watched = [w.self_contact_n for w in self.walks if w.self_contact_n is not None]
        return float(np.mean(np.concatenate(watched) > 0.0)) if watched else float("nan")

    @property
    def self_collision_n(self) -> float:
        """Largest force between links of the robot [N]; NaN if unwatched."""
        watched = [w.self_contact_n for w in self.walks if w.self_contact_n is not None]
        return float(np.max(np.concatenate(watched))) if watched else float("nan")

    def numbers(self) -> dict[str, Any]:
        """All numbers, as JSON can hold them."""
        return {
            "repeats": len(self.walks),
            "walked_s": [walk.seconds for walk in self.walks],
            "period_s": self.period_s,
            "duty_factor": self.duty_factor,
            "stride_commanded_m": self.stride_m(commanded=True),
            "stride_by_joints_m": self.stride_m(commanded=False),
            "speed_m_s": _mean(self.speeds_m_s),
            "speed_spread_m_s": float(np.std(self.speeds_m_s)) if self.speeds_m_s else None,
            "advance_a_cycle_m": _mean(self.speeds_m_s) * self.period_s,
            "distance_m": [w.moved.distance_m for w in self.walks if w.moved is not None],
            "turned_rad": [w.moved.turned_rad for w in self.walks if w.moved is not None],
            "self_collision_share_of_time": self.self_collision_share,
            "self_collision_largest_n": self.self_collision_n,
            "torque_limit_of_stall": TORQUE_LIMIT,
            "joints": {part: self._joint_numbers(part) for part in PARTS},
            "sag_in_stance_m": {
                leg: float(np.mean([c.sag_m for w in self.walks for c in w.legs if c.leg == leg]))
                for leg in self.legs
            },
        }

    def _joint_numbers(self, part: str) -> dict[str, Any]:
        torque = np.abs(self.torque_of_stall(part))
        true = np.abs(self.torque_of_stall(part, true=True))
        known = not np.isnan(true).all()
        return {
            "tracking_rms_rad": self.tracking_rms_rad(part),
            "stance_error_rad": self.stance_error_rad(part),
            "stance_error_counts": self.stance_error_rad(part) / self.count_rad,
            "stance_error_by_leg_rad": {leg: self.stance_error_rad(part, leg) for leg in self.legs},
            "torque_peak_of_stall": float(np.nanmax(torque)),
            "torque_share_over_limit": float(np.mean(torque > TORQUE_LIMIT)),
            "true_torque_peak_of_stall": float(np.nanmax(true)) if known else None,
            "true_torque_share_over_limit": float(np.mean(true > TORQUE_LIMIT)) if known else None,
            "torque_rmse_of_stall": {
                "stance": self.rmse_of_stall(part, stance=True),
                "swing": self.rmse_of_stall(part, stance=False),
                "stance_without_velocity": self.rmse_of_stall(part, stance=True, static=True),
                "swing_without_velocity": self.rmse_of_stall(part, stance=False, static=True),
            },
        }

    def comparisons(self) -> tuple[Comparison, ...]:
        """Numbers beside the thesis's."""
        femur, tibia = (math.degrees(self.stance_error_rad(part)) for part in ("femur", "tibia"))
        over = max(float(np.mean(np.abs(self.torque_of_stall(p)) > TORQUE_LIMIT)) for p in PARTS)
        return (
            Comparison(
                "mean stance error of femur and tibia",
                f"{femur:+.2f} and {tibia:+.2f} degrees (goal - position)",
                "systematic on the real Marvin, model without it; only shown"
                if self.robot == "marvin"
                else "not discussed",
                f"no number is given, and {RAW_DATA}",
            ),
            Comparison(
                "torque within 0.75 x stall",
                f"all but {over:.1%} of the time in the worst kind of joint",
                "kept by the walks chosen",
                f"the stride of the thesis's walks is not published; {RAW_DATA}",
            ),
            Comparison(
                "self-collision",
                "not watched"
                if math.isnan(self.self_collision_share)
                else f"{self.self_collision_share:.1%} of the time, at most "
                f"{self.self_collision_n:.1f} N",
                "none at 4 x the original stride, some at 6 x",
                "the original stride is not published: try --v-left and --v-right",
            ),
        )

    def findings(self) -> tuple[str, ...]:
        """What a reader should know."""
        mm = 1e3
        found = [
            f"stride {self.stride_m(commanded=True) * mm:.1f} mm commanded, "
            f"{self.stride_m(commanded=False) * mm:.1f} mm by the joints read, "
            f"period {self.period_s:.3f} s"
        ]
        if self.speeds_m_s:
            found.append(
                f"walks {_mean(self.speeds_m_s) * mm:.1f} mm/s "
                f"(+- {float(np.std(self.speeds_m_s)) * mm:.1f} between repeats), "
                f"{_mean(self.speeds_m_s) * self.period_s * mm:.1f} mm a cycle"
            )
        else:
            found.append("nobody watched the body, so distance and speed are not known")
        found.append(
            "stance error: "
            + ", ".join(
                f"{part} {math.degrees(self.stance_error_rad(part)):+.2f} degrees" for part in PARTS
            )
        )
        return tuple(found)


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
