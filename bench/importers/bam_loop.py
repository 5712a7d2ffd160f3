"""What a log of bam's recorder tells between its lines: when each access came, and what it read.

The recorder computes a goal, writes it, reads, and dates the sample in the middle of its reads. Its
goals follow a formula of the time, so the log itself tells how long before its sample each goal
was computed, and with the loop's period how long the reads took.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from busemu.tables import ControlTable

from .rows import EventColumns, Floats

#: a goal that follows its formula with this delay explains the log if it misses by less [rad]
GOAL_MISFIT_RAD = 2e-3
#: the load is the duty if the controller's law misses it by less than this share of what it says
DUTY_MISFIT = 0.3
#: full duty of the X series [counts]; source: e-manual
FULL_DUTY = 885.0


@dataclass(frozen=True, slots=True)
class Log:
    """Columns of one log, shapes (samples,); ``kp`` is a register's value."""

    trajectory: str
    kp: int | None
    t_s: Floats
    goal_rad: Floats
    position_rad: Floats
    torque_on: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Loop:
    """One turn of the recorder's loop, as times before and about that of the sample [s]."""

    lead_s: float  #: from computing the goal to the middle of the reads
    read_s: float  #: how long the reads took, all together
    told: str  #: how that is known

    def offset_s(self, place: int, count: int) -> float:
        """When the ``place``-th of ``count`` reads began [s], against the sample's time."""
        return self.read_s * (place / count - 0.5)


def _cubic(*knots: tuple[float, float]) -> Callable[[Floats], Floats]:
    """A path through (time, angle) with zero velocity at each knot."""

    def path(t: Floats) -> Floats:
        found = np.full_like(t, knots[-1][1])
        for (t0, a), (t1, b) in itertools.pairwise(knots):
            inside = (t >= t0) & (t < t1)
            share = (t[inside] - t0) / (t1 - t0)
            found[inside] = a + (b - a) * share * share * (3.0 - 2.0 * share)
        return found

    return path


#: formulas of the goals, as the descriptions of the published logs give them
TRAJECTORIES: Mapping[str, Callable[[Floats], Floats]] = MappingProxyType(
    {
        "sin_sin": lambda t: np.sin(t) * np.pi / 2 + 0.5 * np.sin(5 * t) * np.sin(2 * t),
        "sin_time_square": lambda t: np.sin(t * t),
        "up_and_down": _cubic((0.0, 0.0), (3.0, np.pi / 2), (6.0, 0.4 * np.pi)),
        "lift_and_drop": _cubic((0.0, 0.0), (2.0, -np.pi / 2)),
    }
)


def find_loop(log: Log) -> Loop:
    """Find the times within the loop: by the goals' formula, else none of them."""
    on = log.torque_on[1:] & log.torque_on[:-1]
    intervals = np.diff(log.t_s)[on]
    period_s = float(np.median(intervals)) if intervals.size else 0.0
    formula = TRAJECTORIES.get(log.trajectory)
    if formula is not None and period_s > 0.0 and not np.isnan(log.goal_rad).all():
        leads = np.linspace(0.0, period_s, 201)
        misfits = [np.nanmean((formula(log.t_s - lead) - log.goal_rad) ** 2) for lead in leads]
        best = int(np.argmin(misfits))
        if misfits[best] < GOAL_MISFIT_RAD**2:
            lead_s = float(leads[best])
            read_s = min(2.0 * (period_s - lead_s), 2.0 * lead_s)
            return Loop(
                lead_s,
                read_s,
                f"times within a loop: goals {lead_s * 1e3:.2f} ms before their sample, the delay "
                f"at which they follow their formula; so the reads take {read_s * 1e3:.2f} ms "
                "about it, taken for evenly spread in the recorder's order (assumed)",
            )
    return Loop(
        period_s / 2.0,
        0.0,
        "times within a loop are not known: goals half a loop before their sample, all reads at "
        "its time (assumed)",
    )


def load_register(table: ControlTable, log: Log, load: Floats, events: EventColumns) -> str | None:
    """Which register ``load`` is: the duty where it obeys the controller's law, else the current.

    ``None`` for a model that has neither.
    """
    if "present_load" in table:
        return "present_load"
    if "present_pwm" not in table:
        return None
    gain = float(table.drive.get("position_p_gain_duty_per_rad", 0.0))
    if log.kp is None or not gain:
        return "present_pwm"
    duty = np.where(load > 0x7FFF, load - 0x10000, load) / FULL_DUTY
    law = np.clip(gain * log.kp * (log.goal_rad - log.position_rad), -1.0, 1.0)
    known = log.torque_on & ~np.isnan(duty) & ~np.isnan(law)
    if not known.any() or "present_current" not in table:
        return "present_pwm"
    misfit, size = (float(np.sqrt(np.mean(x[known] ** 2))) for x in (law - duty, law))
    if misfit <= DUTY_MISFIT * size:
        return "present_pwm"
    events.note(
        f"load is not the duty: the controller's law says {size:.3f} of full duty (RMS), load read "
        f"as duty misses it by {misfit:.3f}; taken for present_current (assumed)"
    )
    return "present_current"
