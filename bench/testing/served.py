"""A servo bus on a pseudo-terminal in wall-clock time, served by a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from busemu.tables import Robot

from .buses import ServoBus, ServoBusError

#: A server that has not opened its port after so long has failed [s]. Assumed: PyBullet and the
#: compiled drive load in a few seconds even on a slow machine.
START_S = 120.0
#: A server that does not answer a question in this time has failed [s]. Assumed.
ANSWER_S = 30.0


class PtyServoBus(ServoBus):
    """A bus that any program can open: C++, the SDK, another process.

    The server ends with :meth:`close`, and by itself when this process is gone, however it went.
    Raises :class:`ServoBusError` with what the server said if it does not start.
    """

    def __init__(
        self, robot: Robot, name: str, plant: str, timing: str, link: Path | None = None
    ) -> None:
        super().__init__(robot)
        self._sdk_port: Any = None
        self._said = b""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the bus
        command = [sys.executable, "-m", "bench.testing.server", name, plant, timing]
        self._server = subprocess.Popen(
            [*command, *([str(link)] if link else [])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,  # Ctrl-C is for the tests, whose end then ends the server
        )
        try:
            served = str(self._hear(START_S)["path"])
        except BaseException:
            self.close()
            raise
        self._path = served if link is None else str(link)
        self._linked = link is not None

    @property
    def port(self) -> Any:
        """The SDK's own port handler on the device, opened when first asked for."""
        if self._sdk_port is None:
            from hal.bus_client import open_port  # noqa: PLC0415 - other clients need no SDK

            self._sdk_port = open_port(self._path, self.robot.baud_rate)
        return self._sdk_port

    @property
    def path(self) -> str:
        """The serial device, or the link to it. After an unplug, the device may be another."""
        if not self._linked:
            self._path = str(self.ask("path")["path"])
        return self._path

    def now_s(self) -> float:
        """The machine's monotonic clock [s], which is the bus's."""
        return time.monotonic()

    def run(self, seconds: float) -> None:
        """Sleep [s]; also where a test has put this in the place of ``time.sleep``."""
        select.select([], [], [], seconds)

    def ask(self, question: str, **about: Any) -> Mapping[str, Any]:
        """Ask the server; what it answers was so within the last few milliseconds."""
        assert self._server.stdin is not None
        try:
            self._server.stdin.write(json.dumps({"question": question, **about}).encode() + b"\n")
            self._server.stdin.flush()
        except (BrokenPipeError, ValueError):
            raise ServoBusError(f"the server is gone: {self._complaint()}") from None
        return self._hear(ANSWER_S)

    def _hear(self, patience_s: float) -> dict[str, Any]:
        """The next line of the server."""
        assert self._server.stdout is not None
        until_s = time.monotonic() + patience_s
        while b"\n" not in self._said:
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                raise ServoBusError(f"the server has said nothing for {patience_s:.0f} s")
            if select.select([self._server.stdout], [], [], left_s)[0]:
                said = os.read(self._server.stdout.fileno(), 65536)
                if not said:
                    self._server.wait(patience_s)
                    raise ServoBusError(f"the server has ended: {self._complaint()}")
                self._said += said
        line, _, self._said = self._said.partition(b"\n")
        heard: dict[str, Any] = json.loads(line)
        return heard

    def _complaint(self) -> str:
        if self._errors.closed:
            return "the bus was closed"
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"exit code {self._server.poll()}"

    def close(self) -> None:
        """Close the SDK's port and end the server."""
        if self._sdk_port is not None:
            with contextlib.suppress(Exception):  # a test may have closed it, or lost it
                self._sdk_port.closePort()
            self._sdk_port = None
        if self._server.poll() is None:
            assert self._server.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                self._server.stdin.close()
            try:
                self._server.wait(ANSWER_S)
            except subprocess.TimeoutExpired:
                self._server.kill()
                self._server.wait()
        for stream in (self._server.stdin, self._server.stdout, self._errors):
            assert stream is not None
            with contextlib.suppress(BrokenPipeError):
                stream.close()
