"""Two ways to choose what to walk next: the thesis's grid, and CMA-ES over all of the gait.

Both are given the same means: a function that walks candidates and says what came of it, and a
budget of walks. Each is a plain function of its seed and of the outcomes, so that the same walks
are asked for again when a search goes on.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from typing import Any

import cma
import numpy as np

from .candidate import Candidate, Floats, GaitSearchError, Space
from .outcome import Outcome

#: The thesis's grid has so many values a parameter.
GRID_VALUES = 10
#: Candidates a generation: about 4 + 3 ln 7, the usual number for seven dimensions, made even for
#: two or four processes (N. Hansen, The CMA Evolution Strategy: A Tutorial, 2016).
POPULATION = 8
#: Steps that the first candidates are from a gait to begin with; assumed.
NEAR = 0.5
#: Draws for a candidate that the legs can reach, before it is taken as it is.
REDRAWS = 100

Evaluate = Callable[[Sequence[Candidate]], list[Outcome]]
Reachable = Callable[[Candidate], bool]


class Method(enum.Enum):
    """How candidates are chosen."""

    CMA = "cma"
    GRID = "grid"


def grid_values(budget: int) -> int:
    """Values of ``v_left`` and of ``v_right`` that a budget of walks pays for, at most ten."""
    return min(GRID_VALUES, math.isqrt(budget))


def grid_search(
    space: Space, evaluate: Evaluate, reachable: Reachable, budget: int
) -> list[Outcome]:
    """Walk the thesis's grid over ``v_left`` and ``v_right``, as fine as the budget allows.

    Strides the legs cannot reach are left out; they cost no walk.
    """
    candidates = space.grid(grid_values(budget))
    return evaluate([candidate for candidate in candidates if reachable(candidate)])


def evolution(
    space: Space,
    evaluate: Evaluate,
    reachable: Reachable,
    budget: int,
    seed: int,
    begin: Candidate | None = None,
) -> list[Outcome]:
    """CMA-ES (N. Hansen) on ranks that put every allowed walk first.

    From the original gait, or from another to ``begin`` with, which is walked first, and the others
    nearer to it.

    It only ever compares candidates, so ranking them is all the constraint handling it needs:
    allowed ones by speed, forbidden ones after them by how far they are from being allowed.
    Candidates the legs cannot reach are drawn again and cost no walk.
    """
    chance = np.random.default_rng(seed)

    def normal(*shape: int) -> Floats:
        return chance.standard_normal(shape)

    options = {
        "bounds": [[axis.low for axis in space.axes], [axis.high for axis in space.axes]],
        "popsize": POPULATION,
        "randn": normal,  # not NumPy's global random numbers
        "seed": float("nan"),
        "verbose": -9,
        "verb_log": 0,
    }
    start = np.zeros(len(space.axes)) if begin is None else space.point(begin)
    strategy = cma.CMAEvolutionStrategy(start, 1.0 if begin is None else NEAR, options)
    outcomes: list[Outcome] = []
    while len(outcomes) < budget and not strategy.stop():
        points = [
            _reached(point, strategy, space, reachable)
            for point in strategy.ask()[: budget - len(outcomes)]
        ]
        if begin is not None and not outcomes:
            points[0] = start
        found = evaluate([space.candidate(point) for point in points])
        outcomes += found
        if len(points) == POPULATION:
            strategy.tell(points, [outcome.rank for outcome in found])
    return outcomes


def _reached(point: Floats, strategy: Any, space: Space, reachable: Reachable) -> Floats:
    for _ in range(REDRAWS):
        if reachable(space.candidate(point)):
            return point
        (point,) = strategy.ask(1)
    raise GaitSearchError(
        f"none of {REDRAWS} gaits drawn can be reached by the legs: check [gait] in the robot file"
    )
