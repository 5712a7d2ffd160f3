"""Real `busemu` commands in processes of their own, and clients for what they serve."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from programs import PATIENCE_S, busemu, until

OK, TIMEOUT = 0, -3001
IDS = list(range(1, 19))


class Program:
    """`busemu` with words of the test; ready once it has said what to try on its port."""

    def __init__(self, *words: object) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "busemu", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        self.said = ""
        try:
            until(lambda: self.hear() and re.search(r"^try: .*\n", self.said, re.MULTILINE))
        except AssertionError:
            self.kill()
            raise
        self.path = re.search(r"^port (\S+)", self.said, re.MULTILINE)[1]

    def hear(self) -> bool:
        """Take in what it has said since."""
        if select.select([self.process.stdout], [], [], 0.01)[0]:
            text = os.read(self.process.stdout.fileno(), 65536).decode()
            assert text, self.said
            self.said += text
        return True

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()

    def end(self, number: int | None = signal.SIGINT) -> tuple[int, str]:
        """End it with a signal, or wait for its end; its exit code and all that it said."""
        if number is not None:
            self.process.send_signal(number)
        rest = self.process.communicate(timeout=PATIENCE_S)[0].decode()
        self.said += rest
        return self.process.returncode, self.said


@contextmanager
def running(*words: object) -> Iterator[Program]:
    program = Program(*words)
    try:
        yield program
    finally:
        if program.process.poll() is None:
            program.kill()


def serving(*words: object) -> Any:
    return running("serve", "--plant", "ideal", *words)


def meets(wanted: object, attempt: Callable[[], object]) -> bool:
    """Whether an exchange has the result wanted, in one of a few attempts on a busy machine."""
    return any(attempt() == wanted for _ in range(5))


def refused(*words: object) -> str:
    """The one line of a command that is refused."""
    ran = busemu(*words, timeout_s=PATIENCE_S)
    assert ran.returncode == 1, ran.stdout + ran.stderr
    assert ran.stdout == ""
    (line,) = ran.stderr.splitlines()
    assert line.startswith("busemu: ")
    return line
