"""Gait phase from what a robot was told: touch-down and lift-off of every commanded foot.

The pattern generators' phase is not on the bus, but the goals are. Forward kinematics of the goals
gives the path of each commanded foot; it touches down where that path comes back to the ground.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.legs import PARTS, Legs

Floats = NDArray[np.float64]

#: A commanded foot higher than this over its stance is in swing [m]. Assumed: three times what one
#: count of a joint lifts it.
LIFTED_M = 0.003
#: Of a commanded foot's heights, this share from below is its stance.
STANCE_QUANTILE = 0.1
#: A cycle counts if its duration is within this share of the median one: the start-up is not.
STEADY = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Cycles:
    """The steady gait cycles of one leg: touch-downs, lift-offs and next touch-downs [s].

    Each of shape (cycles,).
    """

    touch_down_s: Floats
    lift_off_s: Floats
    end_s: Floats

    @property
    def period_s(self) -> float:
        """Median duration [s]; NaN without a cycle."""
        durations = self.end_s - self.touch_down_s
        return float(np.median(durations)) if len(durations) else float("nan")

    @property
    def duty_factor(self) -> float:
        """Mean share of a cycle in stance; NaN without a cycle."""
        if not len(self.end_s):
            return float("nan")
        share = (self.lift_off_s - self.touch_down_s) / (self.end_s - self.touch_down_s)
        return float(np.mean(share))

    def phase(self, t_s: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Phase, 0 at touch-down to 1, and whether in stance; phase is NaN outside any cycle."""
        if not len(self.touch_down_s):
            return np.full(np.shape(t_s), np.nan), np.zeros(np.shape(t_s), dtype=bool)
        i = np.maximum(np.searchsorted(self.touch_down_s, t_s, side="right") - 1, 0)
        phase = (t_s - self.touch_down_s[i]) / (self.end_s[i] - self.touch_down_s[i])
        inside = (phase >= 0.0) & (phase < 1.0)
        return np.where(inside, phase, np.nan), inside & (t_s < self.lift_off_s[i])


def feet_m(legs: Legs, angles_rad: Mapping[str, Floats]) -> Floats:
    """Feet over time in the trunk's frame, shape (samples, legs, 3).

    ``angles_rad``: by joint, each of shape (samples,), at the same instants.
    """
    order = [f"{name}.{part}" for name in legs.names for part in PARTS]
    rows = np.stack([angles_rad[joint] for joint in order], axis=1)
    return np.array([legs.feet_m(row.reshape(-1, 3)) for row in rows])


def cycles(t_s: Floats, height_m: Floats) -> Cycles:
    """Steady cycles of a commanded foot with these heights [m]; both of shape (samples,)."""
    lifted = height_m - np.quantile(height_m, STANCE_QUANTILE) > LIFTED_M
    edges = np.diff(lifted.astype(np.int8))
    down, up = t_s[1:][edges == -1], t_s[1:][edges == 1]
    if len(down) < 2:
        empty = np.empty(0)
        return Cycles(empty, empty, empty)
    start, end = down[:-1], down[1:]
    off = up[np.searchsorted(up, start)]
    duration = end - start
    steady = np.abs(duration / np.median(duration) - 1.0) < STEADY
    return Cycles(start[steady], off[steady], end[steady])


def profile(phase: Floats, value: Floats, bins: int = 50) -> tuple[Floats, Floats]:
    """Mean of ``value`` over phase: centres of the bins, and means (NaN in an empty bin)."""
    centres = (np.arange(bins) + 0.5) / bins
    there = ~(np.isnan(phase) | np.isnan(value))
    index = np.minimum((phase[there] * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    total = np.bincount(index, weights=value[there], minlength=bins)
    return centres, np.where(count > 0, total / np.maximum(count, 1), np.nan)
