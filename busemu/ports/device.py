"""A real serial port: raw bytes, 8N1, any baud rate the adapter offers. Standard library only.

It is opened as no other program of ours may have it open at the same time, and it is lost for good
when the adapter is unplugged.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import termios
import tty
from array import array

from ..bus import BAUD_TOLERANCE
from .baud import set_baud_rate

#: A driver's settings begin with integers, of which the fifth holds flags; one of them lets it hand
#: bytes up at once (FTDI: latency timer of 1 ms). Source: linux/serial.h, linux/tty_flags.h.
_TIOCGSERIAL, _TIOCSSERIAL = 0x541E, 0x541F
_SETTINGS_INTS, _FLAGS = 32, 4
_ASYNC_LOW_LATENCY = 1 << 13

_GONE = (errno.EIO, errno.ENXIO, errno.ENODEV)


class DeviceError(OSError):
    """A device that cannot be used: says which, why, and what to do."""


class DeviceLostError(DeviceError):
    """A device that was there and has gone."""


class SerialDevice:
    """A serial device at one baud rate [bit/s].

    ``low_latency`` asks the driver to hand bytes up as soon as it can; a driver that cannot is
    left as it is. Raises :class:`DeviceError` where the device is missing, busy, no serial port, or
    does not offer the rate.
    """

    def __init__(self, path: str, baud_rate: int, *, low_latency: bool = False) -> None:
        self.path = path
        self._baud_rate = 0
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise DeviceError(_why_not(path, error)) from None
        try:
            self._take()
            self.set_baud_rate(baud_rate)
            if low_latency:
                self._ask_low_latency()
            termios.tcflush(self._descriptor, termios.TCIOFLUSH)
        except DeviceError:
            os.close(self._descriptor)
            raise
        except (OSError, termios.error) as error:
            os.close(self._descriptor)
            raise DeviceError(_why_not(path, error)) from None

    def _take(self) -> None:
        """Lock it, and switch off all that a terminal does with bytes; one byte wakes a reader."""
        descriptor = self._descriptor
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # what pyserial does, too
        tty.setraw(descriptor, termios.TCSANOW)
        mode = termios.tcgetattr(descriptor)
        mode[2] |= termios.CLOCAL | termios.CREAD
        mode[2] &= ~(termios.CSTOPB | termios.PARENB | termios.CRTSCTS)
        termios.tcsetattr(descriptor, termios.TCSANOW, mode)

    def _ask_low_latency(self) -> None:
        with contextlib.suppress(OSError):
            settings = array("i", [0] * _SETTINGS_INTS)
            fcntl.ioctl(self._descriptor, _TIOCGSERIAL, settings)
            settings[_FLAGS] |= _ASYNC_LOW_LATENCY
            fcntl.ioctl(self._descriptor, _TIOCSSERIAL, settings)

    def fileno(self) -> int:
        """The descriptor to wait on."""
        return self._descriptor

    def baud_rate(self) -> int:
        """The baud rate it was told [bit/s]."""
        return self._baud_rate

    def set_baud_rate(self, baud_rate: int) -> None:
        """Set the baud rate [bit/s] once all written bytes are out.

        Raises :class:`DeviceError` where the adapter does not offer it (it then has another one),
        and :class:`DeviceLostError`.
        """
        try:
            real = set_baud_rate(self._descriptor, baud_rate)
        except OSError as error:
            if error.errno in _GONE:
                raise self._lost() from None
            real = 0
        if not baud_rate or abs(real / baud_rate - 1.0) > BAUD_TOLERANCE:
            raise DeviceError(
                f"{self.path}: the adapter does not offer {baud_rate} baud"
                + (f" (it took {real})" if real else "")
                + ": use a rate that it has, on both sides"
            )
        self._baud_rate = baud_rate

    def wait(self, timeout_s: float) -> bool:
        """Whether bytes have come within ``timeout_s`` [s]."""
        return bool(select.select([self._descriptor], [], [], timeout_s)[0])

    def read(self) -> bytes:
        """The bytes that have come. Raises :class:`DeviceLostError`."""
        try:
            data = os.read(self._descriptor, 4096)
        except BlockingIOError:
            return b""
        except OSError:
            raise self._lost() from None
        if not data:  # a terminal that is there either has bytes or would block
            raise self._lost()
        return data

    def send(self, data: bytes) -> int:
        """Give bytes to the driver; how many it took. Raises :class:`DeviceLostError`."""
        try:
            return os.write(self._descriptor, data)
        except BlockingIOError:
            return 0
        except OSError:
            raise self._lost() from None

    def write(self, data: bytes) -> None:
        """Send all bytes; what the driver has no room for is lost."""
        if data:
            self.send(data)

    def unlock(self) -> None:
        """Nobody else can have locked it."""

    def close(self) -> None:
        """Give the device up."""
        os.close(self._descriptor)

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(f"{self.path}: the device has gone (adapter unplugged?)")


def _why_not(path: str, error: Exception) -> str:
    code = error.args[0] if error.args else None
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return (
            f"{path}: no such device: plug the adapter in, or look in /dev/serial/by-id for its "
            "name"
        )
    if code in (errno.EACCES, errno.EPERM):
        return f"{path}: permission denied: join the group that owns the device (often dialout)"
    if code in (errno.EBUSY, errno.EAGAIN):
        return f"{path}: busy: another program holds the device; close that program"
    if code in (errno.ENOTTY, errno.EISDIR, errno.EINVAL):
        return f"{path}: not a serial port: give the device of the adapter"
    return f"{path}: cannot be opened: {error}"
