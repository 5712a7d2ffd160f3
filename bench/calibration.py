"""Fitting a timing profile to what was measured on a bus, and saying what the data determine.

The model is the emulator itself: the same transactions, through the same client, in virtual time.
Its times are piecewise linear in the parts of a profile, so a few steps of bounded linear least
squares find the parts. Not every part can be found. Two parts that every transaction passes through
once (the host's time to take a reply, and the kernel's to bring it) enter as their sum only. Which
sums the data determine is read off the model's own derivatives, by row reduction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from busemu.timing import Profile

from .least_squares import FLAT, bounded_least_squares, row_reduced
from .probes import CHUNK_BYTES, Condition, Kind, Probe, Timing, prober_in_process

Floats = NDArray[np.float64]

#: The servo's interrupt enters as its mean wait; the parameter stands for
#: ``interrupt_busy_s ** 2 / (2 * interrupt_period_s)``.
INTERRUPT = "interrupt"
#: What is fitted [s]. Of parts that enter as a sum, the first one here takes the sum up,
#: and the others are left at zero; a latency timer is left at the length that was begun with.
PARTS = (
    "host_out_s",
    "adapter_out_s",
    "turnaround_s",
    "chain_lead_s",
    "wake_s",
    "latency_timer_s",
    INTERRUPT,
    "host_in_s",
    "usb_frame_s",
)
TIMER = PARTS.index("latency_timer_s")
#: An interrupt of the fitted mean is written with this period [s]. Source: Xevelabs, the AX-12's.
INTERRUPT_PERIOD_S = 1e-3
#: Latency timers to begin from [s]; 0 is an adapter that has none.
TIMERS_S = (0.0, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3)
#: The model is taken to be no better than this share of a time. Assumed.
MODEL_ERROR = 0.01
#: Measured times are no finer than this [s]. Assumed: what a host's clock and scheduler allow.
CLOCK_S = 1e-6
#: These are held back from the fit, to see whether it holds for what it has not seen.
HELD_BACK = frozenset({Kind.CYCLE, Kind.WRITE, Kind.READ_EACH})
#: What is taken for a servo's turnaround where the data do not show it [s]. Source: about an
#: AX-12's, Xevelabs.
TURNAROUND_S = 20e-6
#: Step of the numerical derivatives [s], and how many steps of least squares are tried at most.
STEP_S = 1e-6
STEPS = 12
#: A step that changes no part by more than this is the last [s].
DONE_S = 1e-8
#: So many latency timers to begin from are followed to their end.
FINALISTS = 2


class CalibrationError(ValueError):
    """Measurements that no profile can be fitted to: says why and what to do."""


@dataclass(frozen=True, slots=True)
class Sum:
    """A weighted sum of parts that the data determine."""

    terms: tuple[tuple[float, str], ...]
    value_s: float
    error_s: float  #: standard error

    def __str__(self) -> str:
        """The sum in words, with its value."""
        words = ""
        for factor, part in self.terms:
            sign = " - " if factor < 0 else " + "
            scale = "" if math.isclose(abs(factor), 1.0, abs_tol=FLAT) else f"{abs(factor):.3g} "
            words += f"{sign if words else sign.strip(' +')}{scale}{part}"
        return f"{words} = {self.value_s * 1e6:.1f} us (+- {self.error_s * 1e6:.1f})"


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted profile and what is known about it."""

    profile: Profile
    determined: tuple[Sum, ...]  #: parts that the data determine each by itself
    sums: tuple[Sum, ...]  #: what they determine of the others
    unseen: tuple[str, ...]  #: parts that no transaction depends on
    timings: tuple[Timing, ...]
    predicted_s: Floats  #: shape (timings,)

    @property
    def errors(self) -> Floats:
        """(predicted - measured) / measured of each timing, shape (timings,).

        A time that was too short for the clock counts as one tick of it.
        """
        measured_s = np.array([timing.median_s for timing in self.timings])
        return np.asarray((self.predicted_s - measured_s) / np.maximum(measured_s, CLOCK_S))

    def worst(self, *, held_back: bool) -> int | None:
        """Index of the timing with the largest relative error, among those used or held back."""
        among = [
            index
            for index, timing in enumerate(self.timings)
            if (timing.probe.kind in HELD_BACK) is held_back
        ]
        return max(among, key=lambda index: abs(float(self.errors[index])), default=None)


def predict(robot: Robot, profile: Profile, wanted: Sequence[tuple[Probe, Condition]]) -> Floats:
    """Times of the model [s], shape (wanted,)."""
    probes: dict[Condition, list[Probe]] = {}
    for probe, condition in wanted:
        probes.setdefault(condition, []).append(probe)
    times = {
        (timing.probe, condition): timing.median_s
        for condition, those in probes.items()
        for timing in prober_in_process(robot, profile, condition, fixed=True).time(those, 1)
    }
    return np.array([times[pair] for pair in wanted])


def profile_of(parts: Floats, name: str = "fitted", source: str = "") -> Profile:
    """The profile with these values of :data:`PARTS` [s]."""
    values = dict(zip(PARTS, (float(value) for value in parts), strict=True))
    mean_s = min(values.pop(INTERRUPT), INTERRUPT_PERIOD_S / 2)
    profile = Profile(name, source, **values)  # type: ignore[arg-type] # all parts are times
    if mean_s > 0.0:
        busy_s = math.sqrt(2.0 * INTERRUPT_PERIOD_S * mean_s)
        profile = replace(profile, interrupt_period_s=INTERRUPT_PERIOD_S, interrupt_busy_s=busy_s)
    if profile.latency_timer_s > 0.0:
        profile = replace(profile, chunk_bytes=CHUNK_BYTES)
    return profile


def fit(robot: Robot, timings: Sequence[Timing], name: str, source: str) -> Fit:
    """Fit a profile to the medians of ``timings``, without those of kinds :data:`HELD_BACK`.

    Raises :class:`CalibrationError` if too little was measured.
    """
    used = [timing for timing in timings if timing.probe.kind not in HELD_BACK]
    if len(used) < 3:
        raise CalibrationError("too few kinds of transactions to fit a profile to")
    shortest_s = min(t.median_s for t in used if t.probe.kind is not Kind.HAND_OVER)
    problem = _Problem(robot, used)
    starts = [timer_s for timer_s in TIMERS_S if timer_s <= 1.2 * shortest_s]
    tried = sorted((problem.descend(problem.start(s), 1) for s in starts), key=problem.rank)
    finished = [problem.descend(parts, STEPS) for parts in tried[:FINALISTS]]
    parts = min(finished, key=problem.rank)
    slopes = problem.slopes(parts)
    determined, sums, unseen = _identify(parts, slopes / problem.sigma_s[:, None])
    fitted = profile_of(np.round(parts, 8), name, source)
    predicted_s = predict(robot, fitted, [(t.probe, t.condition) for t in timings])
    return Fit(fitted, determined, sums, unseen, tuple(timings), predicted_s)


class _Problem:
    """Bounded least squares of the model's times against the measured medians."""

    def __init__(self, robot: Robot, timings: Sequence[Timing]) -> None:
        self._robot = robot
        self._wanted = [(timing.probe, timing.condition) for timing in timings]
        self._measured_s = np.array([timing.median_s for timing in timings])
        noise_s = np.array([timing.median_error_s for timing in timings])
        self.sigma_s = np.sqrt(noise_s**2 + (MODEL_ERROR * self._measured_s) ** 2 + CLOCK_S**2)

    def times(self, parts: Floats) -> Floats:
        return predict(self._robot, profile_of(parts), self._wanted)

    def residual(self, parts: Floats) -> Floats:
        return np.asarray((self._measured_s - self.times(parts)) / self.sigma_s)

    def cost(self, parts: Floats) -> float:
        return float(np.sum(self.residual(parts) ** 2))

    def rank(self, parts: Floats) -> tuple[float, float]:
        """Sorts by cost; where that says nothing, a longer timer explains a long wait better."""
        return round(self.cost(parts), 3), -float(parts[TIMER])

    def slopes(self, parts: Floats) -> Floats:
        """Derivatives of the times by the parts, shape (timings, parts)."""
        here = self.times(parts)
        columns = []
        for index in range(len(PARTS)):
            moved = parts.copy()
            moved[index] += STEP_S
            if index == TIMER and parts[index] == 0.0:
                columns.append(np.zeros_like(here))  # having a timer at all is another mechanism
            else:
                columns.append((self.times(moved) - here) / STEP_S)
        return np.column_stack(columns)

    def start(self, timer_s: float) -> Floats:
        """Where to begin with a latency timer of ``timer_s`` [s]."""
        parts = np.zeros(len(PARTS))
        parts[TIMER] = timer_s
        parts[PARTS.index("turnaround_s")] = TURNAROUND_S
        return parts

    def descend(self, parts: Floats, steps: int) -> Floats:
        """The parts after at most so many steps of linear least squares, none below zero."""
        cost = self.cost(parts)
        for _ in range(steps):
            slopes = self.slopes(parts) / self.sigma_s[:, None]
            free = [pivot for pivot, _ in row_reduced(slopes)]
            step = np.zeros_like(parts)
            step[free] = bounded_least_squares(slopes[:, free], self.residual(parts), -parts[free])
            if parts[TIMER] and parts[TIMER] + step[TIMER] <= 0.0:
                step[TIMER] = -parts[TIMER] / 2.0  # a timer stays one; none is another start
            length = 1.0
            while (trial := self.cost(parts + length * step)) > cost and length > 1e-3:
                length /= 2.0
            if trial >= cost:
                break
            parts, cost = np.maximum(parts + length * step, 0.0), trial
            if np.abs(length * step).max() < DONE_S:
                break
        return parts


def _identify(
    parts: Floats, weighted: Floats
) -> tuple[tuple[Sum, ...], tuple[Sum, ...], tuple[str, ...]]:
    """What the data determine: single parts, sums of parts, and what they do not see at all.

    ``weighted`` are the derivatives over the standard errors of the times.
    """
    reduced = row_reduced(weighted)
    pivots = [pivot for pivot, _ in reduced]
    spread = np.linalg.pinv(weighted[:, pivots])
    errors_s = np.sqrt(np.sum(spread**2, axis=1))
    single: list[Sum] = []
    several: list[Sum] = []
    for (_, row), error_s in zip(reduced, errors_s, strict=True):
        terms = tuple(
            (float(factor), part)
            for factor, part in zip(row, PARTS, strict=True)
            if abs(factor) > FLAT
        )
        (single if len(terms) == 1 else several).append(
            Sum(terms, float(row @ parts), float(error_s))
        )
    flat = np.abs(weighted).max(axis=0) < FLAT * np.abs(weighted).max(initial=1e-300)
    unseen = tuple(part for part, unmoved in zip(PARTS, flat, strict=True) if unmoved)
    return tuple(single), tuple(several), unseen
