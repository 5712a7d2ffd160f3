"""Physics that is in no catalogue: the right answer to it is "unexplained"."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from .instant import Act, Instant, Stage


@dataclass(frozen=True, slots=True)
class Cogging:
    """A torque with the period of a tooth: a nick, or magnets that like some places."""

    torque_nm: float
    teeth: int
    phase_rad: float
    stage: ClassVar[Stage] = Stage.LOAD

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            now.load_nm += self.torque_nm * math.sin(self.teeth * now.position_rad + self.phase_rad)

        return act


@dataclass(frozen=True, slots=True)
class Detent:
    """A magnet that holds the arm near one place and lets go further off."""

    torque_nm: float  #: greatest
    at_rad: float
    reach_rad: float
    stage: ClassVar[Stage] = Stage.LOAD

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        top = math.exp(0.5)  # makes the greatest torque of x exp(-x^2/2) one

        def act(now: Instant) -> None:
            x = (now.position_rad - self.at_rad) / self.reach_rad
            now.load_nm -= self.torque_nm * top * x * math.exp(-0.5 * x * x)

        return act


@dataclass(frozen=True, slots=True)
class Bumper:
    """A spring that is touched from one side only."""

    stiffness_nm_rad: float
    from_rad: float
    stage: ClassVar[Stage] = Stage.LOAD

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            into = now.position_rad - self.from_rad
            if into > 0.0:
                now.load_nm -= self.stiffness_nm_rad * into

        return act


@dataclass(frozen=True, slots=True)
class DrySpot:
    """A bearing whose friction depends on the angle."""

    torque_nm: float
    at_rad: float
    width_rad: float
    stage: ClassVar[Stage] = Stage.FRICTION

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            x = (now.position_rad - self.at_rad) / self.width_rad
            now.friction_nm += self.torque_nm * math.exp(-0.5 * x * x)

        return act


@dataclass(frozen=True, slots=True)
class GainSwitching:
    """A firmware that goes between two gains at its own pace."""

    depth: float  #: share of the gain that is missing half of the time
    period_s: float
    stage: ClassVar[Stage] = Stage.DUTY

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            if (now.t_s / self.period_s) % 1.0 < 0.5:
                now.duty *= 1.0 - self.depth

        return act


@dataclass(frozen=True, slots=True)
class Ripple:
    """A supply that swings with the motion: something else on it moves in step."""

    share: float  #: of the voltage
    per_rad: float
    phase_rad: float
    stage: ClassVar[Stage] = Stage.SUPPLY

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            swing = math.sin(self.per_rad * now.position_rad + self.phase_rad)
            now.rail_v *= 1.0 + self.share * swing

        return act


@dataclass(frozen=True, slots=True)
class Sleep:
    """A firmware that misses its control loop now and then: the old duty stays."""

    asleep_s: float
    every_s: float
    stage: ClassVar[Stage] = Stage.LIMIT

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            now.skip_control = now.t_s % self.every_s < self.asleep_s

        return act
