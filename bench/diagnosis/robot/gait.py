"""What a robot was told and did over the phase of its gait, from its recorded goals alone.

The phase is that of the fundamental of all goals, unrolled over time, so it follows a rhythm that
drifts. Zero is where the first leg's commanded foot comes down. Where there is no rhythm (a robot
that stands), windows of time take the place of the phase.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.experiments.gait_phase import LIFTED_M, STANCE_QUANTILE, feet_m
from busemu.tables import Robot
from hal.legs import Legs

from ..observed import held_at

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

BINS = 24  #: of a gait cycle; at 50 Hz and a cycle of a second each holds two samples a cycle
WINDOW_S = 0.25  #: of time, where there is no gait
GRID_S = 0.01  #: of goals, between writes held
SLOWEST_HZ, FASTEST_HZ = 0.2, 4.0  #: gaits that are looked for; assumed
RHYTHM = 0.5  #: share of the goals' variance at the fundamental and its first two harmonics
STRONG = 0.5  #: a cycle counts where the rhythm is as strong, of its usual strength
EVEN = 0.2  #: and its speed as near the usual one
NEIGHBOURS = 2  #: bins either side that share their spread with one

Goals = Mapping[str, tuple[Floats, Floats]]  #: by joint: times [s] and angles [rad]


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """Gait phase over time, in cycles; NaN where there is no steady rhythm. Arrays (instants,)."""

    t_s: Floats
    cycles: Floats
    period_s: float

    def at(self, t_s: Floats) -> Floats:
        """Cycles since the first touch-down at ``t_s``; NaN outside the steady part."""
        return np.interp(t_s, self.t_s, self.cycles, left=np.nan, right=np.nan)


def gait_phase(goals: Goals, robot: Robot) -> Phase | None:
    """The phase of a gait; ``None`` where the goals have no rhythm of two cycles or more."""
    first = max(float(t[0]) for t, _ in goals.values())
    last = max(float(t[-1]) for t, _ in goals.values())
    t = np.arange(first, last, GRID_S)
    if last - first < 2.0 / FASTEST_HZ:
        return None
    held = np.stack([held_at(goal, t) for goal in goals.values()], axis=1)
    hz = _fundamental_hz(held[len(held) // 3 :])
    if hz is None:
        return None
    turned = (held - held[len(held) // 3 :].mean(axis=0)) * np.exp(-2j * math.pi * hz * t)[:, None]
    width = round(1.0 / hz / GRID_S)
    if width >= len(t) // 2:
        return None
    slow = np.stack([np.convolve(c, np.ones(width) / width, mode="same") for c in turned.T], axis=1)
    inner = slow[len(slow) // 3 : -width // 2]
    rhythm = slow @ inner.mean(axis=0).conj()
    cycles = hz * t + np.unwrap(np.angle(rhythm)) / (2.0 * math.pi)
    strength, pace = np.abs(rhythm), np.gradient(cycles, t)
    usual = np.median(strength[len(t) // 3 : -width // 2])
    steady = (strength > STRONG * usual) & (np.abs(pace / hz - 1.0) < EVEN)
    half = width // 2
    steady[:half] = steady[-half:] = False
    if not steady.any() or np.ptp(cycles[steady]) < 2.0:
        return None
    cycles = cycles - _touch_down(goals, robot, t, cycles, steady)
    return Phase(t, np.where(steady, cycles, np.nan), 1.0 / hz)


def _fundamental_hz(held: Floats) -> float | None:
    """The frequency whose harmonics carry most of the goals' variance."""
    moved = held - held.mean(axis=0)
    total = float((moved**2).sum())
    if total <= 0.0:
        return None
    size = 8 * len(moved)
    window = np.hanning(len(moved))[:, None]
    power = (np.abs(np.fft.rfft(moved * window, size, axis=0)) ** 2).sum(axis=1)
    hz = np.fft.rfftfreq(size, GRID_S)
    kept = np.flatnonzero((hz >= max(SLOWEST_HZ, 2.0 / len(moved) / GRID_S)) & (hz <= FASTEST_HZ))
    if not len(kept):
        return None
    best = int(kept[np.argmax(power[kept])])
    for part in (2, 3):  # a strong harmonic must not pass for the fundamental
        lower = kept[np.abs(hz[kept] * part / hz[best] - 1.0) < 0.1]
        if len(lower) and power[lower].max() > 0.2 * power[best]:
            best = int(lower[np.argmax(power[lower])])
    found = float(hz[best])
    t = np.arange(len(moved)) * GRID_S
    angles = 2.0 * math.pi * found * t[:, None] * np.arange(1, 4)
    table = np.concatenate([np.ones((len(t), 1)), np.cos(angles), np.sin(angles)], axis=1)
    left = moved - table @ np.linalg.lstsq(table, moved, rcond=None)[0]
    return found if 1.0 - float((left**2).sum()) / total > RHYTHM else None


def _touch_down(
    goals: Goals, robot: Robot, t: Floats, cycles: Floats, steady: NDArray[np.bool_]
) -> float:
    """Cycles at a touch-down of the first leg's commanded foot, 0 to 1."""
    lifted = commanded_lift(goals, robot, t[steady])[:, 0]
    edges = np.flatnonzero(np.diff(lifted.astype(np.int8)) == -1)
    if not len(edges):
        return 0.0
    turns = np.exp(2j * math.pi * cycles[steady][edges])
    return float(np.angle(turns.mean()) / (2.0 * math.pi))


def commanded_lift(goals: Goals, robot: Robot, t_s: Floats) -> NDArray[np.bool_]:
    """Whether every commanded foot is in swing, shape (instants, legs)."""
    legs = Legs.of(robot)
    if not len(t_s):
        return np.empty((0, len(legs.names)), bool)
    there = {joint: held_at(goals[joint], t_s) for joint in goals}
    rest = dict.fromkeys(legs.joints, np.zeros(len(t_s)))
    height = feet_m(legs, rest | there)[:, :, 2]
    lifted: NDArray[np.bool_] = height - np.quantile(height, STANCE_QUANTILE, axis=0) > LIFTED_M
    return lifted


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Which bin and which turn every sample of one joint lies in; ``-1`` in none.

    ``t_s`` (bins,) is the time that stands for each bin: phase times period, or the window's
    middle. Turns are cycles, or within windows of time halves, so that scatter can be told.
    """

    bin: Ints
    turn: Ints
    t_s: Floats
    turns: int

    @classmethod
    def of_phase(cls, phase: Phase, sample_s: Floats) -> Bins:
        """Bins of gait phase."""
        cycles = phase.at(sample_s)
        known = ~np.isnan(cycles)
        whole = np.floor(np.where(known, cycles, 0.0))
        part = np.where(known, (cycles - whole) * BINS, -1.0)
        first = whole[known].min() if known.any() else 0.0
        turn = np.where(known, whole - first, -1).astype(np.intp)
        centres = (np.arange(BINS, dtype=np.float64) + 0.5) / BINS * phase.period_s
        return cls(np.floor(part).astype(np.intp), turn, centres, int(turn.max(initial=-1)) + 1)

    @classmethod
    def of_time(cls, sample_s: Floats, from_s: float) -> Bins:
        """Windows of time since ``from_s``."""
        since = (sample_s - from_s) / WINDOW_S
        index = np.where(since >= 0.0, np.floor(since), -1).astype(np.intp)
        turn = np.where(index >= 0, np.floor(2.0 * (since - index)), -1).astype(np.intp)
        count = int(index.max(initial=-1)) + 1
        middles = (np.arange(count, dtype=np.float64) + 0.5) * WINDOW_S + from_s
        return cls(index, turn, middles, 2)

    def within(self, sample_s: Floats, span: tuple[float, float]) -> Bins:
        """The same bins with only the samples within a span of time."""
        inside = (sample_s >= span[0]) & (sample_s <= span[1])
        return replace(self, bin=np.where(inside, self.bin, -1))

    @property
    def counts(self) -> Ints:
        """Samples in each bin, shape (bins,)."""
        found: Ints = np.bincount(self.bin[self.bin >= 0], minlength=len(self.t_s))
        return found

    def mean(self, value: Floats) -> Floats:
        """Mean of samples in each bin, shape (bins,); NaN in an empty one."""
        there = self.bin >= 0
        sums = np.bincount(self.bin[there], value[there], len(self.t_s))
        counts = self.counts
        return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)

    def scatter(self, value: Floats) -> Floats:
        """Variance of the mean of each bin from the spread between turns, shape (bins,).

        Neighbouring bins share their spread, as few turns tell little of it.
        """
        there = self.bin >= 0
        if not there.any():
            return np.zeros(len(self.t_s))
        size = (self.turns, len(self.t_s))
        flat = self.turn[there] * size[1] + self.bin[there]
        counts = np.bincount(flat, minlength=size[0] * size[1]).reshape(size)
        sums = np.bincount(flat, value[there], size[0] * size[1]).reshape(size)
        full = counts > 0
        each = np.where(full, sums / np.maximum(counts, 1), 0.0)
        turns = full.sum(axis=0)
        middle = each.sum(axis=0) / np.maximum(turns, 1)
        squares = (np.where(full, each - middle, 0.0) ** 2).sum(axis=0)
        spare = np.maximum(turns - 1, 0)
        pooled = around(squares, NEIGHBOURS) / np.maximum(around(spare, NEIGHBOURS), 1)
        variance: Floats = pooled / np.maximum(turns, 1)
        return variance


def around(value: Floats | Ints, each: int) -> Floats:
    """Sums of each bin and its neighbours, so many at ``each`` side; none is beyond the ends."""
    found: Floats = np.convolve(np.pad(value, each), np.ones(2 * each + 1), "valid")
    return found
