"""A candidate gait: what a search may choose, and the space it chooses from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from hal.cpg import Gait, OutputShaping
from hal.legs import Legs, UnreachableError

Floats = NDArray[np.float64]

#: Range of ``v_left`` and ``v_right``. Assumed: the thesis's 4 and 6 times lie inside, and at its
#: upper end the legs of both robots are stretched out or nearly so.
STRIDES = (0.5, 7.0)
#: A candidate of the optimiser is at most so unequal: (right - left) / (right + left). Assumed: a
#: straight walk needs far less.
MOST_UNEQUAL = 0.2


class GaitSearchError(ValueError):
    """A search that cannot be run or gone on with: says why and what to do."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A gait to be tried. Joint angles as in the robot file; the neutral coxa stays the file's."""

    v_left: float
    v_right: float
    period_s: float
    lift_m: float
    duty_factor: float
    femur_rad: float  #: of the neutral posture
    tibia_rad: float  #: of the neutral posture

    @classmethod
    def original(cls, robot: Robot) -> Candidate:
        """The gait of the robot file at ``v_left = v_right = 1``. Raises ``RobotError``."""
        gait = Gait.of(robot)
        return cls(
            1.0,
            1.0,
            gait.period_s,
            gait.lift_m,
            gait.duty_factor,
            gait.neutral_femur_rad,
            gait.neutral_tibia_rad,
        )

    @property
    def stride(self) -> float:
        """Mean of ``v_left`` and ``v_right``: stride over that of the robot file."""
        return 0.5 * (self.v_left + self.v_right)

    def document(self, robot: Robot) -> dict[str, Any]:
        """The robot file with this gait; ``v_left`` and ``v_right`` are not in it."""
        found: dict[str, Any] = dict(robot.document)
        gait = dict(found["gait"])
        neutral = dict(gait["neutral"]) | {"femur": self.femur_rad, "tibia": self.tibia_rad}
        found["gait"] = gait | {
            "neutral": neutral,
            "period_s": self.period_s,
            "lift_m": self.lift_m,
            "duty_factor": self.duty_factor,
        }
        return found

    def on(self, robot: Robot) -> Robot:
        """The robot with this gait."""
        return replace(robot, document=MappingProxyType(self.document(robot)))

    def reachable(self, robot: Robot) -> bool:
        """Whether the legs are long enough for a whole period of it: geometry, nothing walks."""
        gait = Gait.of(self.on(robot))
        try:
            OutputShaping(Legs.of(robot), gait).check(self.v_left, self.v_right)
        except UnreachableError:
            return False
        return True


NAMES = tuple(field.name for field in fields(Candidate))


@dataclass(frozen=True, slots=True)
class Axis:
    """One coordinate of the space: 0 is the original gait, 1 a typical step away from it."""

    name: str
    step: float  #: in the coordinate's own unit
    low: float  #: bounds in steps
    high: float


class Space:
    """Candidates around the original gait, as vectors whose coordinates all matter about as much.

    Lengths and times are searched by their logarithm. Bounds and steps are assumed, with the
    reasons beside them.
    """

    def __init__(self, original: Candidate) -> None:
        self.original = original
        low, high = (math.log(v) for v in STRIDES)
        duty = original.duty_factor
        self.axes = (
            _axis("ln stride", 0.4, low, high),
            _axis("unequal", 0.05, -MOST_UNEQUAL, MOST_UNEQUAL),
            _axis("ln period", 0.12, math.log(0.5), math.log(1.6)),
            _axis("ln lift", 0.2, math.log(0.5), math.log(2.0)),  # below, swinging feet scrape
            _axis("duty", 0.03, 0.5 - duty, max(0.75 - duty, 0.03)),  # 0.5 is a tripod's least
            _axis("femur", 0.08, -0.35, 0.35),  # 20 degrees either way
            _axis("tibia", 0.08, -0.35, 0.35),
        )

    def candidate(self, x: Sequence[float] | Floats) -> Candidate:
        """The candidate at ``x``, shape (axes,), in steps."""
        stride, unequal, period, lift, duty, femur, tibia = (
            float(value) * axis.step for value, axis in zip(x, self.axes, strict=True)
        )
        o = self.original
        return Candidate(
            math.exp(stride) * (1.0 - unequal),
            math.exp(stride) * (1.0 + unequal),
            o.period_s * math.exp(period),
            o.lift_m * math.exp(lift),
            max(0.5, o.duty_factor + duty),  # 0.5 itself must survive the rounding
            o.femur_rad + femur,
            o.tibia_rad + tibia,
        )

    def point(self, candidate: Candidate) -> Floats:
        """Where a candidate is, shape (axes,), in steps; at the nearest bounds if beyond them."""
        o, c = self.original, candidate
        stride = 0.5 * (c.v_left + c.v_right)
        at = (
            math.log(stride),
            0.5 * (c.v_right - c.v_left) / stride,
            math.log(c.period_s / o.period_s),
            math.log(c.lift_m / o.lift_m),
            c.duty_factor - o.duty_factor,
            c.femur_rad - o.femur_rad,
            c.tibia_rad - o.tibia_rad,
        )
        steps = [value / axis.step for value, axis in zip(at, self.axes, strict=True)]
        return np.clip(steps, [axis.low for axis in self.axes], [axis.high for axis in self.axes])

    def grid(self, values: int) -> list[Candidate]:
        """The thesis's grid: so many values of ``v_left`` and of ``v_right``, all else original."""
        axis = np.linspace(*STRIDES, values).tolist()
        rest = astuple(self.original)[2:]
        return [Candidate(left, right, *rest) for left in axis for right in axis]


def _axis(name: str, step: float, low: float, high: float) -> Axis:
    return Axis(name, step, low / step, high / step)
