"""The import rules of pyproject.toml: held by the tree, and each broken once on purpose."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("busemu", "hal", "sim", "bench")
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"][
    "contracts"
]
NAMES = [contract["name"] for contract in CONTRACTS]

#: words of a contract's name -> (module, an import that breaks that contract)
OFFENCES = {
    "the bench stands on": [("hal/walk.py", "import sim"), ("sim/robot.py", "import bench")],
    "inside the bus": [
        ("busemu/bus.py", "import busemu.ports.pty"),
        ("busemu/timing.py", "import busemu.servo"),
        ("busemu/tables/robots.py", "import busemu.plant"),
    ],
    "what goes over a bus": [("busemu/traffic/follow.py", "import busemu.traffic.monitor")],
    "the core reads no clock": [
        ("busemu/bus.py", "import time"),
        ("busemu/servo/device.py", "import random"),
        ("busemu/protocol/framer.py", "import os"),
    ],
    "the robot's software knows": [("hal/walk.py", "import busemu.timing")],
    "the simulator knows": [("sim/robot.py", "import busemu.bus")],
    "one module imports pybullet": [("sim/robot.py", "import pybullet")],
    "one module imports dynamixel_sdk": [("bench/running.py", "import dynamixel_sdk")],
    "mujoco only in bench.blind": [
        ("bench/motions.py", "import mujoco"),
        ("bench/fitting/replays.py", "import mujoco"),
    ],
    "bench.blind does not import sim": [("bench/blind/pendulum.py", "import sim")],
}
CASES = [(words, *offence) for words, offences in OFFENCES.items() for offence in offences]


def lint(root: Path) -> tuple[int, str]:
    ran = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return ran.returncode, ran.stdout + ran.stderr


def broken(report: str) -> set[str]:
    """Names of the contracts that a report calls broken."""
    flat = " ".join(report.split())
    return {name for name in NAMES if f"{name} BROKEN" in flat}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages and of the rules."""
    root = tmp_path_factory.mktemp("tree")
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__", "*.nb?")
        )
    shutil.copy(ROOT / "pyproject.toml", root)
    return root


def test_import_rules_hold() -> None:
    code, report = lint(ROOT)
    assert code == 0, report
    assert f"{len(NAMES)} kept, 0 broken" in report


def test_every_contract_has_an_offence_below() -> None:
    for name in NAMES:
        assert sum(words in name for words in OFFENCES) == 1, name
    assert len(NAMES) == len(OFFENCES)


@pytest.mark.parametrize(("words", "module", "offence"), CASES)
def test_contract_fails_when_broken_on_purpose(
    tree: Path, words: str, module: str, offence: str
) -> None:
    path = tree / module
    innocent = path.read_text("utf-8")
    try:
        path.write_text(f"{innocent}\n{offence}\n", "utf-8")
        code, report = lint(tree)
    finally:
        path.write_text(innocent, "utf-8")
    assert code != 0
    (name,) = (name for name in NAMES if words in name)
    assert name in broken(report), report
