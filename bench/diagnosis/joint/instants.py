"""When a register that is renewed in a period of its own was made, from when it was seen changed.

A value is made between the read that first shows it and the one before. All are made a whole number
of periods apart, so that few of these spans leave little room for the rest. Goals arrive and reads
are made in step with that period, often: then a span of some milliseconds in the same place each
time is no noise but looks like a delay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot

from ..observed import Channel, Observed

Floats = NDArray[np.float64]

FEWEST = 10  #: changes that are needed
FITTING = 0.9  #: share of the spans that must hold a multiple of the period
SPREAD = 0.03  #: by how much a period may be off; that of the AX-12A is a measured one
FINE_S = 0.0005  #: by how much two periods that are tried differ at the end of the spans
FIRST, MORE = 128, 4  #: spans that are gone through first, and how many times as many after that
EVERY_S = 0.005  #: between two looks at a current that a voltage is due to; assumed
AT_ONCE = 1_000_000  #: edges of spans that are sorted at once


def located(
    observed: Observed, channel: Channel, period_s: float | None
) -> tuple[Observed, float | None]:
    """A recording with a channel's values at the instants they were made, and how sure that is [s].

    The recording as it is, and ``None``, where no such period is seen.
    """
    samples = observed.channels.get(channel)
    if samples is None or not period_s:
        return observed, None
    new = 1 + np.flatnonzero(np.diff(samples.value) != 0.0)
    spans = samples.t_s[new - 1], samples.t_s[new]
    if len(new) < FEWEST or float(np.median(spans[1] - spans[0])) >= period_s / 2.0:
        return observed, None
    every_s, phase_s, off_s, share = lattice(*spans, period_s)
    if share < FITTING:
        return observed, None
    made_s = phase_s + every_s * np.ceil((spans[0] - phase_s) / every_s - 1e-9)
    told = made_s <= spans[1] + 1e-9
    new, made_s = new[told], made_s[told]
    made = replace(samples, t_s=made_s, value=samples.value[new], good=samples.good[new])
    channels = {**observed.channels, channel: made}
    return _also_at(replace(observed, channels=channels), made_s), off_s


def looked_back(observed: Observed) -> Observed:
    """A recording whose replay shows what currents did before each voltage that is seldom told."""
    samples = observed.channels.get(Channel.VOLTAGE)
    if samples is None or not observed.seldom:
        return observed
    back_s = np.arange(0.0, observed.stale_s, EVERY_S)[1:]
    moments = (samples.t_s[:, None] - back_s).ravel()
    return _also_at(observed, moments[moments > 0.0])


def _also_at(observed: Observed, moments_s: Floats) -> Observed:
    """A recording whose replay is sampled at some instants more."""
    moments = np.union1d(observed.replay.samples, moments_s)
    channels = {
        channel: replace(one, index=np.searchsorted(moments, one.t_s))
        for channel, one in observed.channels.items()
    }
    replay = replace(observed.replay, samples=moments)
    return replace(observed, replay=replay, channels=channels)


def lattice(first_s: Floats, last_s: Floats, period_s: float) -> tuple[float, float, float, float]:
    """Period and phase [s] that most spans hold a multiple of, how sure that is, and their share.

    Of those that are as good the one with the most room, which is in the middle of it. Spans of a
    long recording are gone through a few at first, and more of them about the best period of those.
    """
    every, spread, count = period_s, SPREAD * period_s, FIRST
    while True:
        first, last = first_s[:count], last_s[:count]
        turns = max(float(last[-1] - first[0]) / period_s, 1.0)
        tried = every + np.linspace(-spread, spread, 2 * int(np.ceil(spread * turns / FINE_S)) + 1)
        parts = np.array_split(tried, np.ceil(4 * len(first) * len(tried) / AT_ONCE))
        held, half, every, phase = max(_best(first, last, part) for part in parts)
        if count >= len(first_s):
            return every, phase, half, held / len(first_s)
        spread = period_s / turns  # by more, and the last of these spans were a period off
        count *= MORE


def _best(first_s: Floats, last_s: Floats, periods_s: Floats) -> tuple[int, float, float, float]:
    """How many spans hold a multiple, half the room [s] that leaves, the period [s], the phase."""
    periods = periods_s[:, None]
    begin = first_s % periods
    end = begin + np.minimum(last_s - first_s, periods)
    # spans on a circle, written out over two turns; what holds is counted at every edge
    edges = np.concatenate([begin, begin + periods, end, end + periods], axis=1)
    opens = np.concatenate([np.ones(2 * len(first_s)), -np.ones(2 * len(first_s))])
    order = np.argsort(edges, axis=1, kind="stable")
    held = np.cumsum(opens[order], axis=1)
    edges = np.take_along_axis(edges, order, axis=1)
    room = np.diff(edges, axis=1) * (held[:, :-1] == held.max())
    row, place = np.unravel_index(int(np.argmax(room)), room.shape)
    half = 0.5 * float(room[row, place])
    every = float(periods[row, 0])
    return int(held.max()), half, every, float(edges[row, place] + half) % every


def believed_refresh_s(robot: Robot, joint: str) -> float:
    """The period in which a servo's load register is renewed by its file [s], 0 where always."""
    table = robot.tables[robot.by_joint[joint].servo_id]
    return float(table.drive.get("load_refresh_s", 0.0))
