"""How a bus comes by what it reads of a robot, where that differs from what one believes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reading:
    """Departures from reading every register fresh, whole and at the believed instant."""

    skew_s: float = 0.0  #: the position shown is of an instant this much later than believed
    load_refresh_s: float = 0.0  #: the load register is made anew in this period, else held
    latency_timer_s: float = 0.0  #: more wait before a reply reaches the host
    lost_share: float = 0.0  #: of the samples are lost or garbage
