"""What is not the same from one recording to the next, though nothing about the joint is new.

A battery runs down, grease warms up and wears in. By how much in which recording nobody tells; by
how much at most is known. Nuisances hold for all recordings together, so what is left of a
recording for this reason looks like physics, and like more of it the longer the recording is. So
what a motion would be with a little more friction, or voltage, is worked out once for every
recording, as the joint is believed to be, and the likelihood sums over how much of it there was
(:func:`bench.diagnosis.noise.whiten`): one number a recording of each, normally distributed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.drive import fields
from sim.rollout import Candidate

from ..noise import Block
from .left import runs_away

Floats = NDArray[np.float64]

#: deviation of dry friction from one motion to the next, of its size: repeats of one motion differ
#: by some per cent; assumed
FRICTION = 0.02
#: the same of the voltage of a battery between two charges, where no register tells it; assumed
SUPPLY = 0.005

Sway = Callable[[Candidate, float], Candidate]


def friction(candidate: Candidate, deviations: float) -> Candidate:
    """With more dry friction, by so many deviations."""
    drive = candidate.drive.copy()
    drive[[fields.COULOMB, fields.STRIBECK]] *= 1.0 + FRICTION * deviations
    return replace(candidate, drive=drive)


def supply(candidate: Candidate, deviations: float) -> Candidate:
    """With more voltage, by so many deviations."""
    return replace(candidate, voltage_v=candidate.voltage_v * (1.0 + SUPPLY * deviations))


SWAYS: tuple[Sway, ...] = (friction, supply)
SIDES = (1.0, -1.0)
WAYS = len(SWAYS) * len(SIDES)


def both_ways(candidate: Candidate) -> list[Candidate]:
    """With more and with less of each that sways."""
    return [sway(candidate, side) for sway in SWAYS for side in SIDES]


def swings(blocks: Sequence[Block]) -> Floats:
    """What one deviation of each changes (n, sways), from the blocks of :func:`both_ways`, if any.

    Where a rollout ran away that is taken for nothing.
    """
    if not blocks or runs_away(dict(enumerate(blocks))):
        return np.zeros((len(blocks[0].value) if blocks else 0, len(SWAYS)))
    pairs = zip(blocks[::2], blocks[1::2], strict=True)
    return np.stack([(less.value - more.value) / 2.0 for more, less in pairs], axis=1)
