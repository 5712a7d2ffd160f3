"""The time a diagnosis may take: when it is used up, what has been found so far is told."""

from __future__ import annotations

import time
from collections.abc import Callable

Say = Callable[[str], None]


class OutOfTimeError(Exception):
    """The time is used up before a stage."""


class Watch:
    """Tells stages, and stops the search at the first one that begins too late.

    It stops once: what is needed to finish is told afterwards like anything else.
    """

    def __init__(
        self,
        say: Say,
        budget_s: float | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._say = say
        self._now_s = now_s
        self._end_s = None if budget_s is None else now_s() + budget_s
        self.stopped: str | None = None  #: the stage before which the time was used up

    def __call__(self, stage: str) -> None:
        """Tell a stage. Raises :class:`OutOfTimeError`, the first time it is too late."""
        if self.stopped is None and self.late:
            self.stopped = stage
            raise OutOfTimeError(stage)
        self.tell(stage)

    @property
    def late(self) -> bool:
        """Whether the time is used up."""
        return self._end_s is not None and self._now_s() >= self._end_s

    def tell(self, stage: str) -> None:
        """Tell a stage that is needed in any case."""
        self._say(stage)

    def of(self, joint: str, left: int) -> Watch:
        """A watch for one joint of ``left`` that are still to do: it says which, and shares fairly.

        What a joint does not use is left for the others.
        """
        own = None if self._end_s is None else (self._end_s - self._now_s()) / left
        return Watch(lambda stage: self._say(f"{joint}: {stage}"), own, self._now_s)
