"""A real `busemu serve` in a process group of its own, and what is left of it."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from programs import PATIENCE_S, until


class Server:
    """`busemu serve` with arguments of the test; ready once it has named its port."""

    def __init__(
        self, *arguments: object, plant: str = "ideal", through: Sequence[str] = ()
    ) -> None:
        command = [sys.executable, "-m", "busemu", "serve", "--plant", plant]
        self.process = subprocess.Popen(
            [*through, *command, *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self.said = ""
        until(lambda: self._hear() and re.search(r"^try: .*\n", self.said, re.MULTILINE))
        self.path = re.search(r"^port (\S+)", self.said, re.MULTILINE)[1]

    def _hear(self) -> bool:
        if select.select([self.process.stdout], [], [], 0.01)[0]:
            text = os.read(self.process.stdout.fileno(), 65536)
            assert text, self.process.communicate()[1].decode()
            self.said += text.decode()
        return True

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """End it with a signal; its exit code and what it still said on both streams."""
        self.process.send_signal(number)
        out, error = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, (out + error).decode()

    def kill_if_alive(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()


@contextmanager
def serving(
    *arguments: object, plant: str = "ideal", through: Sequence[str] = ()
) -> Iterator[Server]:
    server = Server(*arguments, plant=plant, through=through)
    try:
        yield server
    finally:
        server.kill_if_alive()


def processes_with(text: str) -> set[int]:
    """IDs of the processes whose command line holds ``text``, zombies excepted."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if text.encode() in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
    return found
