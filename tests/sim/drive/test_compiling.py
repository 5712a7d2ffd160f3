"""What is compiled is kept under a name that tells of all files it may come from."""

import shutil
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from sim.drive import compiling

FOLDER = Path(compiling.__file__).parent


def sources(folder):
    spec = spec_from_file_location("copied", folder / "compiling.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SOURCES


def test_every_compiled_function_tells_of_all_files():
    modules = [import_module(f"sim.drive.{path.stem}") for path in FOLDER.glob("[!_]*.py")]
    named = [pair for module in modules for pair in vars(module).items()]
    own = {name: function for name, function in named if isinstance(function, Dispatcher)}
    assert len(own) > 30
    for name, function in own.items():
        assert function.py_func.__qualname__ == f"{name}_{compiling.SOURCES}"


def test_another_file_that_changes_is_told(tmp_path):
    folder = shutil.copytree(FOLDER, tmp_path / "drive")
    assert sources(folder) == compiling.SOURCES
    with (folder / "kernel.py").open("a") as file:
        file.write("\n")
    assert sources(folder) != compiling.SOURCES
