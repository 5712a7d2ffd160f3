"""A tap: between an unmodified program and its real adapter, passing on every byte at once.

The program opens a pseudo-terminal instead of the adapter. What it sends goes to the adapter, what
the adapter brings goes to it, and the baud rate it sets is set on the adapter before its bytes go.
Each portion of bytes is kept with the machine's monotonic time.
"""

from __future__ import annotations

import select
import time
from collections import deque
from dataclasses import dataclass

from .baud import set_baud_rate
from .device import DeviceError, DeviceLostError, SerialDevice
from .pty import PtyPort


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that passed a tap in one go.

    ``t_s``: when the adapter's driver had taken them (``from_host``), or when they were taken from
    it [s, monotonic clock].
    """

    t_s: float
    from_host: bool
    data: bytes


class Tap:
    """``port`` for the program, ``device`` behind it; :attr:`passed` is what passed, in order.

    Whoever calls :meth:`turn` takes chunks out of :attr:`passed`. Bytes that the device has no room
    for are kept until it has, and no more are taken from the program until then.
    """

    def __init__(self, port: PtyPort, device: SerialDevice) -> None:
        self.passed: deque[Chunk] = deque()
        self.refused = ""  #: why the device did not take the program's baud rate; empty if it did
        self._port = port
        self._device = device
        self._waiting = b""
        self._baud_rate = device.baud_rate()
        set_baud_rate(port.fileno(), self._baud_rate)  # a program that sets none has this

    def turn(self, timeout_s: float) -> bool:
        """Wait for bytes on either side, up to ``timeout_s`` [s], and pass them on.

        Returns whether there were any. Raises :class:`DeviceLostError`.
        """
        port, device = self._port, self._device
        sources: list[PtyPort | SerialDevice] = [device] if self._waiting else [device, port]
        ready, room, _ = select.select(sources, [device] if self._waiting else [], [], timeout_s)
        if device in ready:  # first, as it may bring the answer to what the program sent before
            data = device.read()
            t_s = time.monotonic()
            port.write(data)
            if data:
                self.passed.append(Chunk(t_s, False, data))
        if port in ready:
            data = port.read()
            if self._adopt_baud_rate():
                self._waiting = data
        if self._waiting and (room or port in ready):
            self._send()
        return bool(ready or room)

    def unlock(self) -> None:
        """Let the next program in, if one before has locked the port."""
        self._port.unlock()

    def _send(self) -> None:
        taken = self._device.send(self._waiting)
        if taken:
            self.passed.append(Chunk(time.monotonic(), True, self._waiting[:taken]))
            self._waiting = self._waiting[taken:]

    def _adopt_baud_rate(self) -> bool:
        """Set the program's baud rate on the device if it is new; whether they are the same."""
        wanted = self._port.baud_rate()
        if wanted and wanted != self._baud_rate:
            self._baud_rate = wanted
            try:
                self._device.set_baud_rate(wanted)
                self.refused = ""
            except DeviceLostError:
                raise
            except DeviceError as error:
                self.refused = str(error)
        return not self.refused
