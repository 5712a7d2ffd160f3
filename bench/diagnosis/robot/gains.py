"""What effects at places gain, and what came of a search for them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .fit import RobotFit
from .screen import Screened

#: fits of one hypothesis end so many nats apart by where they begin; source: measured of opened
#: cases, 10 to 26, docs/proof/robots/run-05.md
APART_NATS = 20.0
NEEDED = 7.0  #: gain [nats, deflated] of an effect to be taken
#: loss [nats] with which a fit is not gone on with, and a spring is not tried again beside what is
#: taken
HOPELESS = 150.0


@dataclass(frozen=True, slots=True, eq=False)
class RobotGain:
    """What an effect at a place gains over a hypothesis without it.

    ``held_out`` [nats] is the same on groups of recordings left out; ``None`` where all are of one
    group. ``apart`` [nats] is what fits of one hypothesis end apart by. ``because``: why the search
    has not taken it, if it has not.
    """

    name: str
    fit: RobotFit
    nats: float
    inflation: float
    held_out: float | None
    apart: float = APART_NATS
    because: str = ""

    @property
    def deflated(self) -> float:
        """The gain that counts [nats]."""
        return self.nats / self.inflation

    def counting(self, now: RobotFit) -> float:
        """The gain that counts over ``now`` [nats], of which voltages and duties are not deflated.

        What a model of joints does wrong over and over makes their gains too large. Voltages tell
        theirs once, however many recordings show them, and no such model plays a part in duties.
        """
        once = now.once - self.fit.once
        return (self.nats - once) / self.inflation + once

    def ahead_of(self, other: RobotGain) -> float:
        """By how much more it gains than another [nats, deflated], beyond what beginnings make."""
        more = self.nats - other.nats
        return float(np.sign(more) * max(0.0, abs(more) - self.apart) / self.inflation)


@dataclass(frozen=True, slots=True, eq=False)
class RobotFindings:
    """What came of a search. ``taken``: in order; ``tried``: all that were fitted, by step.

    ``alike``: for each effect taken, those this data cannot tell from it, with the cosine of their
    traces (1 where only their gains are close). ``screened`` is the first screening, with what
    could be seen at all.
    """

    base: RobotFit
    fit: RobotFit
    taken: tuple[RobotGain, ...]
    tried: tuple[tuple[RobotGain, ...], ...]
    alike: Mapping[str, tuple[tuple[str, float], ...]]
    screened: tuple[Screened, ...]

    @property
    def in_vain(self) -> frozenset[str]:
        """What was fitted to the end, which groups left out tell, and gained nothing anywhere."""
        ended = [g for step in self.tried for g in step if g.held_out is not None]
        return frozenset(g.name for g in ended) - {g.name for g in ended if g.nats > 0.0}


def levelled(gains: Sequence[RobotGain], most: float = math.inf) -> list[RobotGain]:
    """Gains of one step divided by one inflation, the mean of those that gain (or of all).

    The best first. It is no more than ``most``: of few it is chance.

    What is compared is how far each follows the same recordings.
    """
    useful = [g.inflation for g in gains if g.nats > 0.0] or [g.inflation for g in gains]
    common = float(np.exp(np.mean(np.log(useful)))) if useful else 1.0
    common = min(common, most)
    return sorted((replace(g, inflation=common) for g in gains), key=lambda g: -g.deflated)
