"""What the serving loop asks of an end of the wire, whatever it is made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable


class Port(Protocol):
    """Bytes from and to one client at a time.

    The loop never blocks in a port except in :meth:`wait`. A port that is lost for good raises from
    :meth:`wait`, :meth:`read` or :meth:`write`; a client that leaves is no loss.
    """

    path: str  #: what a client opens

    def fileno(self) -> int:
        """The descriptor to wait on, together with those of other ports."""

    def wait(self, timeout_s: float) -> bool:
        """Whether bytes have come within ``timeout_s`` [s]; 0 only looks."""

    def read(self) -> bytes:
        """The bytes that have come; empty where there are none."""

    def write(self, data: bytes) -> None:
        """Give bytes to the client, if there is one and it has room for them."""

    def baud_rate(self) -> int:
        """The baud rate of the client [bit/s]; 0 where the port has none, then it is right."""

    def unlock(self) -> None:
        """Let the next client in if one before has locked the port; called now and then."""

    def close(self) -> None:
        """Give the port up."""


@runtime_checkable
class Unpluggable(Protocol):
    """A port that can be taken away from its client, and be given back."""

    def unplug(self) -> None:
        """Be gone: a client that has the port open notices, and none can open it."""

    def replug(self) -> None:
        """Be there again, for clients that open it anew."""


def plug_of(port: object) -> Callable[[bool], None] | None:
    """How a port goes away (``False``) and comes back (``True``); ``None`` where it cannot."""
    if not isinstance(port, Unpluggable):
        return None
    return lambda plugged: port.replug() if plugged else port.unplug()
