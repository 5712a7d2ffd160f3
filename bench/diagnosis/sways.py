"""What is not the same from one recording to the next, though nothing about the joint is new.

A battery runs down, grease warms up and wears in. By how much in which recording nobody tells; by
how much at most is known. Nuisances hold for all recordings together, so what is left of a
recording for this reason looks like physics, and like more of it the longer the recording is. So
what a motion would be with a little more friction, or voltage, is worked out once for every
recording, as the joint is believed to be, and the likelihood sums over how much of it there was
(:func:`bench.diagnosis.noise.whiten`): one number a recording of each, normally distributed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from sim.drive import fields
from sim.rollout import Candidate

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
