"""What is compiled is kept under a name that tells of all files it may come from."""

import shutil
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from sim.drive import compiling, kernel, lanes

FOLDER = Path(compiling.__file__).parent


def sources(folder):
    spec = spec_from_file_location("copied", folder / "compiling.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SOURCES


@pytest.mark.parametrize("module", [kernel, lanes])
def test_every_compiled_function_tells_of_all_files(module):
    own = {n: f for n, f in vars(module).items() if isinstance(f, Dispatcher)}
    assert len(own) > 5
    for name, function in own.items():
        assert function.py_func.__qualname__ == f"{name}_{compiling.SOURCES}"


def test_another_file_that_changes_is_told(tmp_path):
    folder = shutil.copytree(FOLDER, tmp_path / "drive")
    assert sources(folder) == compiling.SOURCES
    with (folder / "kernel.py").open("a") as file:
        file.write("\n")
    assert sources(folder) != compiling.SOURCES
