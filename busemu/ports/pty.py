"""A virtual serial port: any program that opens a serial device can open this one.

The slave end is held open here as well, so the port outlives its clients. A client's baud rate is
read from the line itself, so one that is set wrongly meets silence, as on a real bus.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import struct
import termios
import tty
from pathlib import Path

#: Linux ioctl: termios with the baud rate as a number. Source: asm-generic/ioctls.h.
_TCGETS2 = 0x802C542A
_TERMIOS2 = struct.Struct("4IB19B2I")


class LinkError(ValueError):
    """A link path that cannot be used: says why and what to do."""


class PtyPort:
    """The master end of a pseudo-terminal, and a symlink to its slave if asked for.

    The link vanishes with :meth:`close`, and also when the process is killed: a child process that
    does nothing else waits for that.
    """

    def __init__(self, link: Path | None = None) -> None:
        if link is not None:
            _check_link(link)
        self._master, self._slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.link = link
        self._guard: int | None = None
        if link is not None:
            self._guard = _guard(link, self.path, (self._master, self._slave))
            os.symlink(self.path, link)

    def fileno(self) -> int:
        """The descriptor to wait on."""
        return self._master

    def wait(self, timeout_s: float) -> bool:
        """Whether bytes have come within ``timeout_s``."""
        return bool(select.select([self._master], [], [], timeout_s)[0])

    def read(self) -> bytes:
        """The bytes that have come; empty where there are none."""
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Give bytes to the client. What a client that never reads leaves no room for is lost."""
        if data:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def baud_rate(self) -> int:
        """The output baud rate that the client has set [bit/s]."""
        values = _TERMIOS2.unpack(fcntl.ioctl(self._master, _TCGETS2, bytes(_TERMIOS2.size)))
        return int(values[-1])

    def unlock(self) -> None:
        """Undo a client's TIOCEXCL, which would lock the next client out."""
        fcntl.ioctl(self._slave, termios.TIOCNXCL)

    def close(self) -> None:
        """Take the link away and close both ends."""
        if self.link is not None:
            _unlink_own(self.link, self.path)
        for descriptor in (self._guard, self._master, self._slave):
            if descriptor is not None:
                os.close(descriptor)
        self._guard = None


def _check_link(link: Path) -> None:
    if not link.parent.is_dir():
        raise LinkError(f"--link {link}: there is no folder {link.parent}; make it first")
    if link.is_symlink():
        target = link.readlink()
        if target.exists():
            raise LinkError(
                f"--link {link}: in use, it leads to {target}; stop that server, choose another "
                f"path, or remove the link if no server has it: rm {link}"
            )
        link.unlink()
    elif link.exists():
        raise LinkError(f"--link {link}: a file of that name exists; choose another path")


def _unlink_own(link: Path, target: str) -> None:
    with contextlib.suppress(OSError):
        if str(link.readlink()) == target:
            link.unlink()


def _guard(link: Path, target: str, close: tuple[int, ...]) -> int:
    """Fork a child that removes the link once this process is gone, however it went.

    Returns the end of the pipe that keeps the child waiting.
    """
    waiting, holding = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        if os.fork() == 0:
            for descriptor in (holding, *close, 0, 1, 2):
                with contextlib.suppress(OSError):
                    os.close(descriptor)
            with contextlib.suppress(OSError):
                os.read(waiting, 1)
            _unlink_own(link, target)
        os._exit(0)
    os.waitpid(child, 0)
    os.close(waiting)
    return holding
