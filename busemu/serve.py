"""One loop between ports and buses.

It waits for bytes or for the next deadline, and keeps the joints moving in the meantime.
There is one thread and no lock, however many buses there are. While a reply is on its way the loop
advances the joints in small slices; just before a reply is due it stops that and spins, so that the
reply leaves in time.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import math
import os
import select
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from .ports.port import Port

#: Joints are advanced at most so far at once [s], so that arriving bytes are seen soon.
SLICE_S = 0.001
#: So long before a reply is due nothing else is begun, if slices take that long to compute [s].
GUARD_S = 0.0004
#: Slices of late count as this much longer than they took, and are forgotten by this share a turn.
SLICE_MARGIN, SLICE_FORGET = 1.5, 0.02
#: So long before a reply is due the loop spins instead of sleeping [s]: sleep overshoots by less.
SPIN_S = 0.00015
#: After a reply the loop does nothing but listen for so long [s], without sleeping: a program that
#: reads one servo after another sends its next request now.
NEXT_S = 0.00015
#: Bytes are taken from the port while the line is busy for no longer than this [s]; then they wait
#: in the port, as in the driver of a real one, and a program that writes on is stopped.
BACKLOG_S = 0.005
#: What can wait is done once in this time [s], also by a server that is behind: a port that a
#: client has left locked is opened to the next one, and requests for faults are answered.
ATTEND_EVERY_S = 0.1
#: With nothing to do the loop sleeps so long at most [s].
IDLE_S = 0.0005

#: How much the server asks to be preferred over other processes; -20 is the most. Assumed.
PRIORITY = -10

_PR_SET_TIMERSLACK = 29


class Line(Protocol):
    """What the loop asks of a bus; times are in s of the monotonic clock. See ``busemu.bus``."""

    baud_rate: int

    @property
    def plant_s(self) -> float: ...  # noqa: D102
    @property
    def line_free_s(self) -> float: ...  # noqa: D102
    def receive(self, data: bytes, now_s: float) -> None: ...  # noqa: D102
    def next_reply_s(self) -> float | None: ...  # noqa: D102
    def next_deadline_s(self) -> float: ...  # noqa: D102
    def poll(self, now_s: float) -> bytes: ...  # noqa: D102
    def deliver(self, now_s: float) -> bytes: ...  # noqa: D102
    def advance_plant(self, to_s: float) -> None: ...  # noqa: D102


@dataclass(slots=True)
class Station:
    """One of the buses of a server, the port its client opens, and what is done beside it.

    ``observe`` is called every ``observe_every_s`` of bus time [s], never while a reply is due.
    ``idle`` is called with the time [s] whenever nothing else is to be done, and every
    ``ATTEND_EVERY_S`` in any case, while no reply of this bus is due within ``GUARD_S``; it has to
    be quicker than that.
    """

    port: Port
    bus: Line
    observe_every_s: float = 0.0
    observe: Callable[[float], None] | None = None
    idle: Callable[[float], None] | None = None
    observe_s: float = field(init=False)  #: when to observe next

    def __post_init__(self) -> None:
        self.observe_s = self.bus.plant_s

    def turn(self, now_s: float) -> float:
        """Take what has come, and let bus and joints go on by one slice at most.

        Returns how far they were behind before [s].
        """
        port, bus = self.port, self.bus
        if bus.line_free_s - now_s < BACKLOG_S and port.wait(0.0):
            bus.baud_rate = port.baud_rate() or bus.baud_rate
            if data := port.read():
                bus.receive(data, now_s)
        behind_s = now_s - bus.plant_s
        until_s = min(now_s, bus.plant_s + SLICE_S)
        port.write(bus.poll(until_s))
        bus.advance_plant(until_s)
        return behind_s


@dataclass(slots=True)
class ServerState:
    """How well the server keeps up. Latenesses are of the last while, in seconds."""

    replies_late_s: deque[float] = field(default_factory=lambda: deque(maxlen=2000))
    physics_late_s: float = (
        0.0  #: how far the joints were behind the clock at worst, since last told
    )


def serve(
    *stations: Station,
    every_s: float = 5.0,
    tell: Callable[[ServerState], None] | None = None,
) -> None:
    """Serve buses in wall-clock time, until an exception ends it.

    That is Ctrl-C, or what a port raises when it is lost. ``tell`` is called about every
    ``every_s`` [s], never while a reply is due.
    """
    now_s = time.monotonic()
    state = ServerState()
    tell_s, attend_s = now_s + every_s, now_s
    slice_s = GUARD_S  # what a slice of any bus costs, on the safe side
    while True:
        now_s = time.monotonic()
        station, reply_s = _next_reply(stations)
        if station is not None and reply_s - now_s < min(GUARD_S, SPIN_S + slice_s):
            _wait_until(reply_s)
            station.port.write(station.bus.deliver(time.monotonic()))
            state.replies_late_s.append(time.monotonic() - reply_s)
            _listen(stations, time.monotonic() + NEXT_S)
            now_s = time.monotonic()
        behind_s = 0.0
        for station in stations:
            begun_s = time.monotonic()
            behind_s = max(behind_s, station.turn(now_s))
            took_s = SLICE_MARGIN * (time.monotonic() - begun_s)
            slice_s = max(took_s, slice_s * (1.0 - SLICE_FORGET))
        if _observed(stations):
            continue
        if behind_s > SLICE_S:
            state.physics_late_s = max(state.physics_late_s, behind_s)
        if tell is not None and now_s >= tell_s:  # also when it is behind for good
            tell(state)
            state.physics_late_s = 0.0
            tell_s = now_s + every_s
        elif now_s >= attend_s:
            for station in stations:
                station.port.unlock()
            _idle(stations, now_s)
            attend_s = now_s + ATTEND_EVERY_S
        elif behind_s <= SLICE_S:
            _idle(stations, now_s)
            _rest(stations, now_s)


def _next_reply(stations: Sequence[Station]) -> tuple[Station | None, float]:
    """The station whose client has the next bytes, and when [s]; ``None`` where nobody has."""
    found, found_s = None, math.inf
    for station in stations:
        reply_s = station.bus.next_reply_s()
        if reply_s is not None and reply_s < found_s:
            found, found_s = station, reply_s
    return found, found_s


def _observed(stations: Sequence[Station]) -> bool:
    """Let the observers whose time has come look, and say whether there was one."""
    found = False
    for station in stations:
        if station.observe is not None and station.bus.plant_s >= station.observe_s:
            station.observe(station.bus.plant_s)
            station.observe_s += station.observe_every_s
            found = True
    return found


def _idle(stations: Sequence[Station], now_s: float) -> None:
    """Do what can wait, for the buses that have no reply to send soon."""
    for station in stations:
        reply_s = station.bus.next_reply_s()
        if station.idle is not None and (reply_s is None or reply_s - time.monotonic() > GUARD_S):
            station.idle(now_s)


def _rest(stations: Sequence[Station], now_s: float) -> None:
    """Sleep until bytes come, or until something is due."""
    due_s = now_s + IDLE_S
    waiting = []
    for station in stations:
        bus = station.bus
        reply_s = bus.next_reply_s()
        due_s = min(due_s, bus.next_deadline_s())
        if reply_s is not None:
            due_s = min(due_s, now_s + GUARD_S)
        if bus.line_free_s - now_s < BACKLOG_S:
            waiting.append(station.port)
    select.select(waiting, [], [], max(0.0, due_s - time.monotonic()))


def _wait_until(instant_s: float) -> None:
    """Sleep for most of the time and spin for the rest, so as not to be late."""
    sleep_s = instant_s - SPIN_S - time.monotonic()
    if sleep_s > 0.0:
        time.sleep(sleep_s)
    while time.monotonic() < instant_s:
        pass


def _listen(stations: Sequence[Station], until_s: float) -> None:
    """Spin until bytes have come, a bus falls behind, or ``until_s``."""
    if len(stations) > 1:
        behind_s = time.monotonic() - min(station.bus.plant_s for station in stations)
        _, reply_s = _next_reply(stations)
        until_s = 0.0 if behind_s > SLICE_S else min(until_s, reply_s - SPIN_S)
    ports = [station.port for station in stations]
    while not select.select(ports, [], [], 0.0)[0] and time.monotonic() < until_s:
        pass


def prepare_process() -> None:
    """Make this process punctual: to be called once all is loaded, before time counts.

    The kernel shall wake it without its usual 50 us of slack and, where it may ask for that, before
    other work; the garbage collector shall not look again at what is there already.
    """
    gc.collect()
    gc.freeze()
    with contextlib.suppress(PermissionError):  # needs root, or a limit that allows it
        os.nice(PRIORITY)
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
