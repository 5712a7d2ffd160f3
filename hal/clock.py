"""The clock the robot's software lives by: given from outside, real or virtual."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """Seconds on a clock that never goes back, and the only way to wait."""

    def now_s(self) -> float:
        """Read the present instant [s]."""

    def sleep_until(self, instant_s: float) -> None:
        """Return at ``instant_s`` [s], or at once if that has passed."""
