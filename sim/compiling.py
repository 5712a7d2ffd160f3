"""How the functions of ``drive`` and ``floating`` are compiled, and when anew.

What is compiled is kept on disk. The compiler looks only at the file a function stands in to tell
whether that is still good, and would go on with what it made of another file's old functions or
field numbers. It keeps things by a function's qualified name; so that name tells what is in all
files there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
FOLDERS = ("drive", "floating")  #: each of which may call into those before it


def _of_files(*folders: str) -> str:
    """What tells all files of some folders from other ones."""
    here = Path(__file__).parent
    every = [path for folder in folders for path in sorted((here / folder).glob("*.py"))]
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in every)).hexdigest()[:16]


SOURCES = {name: _of_files(*FOLDERS[: i + 1]) for i, name in enumerate(FOLDERS)}


def compiled(function: Function) -> Function:
    """Compile without reference counts: nothing here allocates, and calls cost a third then."""
    return cast(Function, njit(**OPTIONS)(_marked(function)))


def inlined(function: Function) -> Function:
    """The same, into whatever calls it: a loop over lanes becomes one over vectors then."""
    return cast(Function, njit(forceinline=True, **OPTIONS)(_marked(function)))


def _marked(function: Function) -> Function:
    folder = function.__module__.split(".")[-2]
    function.__qualname__ += f"_{SOURCES[folder]}"
    return function
