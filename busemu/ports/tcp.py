"""The wire over a TCP connection: raw bytes, nothing else, as pyserial's ``socket://`` speaks it.

One client at a time. The next one may connect already; it is served when the one before has left.
A connection has no baud rate, so every client has the robot's.
"""

from __future__ import annotations

import contextlib
import select
import socket


class TcpError(OSError):
    """An address that cannot be served: says which, why, and what to do."""


class TcpPort:
    """A listening socket and at most one client. ``address`` is ``HOST:PORT``; port 0 is any.

    Raises :class:`TcpError`.
    """

    def __init__(self, address: str) -> None:
        host, number = _parse(address)
        try:
            family, kind, _, _, place = socket.getaddrinfo(
                host, number, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )[0]
            self._listener = socket.socket(family, kind)
        except OSError as error:
            raise TcpError(f"--tcp {address}: no such host: {error.strerror}") from None
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(place)
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise TcpError(
                f"--tcp {address}: {error.strerror}: choose another port, or 0 for any free one"
            ) from None
        self._listener.setblocking(False)
        self._client: socket.socket | None = None
        self._away = False
        shown = f"[{host}]" if ":" in host else host
        self.path = f"socket://{shown}:{self._listener.getsockname()[1]}"

    def fileno(self) -> int:
        """The descriptor to wait on: the client's, or without one the listening socket's."""
        return (self._listener if self._client is None else self._client).fileno()

    def wait(self, timeout_s: float) -> bool:
        """Whether a client has sent bytes within ``timeout_s`` [s]; a new one is let in first."""
        if self._client is None:
            if not select.select([self._listener], [], [], timeout_s)[0]:
                return False
            self._accept()
            timeout_s = 0.0
        client = self._client
        return client is not None and bool(select.select([client], [], [], timeout_s)[0])

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # it may have left again
            client, _ = self._listener.accept()
            if self._away:
                client.close()
                return
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client

    def read(self) -> bytes:
        """The bytes that have come; empty also when the client has left."""
        if self._client is None:
            return b""
        try:
            data = self._client.recv(4096)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._dismiss()
        return data

    def write(self, data: bytes) -> None:
        """Give bytes to the client. What it leaves no room for is lost, and without one, all."""
        if not data or self._client is None:
            return
        try:
            self._client.send(data)
        except BlockingIOError:
            pass
        except OSError:
            self._dismiss()

    def unplug(self) -> None:
        """Hang up, and at once on everybody who calls."""
        self._away = True
        self._dismiss()

    def replug(self) -> None:
        """Take clients again."""
        self._away = False

    def _dismiss(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def baud_rate(self) -> int:
        """None: a connection has no baud rate."""
        return 0

    def unlock(self) -> None:
        """A connection cannot be locked."""

    def close(self) -> None:
        """Hang up and stop listening."""
        self._dismiss()
        self._listener.close()


def _parse(address: str) -> tuple[str, int]:
    host, colon, number = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not number.isdecimal() or int(number) > 0xFFFF:
        raise TcpError(
            f"--tcp {address}: give HOST:PORT, such as 127.0.0.1:4000 (this machine only) "
            "or 0.0.0.0:4000 (everybody on the network)"
        )
    return host, int(number)
