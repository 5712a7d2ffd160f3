"""What tests of any folder need to run `busemu` in a process, or to speak to its port."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import dynamixel_sdk

#: The longest any wait below may last [s]; it ends a test that fails, none that passes.
PATIENCE_S = 20.0


def busemu(*words: object, timeout_s: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Run the command with words of the test to its end."""
    command = [sys.executable, "-m", "busemu", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)


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
