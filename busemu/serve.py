"""One loop between a port and a bus.

It waits for bytes or for the next deadline, and keeps the joints moving in the meantime.
There is one thread and no lock. While a reply is on its way the loop advances the joints in small
slices; just before the reply is due it stops that and spins, so that the reply leaves in time.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from .ports.port import Port

#: Joints are advanced at most so far at once [s], so that arriving bytes are seen soon.
SLICE_S = 0.001
#: So long before a reply is due nothing else is begun [s]: longer than a slice takes to compute.
GUARD_S = 0.0004
#: So long before a reply is due the loop spins instead of sleeping [s]: sleep overshoots by less.
SPIN_S = 0.00015
#: After a reply the loop does nothing but listen for so long [s], without sleeping: a program that
#: reads one servo after another sends its next request now.
NEXT_S = 0.00015
#: Bytes are taken from the port while the line is busy for no longer than this [s]; then they wait
#: in the port, as in the driver of a real one, and a program that writes on is stopped.
BACKLOG_S = 0.005
#: A port that a client has left locked is opened to the next one after so long [s].
UNLOCK_EVERY_S = 0.1
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
class ServerState:
    """How well the server keeps up. Latenesses are of the last while, in seconds."""

    started_s: float
    replies_late_s: deque[float] = field(default_factory=lambda: deque(maxlen=2000))
    physics_late_s: float = (
        0.0  #: how far the joints were behind the clock at worst, since last told
    )


def serve(
    port: Port,
    bus: Line,
    *,
    every_s: float = 5.0,
    tell: Callable[[ServerState], None] | None = None,
    observe_every_s: float = 0.0,
    observe: Callable[[float], None] | None = None,
    idle: Callable[[float], None] | None = None,
) -> None:
    """Serve ``bus`` on ``port`` in wall-clock time, until an exception ends it.

    That is Ctrl-C, or what the port raises when it is lost.

    ``tell`` is called about every ``every_s`` and ``observe`` every ``observe_every_s`` [s], never
    while a reply is due. ``idle`` is called with the time [s] whenever nothing else is to be done,
    and no reply is due within ``GUARD_S``; it has to be quicker than that.
    """
    now_s = time.monotonic()
    state = ServerState(now_s)
    tell_s, observe_s, unlock_s = now_s + every_s, bus.plant_s, now_s
    while True:
        now_s = time.monotonic()
        reply_s = bus.next_reply_s()
        if reply_s is not None and reply_s - now_s < GUARD_S:
            _wait_until(reply_s)
            port.write(bus.deliver(time.monotonic()))
            state.replies_late_s.append(time.monotonic() - reply_s)
            _listen(port, time.monotonic() + NEXT_S)
            now_s = time.monotonic()
        listening = bus.line_free_s - now_s < BACKLOG_S
        if listening and port.wait(0.0):
            bus.baud_rate = port.baud_rate() or bus.baud_rate
            if data := port.read():
                bus.receive(data, now_s)
        behind_s = now_s - bus.plant_s
        until_s = min(now_s, bus.plant_s + SLICE_S)
        port.write(bus.poll(until_s))
        bus.advance_plant(until_s)
        if observe is not None and bus.plant_s >= observe_s:
            observe(bus.plant_s)
            observe_s += observe_every_s
            continue
        if behind_s > SLICE_S:
            state.physics_late_s = max(state.physics_late_s, behind_s)
            continue
        if tell is not None and now_s >= tell_s:
            tell(state)
            state.physics_late_s = 0.0
            tell_s = now_s + every_s
        elif now_s >= unlock_s:
            port.unlock()
            unlock_s = now_s + UNLOCK_EVERY_S
        else:
            reply_s = bus.next_reply_s()
            if idle is not None and (reply_s is None or reply_s - time.monotonic() > GUARD_S):
                idle(now_s)
            due_s = bus.next_deadline_s()
            if bus.next_reply_s() is not None:
                due_s = min(due_s, now_s + GUARD_S)
            idle_s = max(0.0, min(IDLE_S, due_s - time.monotonic()))
            (port.wait if listening else time.sleep)(idle_s)


def _wait_until(instant_s: float) -> None:
    """Sleep for most of the time and spin for the rest, so as not to be late."""
    sleep_s = instant_s - SPIN_S - time.monotonic()
    if sleep_s > 0.0:
        time.sleep(sleep_s)
    while time.monotonic() < instant_s:
        pass


def _listen(port: Port, until_s: float) -> None:
    """Spin until bytes have come, or until ``until_s``."""
    while not port.wait(0.0) and time.monotonic() < until_s:
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
