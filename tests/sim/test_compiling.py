"""What is compiled is kept under a name that tells of all files it may come from."""

import shutil
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from sim import compiling

FOLDER = Path(compiling.__file__).parent


def sources(folder):
    spec = spec_from_file_location("copied", folder / "compiling.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SOURCES


@pytest.mark.parametrize(("folder", "least"), [("drive", 30), ("floating", 15)])
def test_every_compiled_function_tells_of_all_files(folder, least):
    paths = (FOLDER / folder).glob("[!_]*.py")
    modules = [import_module(f"sim.{folder}.{path.stem}") for path in paths]
    named = [pair for module in modules for pair in vars(module).items()]
    functions = {name: function for name, function in named if isinstance(function, Dispatcher)}
    own = {
        name: function
        for name, function in functions.items()
        if function.py_func.__module__.startswith(f"sim.{folder}.")
    }
    assert len(own) > least
    for name, function in own.items():
        assert function.py_func.__qualname__ == f"{name}_{compiling.SOURCES[folder]}"


@pytest.mark.parametrize(
    ("changed", "told"),
    [("drive/kernel.py", {"drive", "floating"}), ("floating/contact.py", {"floating"})],
)
def test_another_file_that_changes_is_told(tmp_path, changed, told):
    folder = shutil.copytree(FOLDER, tmp_path / "sim")
    assert sources(folder) == compiling.SOURCES
    with (folder / changed).open("a") as file:
        file.write("\n")
    now = sources(folder)
    assert {name for name in now if now[name] != compiling.SOURCES[name]} == told
