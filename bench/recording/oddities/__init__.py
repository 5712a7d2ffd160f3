"""What a recording may have and is accepted with, but has to be counted, placed and explained."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ..recording import Recording
from . import access, accuracy, clocks, power, signals, stored, told
from .channel import channels
from .counting import Gap, Oddities, SeriesCount, count_accesses, counted, gaps
from .oddity import Oddity, Weight

__all__ = [
    "Gap",
    "Oddities",
    "Oddity",
    "SeriesCount",
    "Weight",
    "counted",
    "gaps",
    "oddities",
]


def oddities(recording: Recording) -> Oddities:
    """Count what a recording was accepted with, and find what is odd about it, gravest first."""
    counts = count_accesses(recording)
    every = list(_all(recording))
    order = sorted(range(len(every)), key=lambda i: (-every[i].weight, every[i].kind, i))
    return replace(counts, found=tuple(every[i] for i in order))


def _all(recording: Recording) -> Iterable[Oddity]:
    yield from told.check(recording)
    yield from clocks.check(recording)
    yield from power.check(recording)
    yield from stored.check(recording)
    for channel in channels(recording):
        yield from access.check(channel)
        yield from signals.check(channel)
        yield from accuracy.check(channel)
        yield from stored.check_channel(channel)
    yield from access.check_servos(recording)
    yield from signals.check_goals(recording)
