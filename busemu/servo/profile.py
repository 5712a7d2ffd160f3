"""The motion that a position profile plans: step, rectangle, triangle or trapezoid of velocity.

Everything is in counts of the position register and in seconds of the bus's clock. Source:
e-manual, "What is the Profile".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)


@dataclass(frozen=True, slots=True)
class Profile:
    """A planned way from ``start`` to ``goal`` that begins at ``start_s``.

    ``velocity`` (always positive) is its highest [counts/s], ``acceleration`` [counts/s2] that of
    both ramps; either may be infinite, and then the goal jumps or there are no ramps.
    """

    start: float
    goal: float
    start_s: float
    velocity: float = math.inf
    acceleration: float = math.inf
    kind: int = STEP

    @property
    def ramp_s(self) -> float:
        """How long each ramp lasts [s]."""
        return 0.0 if math.isinf(self.acceleration) else self.velocity / self.acceleration

    @property
    def end_s(self) -> float:
        """When the goal is reached."""
        if self.kind == STEP:
            return self.start_s
        return self.start_s + abs(self.goal - self.start) / self.velocity + self.ramp_s

    def at(self, now_s: float) -> tuple[float, float]:
        """Position [counts] and velocity [counts/s] planned for an instant."""
        if now_s >= self.end_s:
            return self.goal, 0.0
        since_s = max(0.0, now_s - self.start_s)
        left_s = self.end_s - now_s
        sign = math.copysign(1.0, self.goal - self.start)
        if since_s < self.ramp_s:
            speed = self.acceleration * since_s
            way = 0.5 * speed * since_s
        elif left_s < self.ramp_s:
            speed = self.acceleration * left_s
            way = abs(self.goal - self.start) - 0.5 * speed * left_s
        else:
            speed = self.velocity
            way = self.velocity * (since_s - 0.5 * self.ramp_s)
        return self.start + sign * way, sign * speed


def by_velocity(
    start: float, goal: float, start_s: float, velocity: float, acceleration: float
) -> Profile:
    """A profile limited in velocity and acceleration; 0 is no limit (velocity-based profile)."""
    distance = abs(goal - start)
    if velocity <= 0.0 or distance == 0.0:
        return Profile(start, goal, start_s)
    if acceleration <= 0.0:
        return Profile(start, goal, start_s, velocity, math.inf, RECTANGULAR)
    peak = math.sqrt(distance * acceleration)
    if peak < velocity:
        return Profile(start, goal, start_s, peak, acceleration, TRIANGULAR)
    return Profile(start, goal, start_s, velocity, acceleration, TRAPEZOIDAL)


def by_time(start: float, goal: float, start_s: float, whole_s: float, ramp_s: float) -> Profile:
    """A profile that lasts ``whole_s``, with ramps of ``ramp_s`` (time-based profile).

    A time of 0 is no limit. A ramp is at most half of the whole.
    """
    distance = abs(goal - start)
    if whole_s <= 0.0 or distance == 0.0:
        return Profile(start, goal, start_s)
    ramp_s = min(ramp_s, 0.5 * whole_s)
    velocity = distance / (whole_s - ramp_s)
    if ramp_s <= 0.0:
        return Profile(start, goal, start_s, velocity, math.inf, RECTANGULAR)
    kind = TRIANGULAR if 2.0 * ramp_s >= whole_s else TRAPEZOIDAL
    return Profile(start, goal, start_s, velocity, velocity / ramp_s, kind)
