"""What a walk with a candidate gait was like, and whether it is allowed."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from ..experiments.locomotion_result import TORQUE_LIMIT
from .candidate import Candidate


class Reason(enum.Enum):
    """Why a gait is not allowed; the graver first."""

    FALL = "fall"
    SELF_COLLISION = "self-collision"
    TORQUE = "torque"


@dataclass(frozen=True, slots=True)
class Job:
    """A walk to be made: ``seconds`` [s] after standing up, from the start state of ``seed``."""

    candidate: Candidate
    seconds: float
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished walk. Torques as shares of the stall torque of the data sheet."""

    job: Job
    speed_m_s: float  #: as the crow flies, over whole steps after the start-up; 0 after a fall
    distance_m: float  #: as the crow flies, over all of the walk
    turned_rad: float
    energy_j: float  #: that the servos took from the supply, over all of the walk
    torque_of_stall: float  #: the largest of any joint, from its position error
    torque_joint: str  #: whose it was
    true_torque_of_stall: float  #: the largest in the gears, as the emulator has it
    self_collision_share: float  #: of the time in which links touch each other
    self_collisions: int  #: how often links began to touch
    fell_after_s: float  #: since the first step; NaN if it did not fall
    clipped_goals: int
    missed_deadlines: int
    torque_limit: float = TORQUE_LIMIT  #: that it is judged by, as ``torque_of_stall``

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """What forbids it, the gravest first; empty if it is allowed."""
        found = {
            Reason.FALL: not math.isnan(self.fell_after_s),
            Reason.SELF_COLLISION: self.self_collisions > 0 or self.self_collision_share > 0.0,
            Reason.TORQUE: not self.torque_of_stall < self.torque_limit,
        }
        return tuple(reason for reason, holds in found.items() if holds)

    @property
    def allowed(self) -> bool:
        """Whether it kept every rule."""
        return not self.reasons

    @property
    def violation(self) -> float:
        """How far it is from being allowed: 0 if it is, more the longer and the more it is not."""
        total = max(0.0, self.torque_of_stall / self.torque_limit - 1.0) + self.self_collision_share
        if not math.isnan(self.fell_after_s):
            total += 2.0 - self.fell_after_s / self.job.seconds
        return total or (0.0 if self.allowed else 1e-9)

    @property
    def rank(self) -> float:
        """The less, the better: every allowed walk before every forbidden one.

        Allowed ones by their speed, forbidden ones by their violation (K. Deb, Comput. Methods
        Appl. Mech. Engrg. 186 (2000) 311-338).
        """
        return -self.speed_m_s if self.allowed else self.violation

    @property
    def torque_margin(self) -> float:
        """What is left to the limit, as a share of it."""
        return 1.0 - self.torque_of_stall / self.torque_limit

    @property
    def stride_m(self) -> float:
        """How far the body goes in a stance [m], by its speed."""
        return self.speed_m_s * self.job.candidate.period_s * self.job.candidate.duty_factor

    @property
    def energy_j_m(self) -> float:
        """Energy for a metre of way [J/m]; infinite if it got nowhere."""
        return self.energy_j / self.distance_m if self.distance_m > 0.0 else math.inf


def best(outcomes: list[Outcome]) -> Outcome | None:
    """The fastest allowed walk, the first of equals."""
    allowed = [outcome for outcome in outcomes if outcome.allowed]
    return min(allowed, key=lambda outcome: outcome.rank, default=None)
