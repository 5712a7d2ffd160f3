"""What becomes of a command whose output cannot be written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = [["--help"], ["tables"], ["decode", "FF FF 01 02 01 FB"]]
OTHERS = [["--version"], ["tables", "XM430-W350"], ["tables", "--help"]]
every_command = pytest.mark.parametrize(
    "words", [*COMMANDS, *(pytest.param(w, marks=pytest.mark.slow) for w in OTHERS)], ids=" ".join
)


@pytest.fixture(params=["", "1"], ids=["buffered", "unbuffered"], autouse=True)
def _buffering(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Either way of Python's: what is buffered fails only as the program ends."""
    monkeypatch.setenv("PYTHONUNBUFFERED", request.param)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@every_command
def test_a_disk_that_is_full_is_one_clear_line(words: list[str]) -> None:
    command = [sys.executable, "-m", "busemu", *words]
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert ended.returncode == 1
    assert ended.stderr == "busemu: what it writes is not taken: No space left on device\n"


@every_command
def test_a_reader_that_has_gone_is_no_news(words: list[str]) -> None:
    """As behind ``| head``."""
    command = [sys.executable, "-m", "busemu", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as gone:
        gone.stdout.close()
        assert gone.stderr.read() == b""
