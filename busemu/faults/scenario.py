"""Scenario files: the faults of a run, and the seed that makes it repeatable.

::

    format = "busemu-faults/1"
    seed = 7

    [[fault]]
    kind = "drop"
    servo = 3
    probability = 0.01
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..tables import Robot
from ..tables.toml_file import read_toml
from .fault import Fault, FaultError, parse_fault

FORMAT = "busemu-faults/1"


@dataclass(frozen=True, slots=True)
class Scenario:
    """Faults in the order of their numbers, and what the random numbers start from."""

    faults: tuple[Fault, ...] = ()
    seed: int = 0


def load_scenario(path: str | Path, robot: Robot) -> Scenario:
    """Read a scenario for ``robot``. Raises :class:`FaultError` with one line for the user."""
    path = Path(path)
    return _scenario(read_toml(path, FaultError), path, robot)


def _scenario(document: Mapping[str, Any], path: Path, robot: Robot) -> Scenario:
    if document.get("format") != FORMAT:
        raise FaultError(f'{path}: needs the line format = "{FORMAT}" at its top')
    for key in document:
        if key not in ("format", "seed", "fault"):
            raise FaultError(f"{path}: unknown key {key!r}: it has seed and [[fault]]")
    seed = document.get("seed", 0)
    if type(seed) is not int:
        raise FaultError(f"{path}: seed must be a whole number, not {seed!r}")
    rows = document.get("fault", [])
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise FaultError(f"{path}: faults are listed as [[fault]]")
    return Scenario(
        tuple(
            parse_fault(row, f"{path}: [[fault]] {number}", robot)
            for number, row in enumerate(rows, 1)
        ),
        seed,
    )
