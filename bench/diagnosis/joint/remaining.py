"""What a fit leaves of recordings, and how well it does on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..noise import Block, calm
from ..observed import Observed
from .fit import Fit, block_costs
from .model import Blocks, JointModel, Kind


@dataclass(frozen=True, slots=True)
class Score:
    """How a fit does on some recordings: log-likelihood [nats], and squares of residuals."""

    nats: float
    squares: Mapping[Kind, float]  #: summed
    count: Mapping[Kind, int]
    seen: Score | None = None  #: of the fit that has seen them, where this one has not


def score(model: JointModel, found: Fit, which: Sequence[int]) -> Score:
    """How a fit does on recordings it may never have seen."""
    blocks = model.residuals(found.hypothesis, [found.z], which)[0]
    squares: dict[Kind, float] = {}
    count: dict[Kind, int] = {}
    for (_, kind), block in remaining(model, found, which).items():
        squares[kind] = squares.get(kind, 0.0) + float(np.sum(block.value**2))
        count[kind] = count.get(kind, 0) + len(block.value)
    return Score(-sum(block_costs(blocks, found.noise).values()), squares, count)


def remaining(
    model: JointModel, found: Fit, which: Sequence[int] | None = None, *, driven: bool = False
) -> Blocks:
    """What a fit leaves of some recordings (all), without what most likely swayed each of them.

    ``driven``: only of the time that the torque was on.
    """
    blocks = model.residuals(found.hypothesis, [found.z], which)[0]
    if driven:
        blocks = {key: while_driven(model.observed[key[0]], b) for key, b in blocks.items()}
    return {
        key: block if block.sways is None else calm(block, found.noise[key[1]])
        for key, block in blocks.items()
    }


def while_driven(one: Observed, block: Block) -> Block:
    """The part of a recording's residuals in which its torque was on, if it ever was.

    A joint that is let go swings, and sticks wherever friction is enough to hold it: two sound
    simulations come to rest far from each other, and from themselves with a little more friction.
    """
    on = one.driven(block.t_s)
    if on.all() or not on.any():
        return block
    sways = None if block.sways is None else block.sways[on]
    return Block(block.t_s[on], block.value[on], block.extra[on], sways)


def block_rms(blocks: Mapping[tuple[int, Kind], Block], kind: Kind) -> float:
    """Root mean square of the residuals of one kind, in its unit."""
    values = [b.value for key, b in blocks.items() if key[1] is kind]
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if values else float("nan")
