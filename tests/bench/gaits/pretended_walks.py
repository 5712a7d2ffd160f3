"""A walk that costs nothing: a made-up robot whose rules can be solved on paper."""

from __future__ import annotations

import math
import os
from pathlib import Path

from bench.gaits.candidate import Candidate
from bench.gaits.outcome import Job, Outcome
from busemu.tables import load_robot

MARVIN = load_robot("marvin")
ORIGINAL = Candidate.original(MARVIN)
STRIDE_M = 0.025
TOUCHING = 5.0  #: strides from which legs touch
TIPPING = 0.8  #: s; gaits quicker than this fall


def torque(candidate: Candidate) -> float:
    """Of the stall torque: more for long and for quick strides."""
    return 0.4 + 0.04 * (candidate.stride - 1.0) * (ORIGINAL.period_s / candidate.period_s) ** 1.5


def outcome(job: Job, **changed: object) -> Outcome:
    """What the made-up robot does."""
    c = job.candidate
    unequal = abs(c.v_right - c.v_left) / (c.v_right + c.v_left)
    speed = STRIDE_M * c.stride / (c.period_s * c.duty_factor) * (1.0 - 4.0 * unequal**2)
    over = max(0.0, 0.1 * (max(c.v_left, c.v_right) - TOUCHING))
    fell = c.period_s < TIPPING
    found: dict[str, object] = {
        "job": job,
        "speed_m_s": 0.0 if fell else max(0.0, speed),
        "distance_m": max(0.0, speed) * job.seconds,
        "turned_rad": unequal,
        "energy_j": 10.0 * job.seconds,
        "torque_of_stall": torque(c),
        "torque_joint": "leg1.femur",
        "true_torque_of_stall": torque(c),
        "self_collision_share": min(1.0, over),
        "self_collisions": int(over > 0.0),
        "fell_after_s": 1.0 if fell else math.nan,
        "clipped_goals": 0,
        "missed_deadlines": 0,
    }
    return Outcome(**(found | changed))  # type: ignore[arg-type]


class Pretended:
    """The made-up robot as a walk; counts its walks, in every process, by lines of a file."""

    def __init__(self, log: Path) -> None:
        self.log = log

    def __call__(self, job: Job, check) -> Outcome:
        check()
        with self.log.open("a") as file:
            file.write(f"{os.getpid()}\n")
        return outcome(job)

    @property
    def walked(self) -> list[int]:
        """The process of every walk."""
        return [int(line) for line in self.log.read_text().split()] if self.log.exists() else []
