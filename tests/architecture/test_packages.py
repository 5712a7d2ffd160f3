"""The packages are the repository's own, and what runs alone runs without the rest."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: Modules that write to a terminal, with typer and rich.
COMMAND_LINE = (
    "busemu.cli",
    "busemu.__main__",
    "busemu.see",
    "busemu.traffic.decoding",
    "busemu.traffic.monitor",
    "busemu.fault_command",
)
PACKAGES = ("busemu", "hal", "sim", "bench")


@pytest.mark.parametrize("name", PACKAGES)
def test_name_is_this_repositorys_package(name: str) -> None:
    package = importlib.import_module(name)
    assert package.__file__ is not None, f"{name} is a bare folder of {list(package.__path__)}"
    assert Path(package.__file__) == ROOT / name / "__init__.py"


@pytest.mark.parametrize("name", PACKAGES)
def test_name_is_this_repositorys_package_from_any_folder(name: str, tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", f"import {name}; print({name}.__file__)"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(ran.stdout.strip()) == ROOT / name / "__init__.py"


def test_tests_do_not_shadow_the_packages() -> None:
    """A folder of tests on the path is no package; with an __init__.py it would be one."""
    for name in PACKAGES:
        assert not (ROOT / "tests" / name / "__init__.py").exists()


def test_bus_runs_on_the_standard_library_alone() -> None:
    """Nothing but the command line may need more."""
    program = (
        f"COMMANDS = {COMMAND_LINE}\n"
        "import sys, pkgutil, importlib, busemu\n"
        "for m in pkgutil.walk_packages(busemu.__path__, 'busemu.'):\n"
        "    if m.name not in COMMANDS: importlib.import_module(m.name)\n"
        "top = {name.split('.')[0] for name in sys.modules}\n"
        "import sysconfig\n"
        "print(sorted(n for n in top if n in {'numpy', 'numba', 'pybullet', 'typer', 'rich',"
        " 'serial', 'dynamixel_sdk', 'hal', 'sim', 'bench', 'matplotlib', 'pyarrow'}))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ran.stdout.strip() == "[]"
