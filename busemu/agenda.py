"""What is to happen on a bus, and when: events in the order of their instants.

Events of one instant happen in the order in which they were put down.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

#: Something that happens; it is told the instant [s].
Event = Callable[[float], object]


class Agenda:
    """Events to come."""

    def __init__(self) -> None:
        self._events: list[tuple[float, int, Event]] = []
        self._order = itertools.count()

    def __len__(self) -> int:
        """How many events are to come."""
        return len(self._events)

    def put(self, at_s: float, event: Event) -> None:
        """Have ``event`` happen at ``at_s`` [s]."""
        heapq.heappush(self._events, (at_s, next(self._order), event))

    def every(self, from_s: float, period_s: float, event: Event) -> None:
        """Have ``event`` happen at ``from_s`` and then every ``period_s``, without an end [s]."""

        def recur(now_s: float) -> None:
            event(now_s)
            self.put(now_s + period_s, recur)

        self.put(from_s, recur)

    def next_s(self) -> float:
        """The instant of the next event [s]. Raises ``IndexError`` if nothing is to come."""
        return self._events[0][0]

    def take(self, by_s: float) -> tuple[float, Event] | None:
        """Take the next event off the agenda, if it is due by ``by_s`` [s]: its instant and it."""
        if not self._events or self._events[0][0] > by_s:
            return None
        at_s, _, event = heapq.heappop(self._events)
        return at_s, event
