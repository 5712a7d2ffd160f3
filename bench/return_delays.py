"""Trying a bus at other return delays, and putting back what was there, whatever happens.

``return_delay_time`` lies in the servos' EEPROM: a change outlives the power. So it is changed only
where it differs, and put back on every way out, Ctrl-C and a terminal that is closed included.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from busemu.cli import endings
from busemu.clock import Clock
from hal.bus_client import BusClient
from hal.bus_errors import BusError

from .probes import Probe, Prober, Timing

REGISTER = "return_delay_time"
#: Return delays to try, in units of 2 us: none, and the factory's. Source: e-manual.
TRIED = (0, 250)
#: After a write to EEPROM a servo is deaf for about so long [s]. Source: Xevelabs, the AX-12: 6 ms
#: a byte measured, 9 ms by the datasheet of its memory; rounded up.
EEPROM_S = 0.02
#: How often a write that fails is tried again before it is given up.
TRIES = 3


class ReturnDelayError(RuntimeError):
    """Return delays that may not be changed or could not be put back: says what to do."""


class ReturnDelays:
    """The return delays of the servos ``ids``: as they were ``found``, and as they are set to."""

    def __init__(self, client: BusClient, ids: list[int], clock: Clock) -> None:
        self._client = client
        self._ids = ids
        self._clock = clock
        self.found = {servo_id: client.read(servo_id, REGISTER) for servo_id in ids}

    def set(self, raw: int) -> None:
        """Set the return delay of all servos, in units of 2 us.

        Raises :class:`ReturnDelayError` where a servo's torque is on: then its EEPROM is locked.
        """
        held = [i for i in self._ids if self._client.read(i, "torque_enable")]
        if held:
            raise ReturnDelayError(
                f"torque is on at servo {', '.join(map(str, held))}: rest the robot, switch the "
                "torque off and try again, or leave the return delays as they are"
            )
        for servo_id in self._ids:
            self._put(servo_id, raw)

    def restore(self) -> None:
        """Put back what was found, at every servo that can be reached.

        Raises :class:`ReturnDelayError` with the servos that could not, and their values.
        """
        failed = {}
        for servo_id, raw in self.found.items():
            try:
                self._put(servo_id, raw)
            except BusError:
                failed[servo_id] = raw
        if failed:
            left = ", ".join(f"{raw} at servo {servo_id}" for servo_id, raw in failed.items())
            raise ReturnDelayError(f"{REGISTER} could not be put back; set it by hand: {left}")

    def _put(self, servo_id: int, raw: int) -> None:
        for attempt in range(TRIES):
            try:
                if self._client.read(servo_id, REGISTER) == raw:
                    return
                self._client.write(servo_id, REGISTER, raw)
            except BusError:
                if attempt == TRIES - 1:
                    raise
            self._clock.sleep_until(self._clock.now_s() + EEPROM_S)
        if self._client.read(servo_id, REGISTER) != raw:
            raise BusError(f"servo {servo_id} does not keep {REGISTER} = {raw}")


def time_at_each(
    prober: Prober,
    probes: Sequence[Probe],
    repeats: int,
    progress: Callable[[], None] | None = None,
) -> list[Timing]:
    """Time ``probes`` at each of the return delays :data:`TRIED`; what was there is put back.

    Raises :class:`hal.bus_errors.BusError` or :class:`ReturnDelayError`.
    """
    timings = []
    with varied(prober.client, prober.ids, prober.clock) as delays:
        for raw in TRIED:
            delays.set(raw)
            timings += prober.time(probes, repeats, progress)
    return timings


@contextmanager
def varied(client: BusClient, ids: list[int], clock: Clock) -> Iterator[ReturnDelays]:
    """Return delays that may be set within the block and are put back at its end.

    Signals that end a program wait while the return delays are put back.
    """
    delays = ReturnDelays(client, ids, clock)
    try:
        yield delays
    finally:
        with _unheard():
            delays.restore()


@contextmanager
def _unheard() -> Iterator[None]:
    """Ignore signals that end a program; only the main thread can say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {ending: signal.signal(ending, signal.SIG_IGN) for ending in endings()}
    try:
        yield
    finally:
        for ending, was in before.items():
            signal.signal(ending, was)
