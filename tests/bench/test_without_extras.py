"""The command line where only the bus is installed, and not what other commands need besides."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXTRAS = (
    *("numpy", "dynamixel_sdk", "serial", "numba", "pybullet", "pyarrow", "tomli_w"),
    *("matplotlib", "PIL", "scipy", "cma", "jinja2", "mujoco", "cryptography"),
)
ALONE = f"""
import sys
sys.modules.update(dict.fromkeys({EXTRAS!r}))
from busemu.cli import main
main()
"""


def alone(*words: object) -> subprocess.CompletedProcess[str]:
    """``busemu`` as it is without any extra."""
    command = [sys.executable, "-c", ALONE, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize("words", [["--help"], ["tables", "AX-12A"], ["serve", "--help"]])
def test_the_bus_needs_none_of_them(words: list[str]) -> None:
    done = alone(*words)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "words",
    [
        ["walk", "--robot", "marvin", "--virtual"],
        ["timing", "--robot", "marvin", "--virtual"],
        ["demo"],
        ["inspect", "x.csv"],
        ["import", "auto", "x", "--out", "OUT"],
        ["diagnose", "--robot", "marvin", "--out", "OUT", "x.json"],
        ["experiment", "torque-analysis", "--robot", "marvin"],
        ["gait-search", "--robot", "marvin", "--out", "OUT"],
        ["tap", "--device", "/nope", "--robot", "marvin", "--record", "OUT.csv"],
        ["prove", "--seed", "1", "--out", "OUT"],
        ["study", "stance", "--out", "OUT"],
    ],
    ids=lambda words: words[0],
)
def test_a_command_that_needs_more_says_what_to_install(words: list[str], tmp_path: Path) -> None:
    done = alone(*(word.replace("OUT", str(tmp_path / "out")) for word in words))
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("busemu: ")
    assert "pip install 'busemu[" in done.stderr
    assert list(tmp_path.iterdir()) == []
