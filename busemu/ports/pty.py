"""A virtual serial port: any program that opens a serial device can open this one.

The slave end is held open here as well, so the port outlives its clients. A client's baud rate is
read from the line itself, so one that is set wrongly meets silence, as on a real bus.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import subprocess
import termios
import tty
from pathlib import Path

from .baud import get_baud_rate


class LinkError(ValueError):
    """A link path that cannot be used: says why and what to do."""


class PtyPort:
    """The master end of a pseudo-terminal, and a symlink to its slave if asked for.

    The link vanishes with :meth:`close`, and also when this process is killed: a shell that does
    nothing else waits for that.
    """

    def __init__(self, link: Path | None = None) -> None:
        if link is not None:
            _check_link(link)
        self.link = link
        self._away = False
        self._open()

    def _open(self) -> None:
        self._master, self._slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._guard: subprocess.Popen[bytes] | None = None
        if self.link is not None:
            self._guard = _guard(self.link, self.path)
            try:
                os.symlink(self.path, self.link)
            except OSError as error:
                self.close()
                raise LinkError(
                    f"--link {self.link}: {os.strerror(error.errno or 0)}; choose another path"
                ) from None

    def unplug(self) -> None:
        """Take the device and the link away; a client that has it open sees it hang up."""
        self.close()
        self._away = True
        self._master = self._slave = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def replug(self) -> None:
        """Be there again: a new device, often of the same name, and the link to it."""
        self.close()
        self._away = False
        self._open()

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
        if data and not self._away:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def baud_rate(self) -> int:
        """The output baud rate that the client has set [bit/s]; 0 while unplugged."""
        return 0 if self._away else get_baud_rate(self._master)

    def unlock(self) -> None:
        """Undo a client's TIOCEXCL, which would lock the next client out."""
        if not self._away:
            fcntl.ioctl(self._slave, termios.TIOCNXCL)

    def close(self) -> None:
        """Close both ends and take the link away."""
        os.close(self._master)
        if self._away:
            return
        os.close(self._slave)
        if self.link is not None:
            _unlink_own(self.link, self.path)
        if self._guard is not None:
            self._guard.communicate()


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


#: Waits for its input to end, then removes the link if it still leads to the same port.
_GUARD = """trap '' INT TERM HUP; read -r _; [ "$(readlink "$1")" = "$2" ] && rm -f "$1"; exit 0"""


def _guard(link: Path, target: str) -> subprocess.Popen[bytes]:
    """Start a shell that removes the link once this process is gone, however it went."""
    return subprocess.Popen(
        ["/bin/sh", "-c", _GUARD, "link-guard", str(link.absolute()), target],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
