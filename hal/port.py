"""The port as the SDK sees it, with the instants of its last write and its last read kept.

The SDK touches bytes and time only through its port object, so the instants a recording needs are
taken here, and the SDK's packet handlers stay as they are.
"""

from __future__ import annotations

from typing import Any, Protocol

from .clock import Clock


class Port(Protocol):
    """What the SDK's packet handlers ask of a port: the interface of its ``PortHandler``.

    Lengths are in bytes, timeouts in ms. ``readPort`` may return fewer bytes than asked, or none.
    """

    is_open: bool
    is_using: bool

    def openPort(self) -> bool: ...  # noqa: D102, N802
    def closePort(self) -> None: ...  # noqa: D102, N802
    def clearPort(self) -> None: ...  # noqa: D102, N802
    def readPort(self, length: int) -> Any: ...  # noqa: D102, N802
    def writePort(self, packet: Any) -> int: ...  # noqa: D102, N802
    def setPacketTimeout(self, packet_length: int) -> None: ...  # noqa: D102, N802
    def setPacketTimeoutMillis(self, msec: float) -> None: ...  # noqa: D102, N802
    def isPacketTimeout(self) -> bool: ...  # noqa: D102, N802
    def getBaudRate(self) -> int: ...  # noqa: D102, N802
    def setBaudRate(self, baudrate: int) -> bool: ...  # noqa: D102, N802


class StampedPort:
    """A port that hands everything on, and remembers when bytes last went out and came in.

    ``sent_s`` is read right after ``writePort`` returned, ``received_s`` right after the last
    ``readPort`` that returned bytes. ``sent`` counts packets out, ``received`` bytes in.
    """

    def __init__(self, port: Port, clock: Clock) -> None:
        self._port = port
        self._now_s = clock.now_s
        self._read = port.readPort
        self._write = port.writePort
        self.sent_s = float("nan")
        self.received_s = float("nan")
        self.sent = 0
        self.received = 0
        # The SDK spins on these: bound once, they cost no second call.
        self.clearPort = port.clearPort
        self.setPacketTimeout = port.setPacketTimeout
        self.setPacketTimeoutMillis = port.setPacketTimeoutMillis
        self.isPacketTimeout = port.isPacketTimeout
        self.getBaudRate = port.getBaudRate

    @property
    def is_using(self) -> bool:
        """The SDK's mark that a transaction is under way."""
        return self._port.is_using

    @is_using.setter
    def is_using(self, using: bool) -> None:
        self._port.is_using = using

    def readPort(self, length: int) -> Any:  # noqa: N802
        """Up to ``length`` bytes that have come in, and the instant if there are any."""
        data = self._read(length)
        if data:
            self.received_s = self._now_s()
            self.received += len(data)
        return data

    def writePort(self, packet: Any) -> int:  # noqa: N802
        """Send, then take the instant."""
        written = self._write(packet)
        self.sent_s = self._now_s()
        self.sent += 1
        return written
