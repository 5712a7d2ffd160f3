"""Clocks: the monotonic clock of the machine, and virtual time that jumps.

Nothing in the core reads a clock; ports and programs do, and pass ``now_s`` in.
"""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds on a clock that never goes back, and a way to wait on it."""

    def now_s(self) -> float:
        """The present instant [s]."""

    def sleep_until(self, instant_s: float) -> None:
        """Return at ``instant_s``, or at once if that has passed."""


class MonotonicClock:
    """The machine's monotonic clock: the same for every process on it."""

    def now_s(self) -> float:
        """The present instant [s]."""
        return time.monotonic()

    def sleep_until(self, instant_s: float) -> None:
        """Return at ``instant_s``, or at once if that has passed."""
        remaining_s = instant_s - time.monotonic()
        if remaining_s > 0.0:
            time.sleep(remaining_s)


class VirtualClock:
    """Time that moves only when told to, and only forward."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now_s(self) -> float:
        """The present instant [s]."""
        return self._now_s

    def sleep_until(self, instant_s: float) -> None:
        """Jump to ``instant_s``; an instant in the past changes nothing."""
        self._now_s = max(self._now_s, instant_s)
