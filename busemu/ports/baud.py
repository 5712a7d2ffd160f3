"""Baud rates of a terminal as plain numbers: any rate, not only those POSIX has a name for.

Linux only (``termios2``). Source: asm-generic/ioctls.h and asm-generic/termbits.h, which x86, ARM
and RISC-V share.
"""

from __future__ import annotations

import fcntl
import struct

_TCGETS2 = 0x802C542A
_TCSETSW2 = 0x402C542C  #: set when all that was written is out
_TERMIOS2 = struct.Struct("4IB19B2I")
_CONTROL_FLAGS, _INPUT_SPEED, _OUTPUT_SPEED = 2, -2, -1
_CBAUD, _CIBAUD, _BOTHER = 0o010017, 0o02003600000, 0o010000


def get_baud_rate(descriptor: int) -> int:
    """The output baud rate of a terminal [bit/s]. Raises ``OSError``."""
    return int(_get(descriptor)[_OUTPUT_SPEED])


def set_baud_rate(descriptor: int, baud_rate: int) -> int:
    """Set both rates of a terminal [bit/s], after all that was written is out.

    Returns the rate that the driver has really set. Raises ``OSError`` where it refuses.
    """
    values = _get(descriptor)
    values[_CONTROL_FLAGS] = values[_CONTROL_FLAGS] & ~(_CBAUD | _CIBAUD) | _BOTHER
    values[_INPUT_SPEED] = values[_OUTPUT_SPEED] = baud_rate
    fcntl.ioctl(descriptor, _TCSETSW2, _TERMIOS2.pack(*values))
    return get_baud_rate(descriptor)


def _get(descriptor: int) -> list[int]:
    return list(_TERMIOS2.unpack(fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))))
