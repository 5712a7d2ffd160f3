"""What tests of any folder need to run `busemu` in a process, or to speak to its port."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import dynamixel_sdk

#: The longest any wait below may last [s]; it ends a test that fails, none that passes.
PATIENCE_S = 20.0


#: where commands are forked from: a process that has imported what takes them a second or two
READY = multiprocessing.get_context("forkserver")
READY.set_forkserver_preload(
    [
        "programs",
        *(entry.module for entry in entry_points(group="busemu.commands")),
        "bench.experiments",
        "bench.diagnosis.running",
        "bench.gaits.search",
        "bench.proof.report",
    ]
)


def busemu(*words: object, timeout_s: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Run the command with words of the test to its end, in a process of its own."""
    typed = list(map(str, words))
    with TemporaryDirectory() as folder:
        said = [Path(folder, name) for name in ("stdout", "stderr")]
        process = READY.Process(target=_run, args=(typed, dict(os.environ), said))
        process.start()
        process.join(timeout_s)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(typed, timeout_s)
        out, err = (path.read_text() for path in said)
        return subprocess.CompletedProcess(typed, process.exitcode, out, err)


def _run(words: list[str], environment: Mapping[str, str], said: list[Path]) -> None:
    from busemu.cli import main  # noqa: PLC0415 - here, so that only commands load it

    os.environ.clear()
    os.environ.update(environment)
    for fd, path in enumerate(said, start=1):
        with path.open("wb") as file:
            os.dup2(file.fileno(), fd)
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - for as long as it runs
    sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    sys.argv = ["busemu", *words]
    main()


def fails_in_one_line(done: subprocess.CompletedProcess[str], says: str) -> None:
    """Require that a command has ended with one clear line, no traceback."""
    lines = done.stderr.strip().splitlines()
    assert done.returncode == 1
    assert len(lines) == 1
    assert lines[0].startswith("busemu: ")
    assert says in lines[0]


def until(condition: Callable[[], object]) -> None:
    """Return once ``condition()`` is true; fail when that takes unreasonably long."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, "waited in vain"
        time.sleep(0.005)


def unheard(signals: str) -> list[str]:
    """What to put before a command for it to start with signals ignored, such as "INT HUP"."""
    return ["sh", "-c", f"trap '' {signals}; exec \"$@\"", "sh"]


@contextmanager
def sdk(path: str, protocol: float, baud_rate: int = 1_000_000) -> Iterator[tuple[Any, Any]]:
    """The official SDK on a serial port: its port, and the packet handler of a protocol."""
    port = dynamixel_sdk.PortHandler(path)
    port.baudrate = baud_rate
    assert port.openPort()
    try:
        yield port, dynamixel_sdk.PacketHandler(protocol)
    finally:
        port.closePort()
