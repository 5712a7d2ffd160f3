"""A trace of a bus being served: what `busemu serve --trace FILE` adds to port, bus and loop."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from ..bus import Bus
from ..ports.port import Port
from ..tables import Robot
from ..trace import WireEvent
from .traceline import Header, TraceError
from .wirelog import WireLog


class Tracing:
    """Writes a trace of one served bus, or stops doing so where the disk takes no more.

    The bus is served on all the same: one line on the error stream tells of it.
    """

    def __init__(self, path: Path, size_mb: float, robot: Robot, timing: str) -> None:
        """Open the file; `size_mb` is for FILE and FILE.1 together.

        Raises :class:`TraceError` with one line for the user.
        """
        now_s, wall_s = time.monotonic(), time.time()
        file = str(robot.path.absolute() if robot.path.is_file() else robot.path)
        header = Header(robot.name, robot.protocol, robot.baud_rate, timing, now_s, wall_s, file)
        self.log = WireLog(path, header, round(size_mb * 1e6))
        self._stopped = False

    def join(self, bus: Bus) -> None:
        """Be told of what goes over the wire, besides whoever is told already."""
        before, note = bus.on_wire, self.log.on_wire

        def both(event: WireEvent) -> None:
            note(event)
            if before is not None:
                before(event)

        bus.on_wire = note if before is None else both

    def idle(self, now_s: float) -> None:
        """Write a little; to be called when nothing else is to be done, at `now_s` [s]."""
        if not self.log or self._stopped:
            return
        try:
            self.log.flush(now_s)
        except TraceError as error:
            self._stop(error)

    def close(self) -> None:
        """Write what is left."""
        if not self._stopped:
            try:
                self.log.close()
            except TraceError as error:
                self._stop(error)

    def _stop(self, error: TraceError) -> None:
        self._stopped = True
        sys.stderr.write(f"busemu: {error}; the trace ends here, the bus goes on\n")


class TracedPort:
    """A port that tells a trace when bytes were really taken from it and given to it."""

    def __init__(self, port: Port, log: WireLog) -> None:
        self.path = port.path
        self.fileno = port.fileno
        self.wait = port.wait
        self.baud_rate = port.baud_rate
        self.unlock = port.unlock
        self.close = port.close
        self._port = port
        self._log = log

    def read(self) -> bytes:
        """The bytes that have come; empty where there are none."""
        data = self._port.read()
        self._log.heard(data, time.monotonic())
        return data

    def write(self, data: bytes) -> None:
        """Give bytes to the client."""
        self._port.write(data)
        if data:
            self._log.handed(data, time.monotonic())
