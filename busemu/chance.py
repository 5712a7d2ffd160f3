"""The random numbers of faults, which the core does not draw by itself."""

from __future__ import annotations

import random
from collections.abc import Callable

from .faults import Chance


def seeded(seed: int) -> Callable[[int], Chance]:
    """For each fault, by its number, random numbers of its own; the same for the same seed."""
    return lambda number: random.Random(f"{seed}.{number}")
