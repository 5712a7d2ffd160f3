"""What a run has worked out, kept on disk step by step: a run that is stopped goes on from there.

A step is a fit, or a screening of effects. Its key is a hash of all that it depends on: the code,
the robot, the recordings, the hypothesis and where it starts. A run that is repeated takes the same
steps and finds those that are done, so its answers are the same to the bit. Each step is a small
JSON file, whole or not there.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.files import write_text

FOLDER = "progress"  #: in the folder of answers, until a run is finished
CODE = ("bench/diagnosis", "sim")  #: what makes answers of a robot and of what was observed


class Journal:
    """Steps that are done, by their keys."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.recalled = 0  #: steps that an earlier run had done
        self._own: set[str] = set()

    def get(self, key: str) -> dict[str, Any] | None:
        """What a step gave, if it is done. A file that is no JSON counts as none."""
        try:
            found = json.loads((self.folder / f"{key}.json").read_text("utf-8"))
        except (OSError, ValueError):
            return None
        if not isinstance(found, dict):
            return None
        self.recalled += key not in self._own
        self._own.add(key)
        return found

    def put(self, key: str, given: Mapping[str, Any]) -> None:
        """Keep what a step gave. Raises ``OSError``."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_text(self.folder / f"{key}.json", json.dumps(given))
        self._own.add(key)

    def finished(self) -> None:
        """Forget the steps: the answers are written."""
        shutil.rmtree(self.folder, ignore_errors=True)


def digest(*parts: Any) -> str:
    """A hash of arrays (to the bit) and of what other values are written as."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            total.update(f"{part.dtype} {part.shape} ".encode())
            total.update(np.ascontiguousarray(part).tobytes())
        else:
            total.update(repr(part).encode())
        total.update(b"\0")
    return total.hexdigest()[:32]


@cache
def code() -> str:
    """A hash of the code that makes the answers: other code may give others."""
    root = Path(__file__).parents[2]
    files = sorted(path for package in CODE for path in (root / package).rglob("*.py"))
    return digest(*(path.read_bytes() for path in files))
