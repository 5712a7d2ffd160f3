"""How small a misfit can be: rounding, and the spread of repeats of one experiment."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .model import Blocks, Kind
from .noise import Block
from .observed import Observed

Floats = NDArray[np.float64]

ENGINE_RAD = 0.0015  #: what two sound simulations of one joint differ by; see docs on two engines


def tolerance(floor_rad: float) -> float:
    """Deviation [rad] below which a difference between a model and a recording is no physics."""
    return float(np.hypot(floor_rad, ENGINE_RAD))


def noise_floor(observed: Sequence[Observed], blocks: Blocks) -> float:
    """Deviation [rad] of a position that a perfect model would leave.

    Rounding to the register's step; where an experiment was repeated, how differently a model's
    residuals ``blocks`` come out in the repeats, if that is more: what is the same in all repeats,
    the model's own error, cancels, and so do goals that came at other instants.
    """
    rounding = max(o.position.quantum for o in observed) / np.sqrt(12.0)
    groups: dict[str, list[Block]] = {}
    for r, one in enumerate(observed):
        if (r, Kind.POSITION) in blocks:
            groups.setdefault(one.group, []).append(blocks[r, Kind.POSITION])
    squares = [
        square
        for some in groups.values()
        for pair in itertools.pairwise(some)
        if (square := _difference(*pair)) is not None
    ]
    return float(max(rounding, np.sqrt(np.mean(squares)))) if squares else float(rounding)


def _difference(one: Block, other: Block) -> float | None:
    """Variance of a single repeat, from the difference of two at like times since the start."""
    inside = one.t_s <= other.t_s[-1]
    if inside.sum() < 10:
        return None
    difference = np.interp(one.t_s[inside], other.t_s, other.value) - one.value[inside]
    return float(np.mean(difference**2) / 2.0)
