"""Asking a running server for faults: one line of JSON there, one back, over a Unix socket.

The socket's name is that of the port, or of the link to it, in Linux's abstract namespace: it is no
file, so none is left behind, however the server ends. The name is there for all users of the
machine (and network namespace); the server answers its own user, and root.

Requests and answers::

    {"do": "add", "fault": {"kind": "drop", "servo": 3}}    {"number": 1, "words": "drop servo 3"}
    {"do": "list"}                                          {"faults": [...]}
    {"do": "clear", "which": 1}                             {"ended": 1}
    whatever is wrong                                       {"error": "kind must be ..."}
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import socket
import struct
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .faults import FaultError, Faults, Kind, parse_fault
from .tables import Robot

#: What the sockets' names begin with; a server has one main name, and others for its port.
MAIN, OTHER = "busemu:", "busemu-port:"
#: How often a server looks for requests [s].
LOOK_EVERY_S = 0.01
#: A request that is not complete after so long is dropped [s].
REQUEST_S = 1.0
#: Longest request [bytes], and most requests at once.
MOST_BYTES, MOST_REQUESTS = 65536, 8
#: A server that does not answer in this time is too busy [s].
ANSWER_S = 30.0
#: Longest name of a socket [bytes]. Source: unix(7).
NAME_BYTES = 107

_CREDENTIALS = struct.Struct("3i")


class ControlError(OSError):
    """A server that cannot be asked: says which, why, and what to do."""


class Control:
    """The server's end. ``names`` are what its port is called, the main one first."""

    def __init__(self, names: Sequence[str], faults: Faults, robot: Robot) -> None:
        """Listen. Raises :class:`ControlError` where another server has the name."""
        self._faults = faults
        self._robot = robot
        self._look_s = 0.0
        self._open: dict[socket.socket, tuple[float, bytes]] = {}
        self._listeners: list[socket.socket] = []
        for index, name in enumerate(names):
            listener = socket.socket(socket.AF_UNIX)
            self._listeners.append(listener)
            try:
                listener.bind(_address(OTHER if index else MAIN, name))
            except OSError as error:
                self.close()
                raise ControlError(f"{name}: no control socket: {error.strerror}") from None
            listener.listen(MOST_REQUESTS)
            listener.setblocking(False)

    def idle(self, now_s: float) -> None:
        """Answer what has come in; to be called when nothing else is to be done, at ``now_s``."""
        if now_s < self._look_s:
            return
        self._look_s = now_s + LOOK_EVERY_S
        for listener in self._listeners:
            with contextlib.suppress(BlockingIOError):
                asker, _ = listener.accept()
                if len(self._open) < MOST_REQUESTS and _may_ask(asker):
                    asker.setblocking(False)
                    self._open[asker] = now_s, b""
                else:
                    asker.close()
        for asker, (since_s, heard) in list(self._open.items()):
            self._hear(asker, since_s, heard, now_s)

    def _hear(self, asker: socket.socket, since_s: float, heard: bytes, now_s: float) -> None:
        over = now_s - since_s > REQUEST_S
        try:
            data = asker.recv(MOST_BYTES)
            over = over or not data
            heard += data
        except BlockingIOError:
            pass
        except OSError:
            over = True
        self._open[asker] = since_s, heard
        if b"\n" in heard:
            answer = json.dumps(self._answer(heard.partition(b"\n")[0])) + "\n"
            with contextlib.suppress(OSError):
                asker.send(answer.encode())
            over = True
        if over or len(heard) > MOST_BYTES:
            del self._open[asker]
            asker.close()

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            return carry_out(json.loads(line), self._faults, self._robot)
        except FaultError as error:
            return {"error": str(error)}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return {"error": "this server does not understand the request"}

    def close(self) -> None:
        """Listen no more."""
        for one in (*self._listeners, *self._open):
            one.close()


def carry_out(asked: Mapping[str, Any], faults: Faults, robot: Robot) -> dict[str, Any]:
    """Do what a request asks for; the answer. Raises :class:`busemu.faults.FaultError`.

    Nonsense raises ``ValueError``, ``KeyError`` or ``TypeError``.
    """
    what = asked["do"]
    if what == "add":
        fault = parse_fault(asked["fault"], "fault", robot)
        return {"number": faults.add(fault), "words": str(fault)}
    if what == "clear":
        which = _which(asked.get("which"))
        if type(which) is int and which not in {each.number for each in faults.standing()}:
            raise FaultError(f"clear: there is no fault {which}; busemu fault list shows what is")
        return {"ended": faults.clear(which)}
    if what == "list":
        return {"faults": [asdict(each) for each in faults.standing()]}
    raise ValueError(what)


def _which(which: object) -> int | Kind | None:
    if which is None or type(which) is int:
        return which
    known = {kind.value: kind for kind in Kind}
    word = str(which).replace("-", "_")
    if word not in known:
        raise FaultError(f"clear: {which!r} is no number and no kind: use {', '.join(known)}")
    return known[word]


def _may_ask(asker: socket.socket) -> bool:
    credentials = asker.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, user, _ = _CREDENTIALS.unpack(credentials)
    return user in (os.geteuid(), 0)


def _address(kind: str, name: str) -> bytes:
    """A socket's address; the name is shortened where it is too long for one."""
    address = b"\0" + os.fsencode(kind + name)
    if len(address) > NAME_BYTES:
        digest = hashlib.sha256(os.fsencode(name)).hexdigest()[:32]
        address = b"\0" + os.fsencode(kind + digest)
    return address


def servers() -> list[str]:
    """The main names of the servers that can be asked, sorted."""
    start = "@" + MAIN
    lines = Path("/proc/net/unix").read_text("utf-8", "surrogateescape").splitlines()
    names = (line.split(None, 7)[7] for line in lines if start in line)
    return sorted({name.removeprefix(start) for name in names if name.startswith(start)})


def ask(port: str | None, request: dict[str, Any]) -> dict[str, Any]:
    """Ask the server of a port, link or address, or the only one there is; its answer.

    Raises :class:`ControlError`.
    """
    running = servers()
    if port is None:
        if len(running) != 1:
            have = f"several are running: {', '.join(running)}" if running else "none is running"
            raise ControlError(f"which server? {have}: give --port, or start busemu serve")
        port = running[0]
    with socket.socket(socket.AF_UNIX) as server:
        server.settimeout(ANSWER_S)
        if not any(_connect(server, address) for address in _addresses(port)):
            have = f": running are {', '.join(running)}" if running else "; start busemu serve"
            raise ControlError(f"{port}: no server of yours has this port{have}")
        try:
            server.sendall(json.dumps(request).encode() + b"\n")
            with server.makefile("rb") as answer:
                line = answer.readline()
        except OSError as error:
            raise ControlError(
                f"{port}: the server does not answer ({error}): is the machine too busy for it?"
            ) from None
    if not line:
        raise ControlError(f"{port}: the server hung up; it answers the user that started it")
    answered: dict[str, Any] = json.loads(line)
    return answered


def _addresses(port: str) -> list[bytes]:
    names = (port, f"socket://{port}", os.path.abspath(port), os.path.realpath(port))
    return [_address(kind, name) for name in dict.fromkeys(names) for kind in (MAIN, OTHER)]


def _connect(server: socket.socket, address: bytes) -> bool:
    try:
        server.connect(address)
    except OSError:
        return False
    return True
