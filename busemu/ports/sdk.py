"""An in-process port for the official Python SDK, in virtual time.

The SDK's packet handlers touch time only through their port object, so with this one, unmodified,
they run as fast as the machine can and every run is the same to the bit::

    clock = VirtualClock()
    port = SdkPort(assemble(robot, plant, profile), clock)
    Protocol2PacketHandler().read2ByteTxRx(port, 1, 37)     # clock.now_s() has moved by 3 ms
"""

from __future__ import annotations

import errno
import os
import termios

from ..bus import Bus
from ..clock import VirtualClock

#: What the SDK adds to each timeout [ms]: twice its LATENCY_TIMER, and two. Source: its behaviour.
SDK_MARGIN_MS = 34.0


class SdkPort:
    """Stands where ``dynamixel_sdk.PortHandler`` stands; the attribute names are the SDK's."""

    def __init__(self, bus: Bus, clock: VirtualClock) -> None:
        self.bus = bus
        self.clock = clock
        self.is_open = True
        self.is_using = False
        self.port_name = "virtual"
        self.packet_start_time = 0.0
        self.packet_timeout = 0.0
        self._waiting = bytearray()
        self._away = False  #: whether the port is unplugged
        self._lost = False  #: whether it was, since it was opened

    def unplug(self) -> None:
        """Let the port be gone: from now on every use fails as it does on a real one."""
        self._away = self._lost = True
        self._waiting.clear()

    def replug(self) -> None:
        """Let the port be there again; the program has to open it anew."""
        self._away = False

    def catch_up(self) -> None:
        """Let happen what is due; what has arrived stays there for the program."""
        self._waiting += self.bus.poll(self.clock.now_s())

    def _open(self) -> bool:
        if self._away:
            raise _serial_error(errno.ENOENT, f"could not open port {self.port_name}")
        if self._lost:
            self._waiting.clear()
        self.is_open, self._lost = True, False
        return True

    # The SDK's names are camelCase; the interface is theirs.
    # ruff: noqa: N802

    def openPort(self) -> bool:
        """Open; fails only while the port is unplugged."""
        return self._open()

    def closePort(self) -> None:
        """Close; what was on its way is lost."""
        self.is_open = False
        self._waiting.clear()

    def setPortName(self, port_name: str) -> None:
        """Rename the port, which changes nothing."""
        self.port_name = port_name

    def getPortName(self) -> str:
        """The port's name."""
        return self.port_name

    def setBaudRate(self, baudrate: int) -> bool:
        """Set the host's baud rate [bit/s]; servos at another one do not hear it.

        As the SDK does it, the port is opened anew.
        """
        self.bus.baud_rate = baudrate
        return self._open()

    def getBaudRate(self) -> int:
        """The host's baud rate [bit/s]."""
        return self.bus.baud_rate

    def clearPort(self) -> None:
        """Throw away what has arrived and was not read."""
        self.bus.poll(self.clock.now_s())
        if self._lost:
            raise termios.error(errno.EIO, os.strerror(errno.EIO))
        self._waiting.clear()

    def getBytesAvailable(self) -> int:
        """Bytes that can be read now."""
        self.catch_up()
        if self._lost:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return len(self._waiting)

    def writePort(self, packet: bytes) -> int:
        """Hand a packet to the bus; takes the host's own time."""
        self.clock.sleep_until(self.clock.now_s() + self.bus.profile.host_out_s)
        data = bytes(packet)
        self.bus.poll(self.clock.now_s())
        if self._lost:
            raise _serial_error(errno.EIO, "write failed")
        self.bus.receive(data, self.clock.now_s())
        return len(data)

    def readPort(self, length: int) -> bytes:
        """Up to ``length`` bytes. With none there, time goes on to the next one or the timeout."""
        if not self._waiting:
            self._wait()
        if self._lost:
            raise _serial_error(errno.EIO, "device disconnected")
        data = bytes(self._waiting[:length])
        del self._waiting[:length]
        return data

    def _wait(self) -> None:
        limit_s = (self.packet_start_time + self.packet_timeout) / 1e3
        bus, clock = self.bus, self.clock
        while True:
            now_s = clock.now_s()
            self._waiting += bus.poll(now_s)
            if self._waiting:
                clock.sleep_until(now_s + bus.profile.host_in_s)
                return
            if self._lost or now_s > limit_s:
                return
            clock.sleep_until(min(bus.next_deadline_s(), limit_s + 1e-6))

    def setPacketTimeout(self, packet_length: int) -> None:
        """Start the SDK's timeout for a reply of so many bytes."""
        byte_ms = 10_000.0 / self.bus.baud_rate
        self.setPacketTimeoutMillis(byte_ms * packet_length + SDK_MARGIN_MS)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start a timeout [ms]."""
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = msec

    def isPacketTimeout(self) -> bool:
        """Whether the timeout has run out."""
        if self.getTimeSinceStart() > self.packet_timeout:
            self.packet_timeout = 0.0
            return True
        return False

    def getCurrentTime(self) -> float:
        """Virtual time [ms]."""
        return self.clock.now_s() * 1e3

    def getTimeSinceStart(self) -> float:
        """Since the timeout was started [ms]."""
        return self.getCurrentTime() - self.packet_start_time


def _serial_error(number: int, words: str) -> OSError:
    """The error that pyserial, on which the SDK's own port stands, raises."""
    from serial import SerialException  # noqa: PLC0415 - who has the SDK has pyserial

    error: OSError = SerialException(number, f"{words}: {os.strerror(number)}")
    return error
