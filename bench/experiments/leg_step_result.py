"""What leg steps were like."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .experiment import RAW_DATA, Comparison
from .series import Floats, rms
from .steps import StepAnswer

#: RMSE of position in the thesis, in units of the resolution.
THESIS_RMSE = {"phantomx": "as low as 6", "marvin": "as low as 0.5"}


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One step of one joint in one repeat; arrays of shape (samples,), times since the goal."""

    joint: str
    repeat: int
    start_rad: float  #: goal before
    goal_rad: float
    t_s: Floats
    position_rad: Floats
    true_rad: Floats  #: NaN where nobody knew it
    answer: StepAnswer

    @property
    def outward(self) -> bool:
        """Whether the joint's angle grows."""
        return self.goal_rad > self.start_rad


@dataclass(frozen=True, slots=True, eq=False)
class LegStep:
    """Steps of the three joints of a leg, or of all joints of a rig, whose ``leg`` is empty."""

    robot: str
    leg: str
    joints: tuple[str, ...]
    repeats: int
    count_rad: float  #: resolution of the position
    period_s: float  #: median time between two positions read
    steps: tuple[Step, ...]

    @property
    def parts(self) -> tuple[str, ...]:
        """What the joints are called here: coxa, femur, tibia; or their own names."""
        return tuple(joint.removeprefix(f"{self.leg}.") for joint in self.joints)

    def _joint(self, part: str) -> str:
        return self.joints[self.parts.index(part)]

    def of(self, part: str, *, outward: bool) -> list[Step]:
        """Steps of one joint one way, a repeat each."""
        joint = self._joint(part)
        return [step for step in self.steps if step.joint == joint and step.outward is outward]

    def repeatability_counts(self, part: str, *, outward: bool) -> float:
        """RMS of repeats about their mean course, in counts of the sensor; NaN for one repeat."""
        every = self.of(part, outward=outward)
        if len(every) < 2:
            return float("nan")
        end_s = min(float(step.t_s[-1]) for step in every)
        at_s = np.arange(0.0, end_s, self.period_s)
        curves = np.array([np.interp(at_s, step.t_s, step.position_rad) for step in every])
        return rms((curves - curves.mean(axis=0)).ravel()) / self.count_rad

    def sensor_counts(self, part: str) -> float:
        """RMS of positions read minus true angles, in counts; NaN where nobody knew them."""
        every = [s for s in self.steps if s.joint == self._joint(part)]
        return rms(np.concatenate([s.position_rad - s.true_rad for s in every])) / self.count_rad

    def numbers(self) -> dict[str, Any]:
        """All numbers, as JSON can hold them."""
        joints: dict[str, Any] = {}
        for part in self.parts:
            joints[part] = {"read_minus_true_rms_counts": self.sensor_counts(part)}
            for outward, word in ((True, "up"), (False, "down")):
                every = [step.answer for step in self.of(part, outward=outward)]
                joints[part][word] = {
                    "rise_time_s": _mean(a.rise_s for a in every),
                    "overshoot_of_step": _mean(a.overshoot for a in every),
                    "settling_time_s": _mean(a.settling_s for a in every),
                    "steady_error_rad": _mean(a.steady_error_rad for a in every),
                    "steady_error_spread_rad": float(np.std([a.steady_error_rad for a in every])),
                    "repeatability_rms_counts": self.repeatability_counts(part, outward=outward),
                }
        return {
            "leg": self.leg or None,
            "repeats": self.repeats,
            "step_rad": _mean(abs(s.goal_rad - s.start_rad) for s in self.steps),
            "resolution_rad": self.count_rad,
            "sampling_period_s": self.period_s,
            "joints": joints,
        }

    def comparisons(self) -> tuple[Comparison, ...]:
        """Numbers beside the thesis's; none for a robot that it does not know."""
        if self.robot not in THESIS_RMSE:
            return ()
        spread = [
            self.repeatability_counts(part, outward=way)
            for part in self.parts
            for way in (True, False)
        ]
        known = [counts for counts in spread if not math.isnan(counts)]
        found = []
        if known:
            found.append(
                Comparison(
                    "RMSE of position",
                    f"{min(known):.2f} to {max(known):.2f} x resolution between repeats",
                    f"{THESIS_RMSE[self.robot]} x resolution",
                    "ours is the spread of our own repeats, the thesis's is model against real "
                    f"robot; {RAW_DATA}",
                )
            )
        largest = max(step.answer.overshoot for step in self.steps)
        found.append(
            Comparison(
                "overshoot",
                f"up to {largest:.1%} of the step",
                "seen on the real PhantomX, missed by the thesis's model"
                if self.robot == "phantomx"
                else "none reported",
                "the thesis gives no number for it",
            )
        )
        return tuple(found)

    def findings(self) -> tuple[str, ...]:
        """What a reader should know."""
        found = []
        for part in self.parts:
            every = [s.answer for way in (True, False) for s in self.of(part, outward=way)]
            off = _mean(abs(a.steady_error_rad) for a in every) / self.count_rad
            found.append(
                f"{part}: rises in {_mean(a.rise_s for a in every) * 1e3:.0f} ms, overshoots by "
                f"{_mean(a.overshoot for a in every):.1%}, settles in "
                f"{_mean(a.settling_s for a in every) * 1e3:.0f} ms, {off:.1f} counts off"
            )
        return tuple(found)


def _mean(values: Iterable[float]) -> float:
    """Mean of the values that are there; NaN if none is."""
    there = [value for value in values if not math.isnan(value)]
    return sum(there) / len(there) if there else float("nan")
