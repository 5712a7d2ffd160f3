"""Other sizes of an effect in a fit: recordings that judge are of other loads, and may say more."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .causes import ENGINES_SHARE
from .fit import RobotFit
from .search import RobotSearch

SIZES = (-1.0, -0.5, 0.5, 1.0)  #: of what two engines differ by, that a name is asked for at
BETWEEN = (
    0.25,
    0.125,
    0.0625,
    0.03,
)  #: the same, aside of the best, where a little decides; assumed


def _at_other_sizes(
    search: RobotSearch, now: RobotFit, name: str, shares: Sequence[float]
) -> list[RobotFit]:
    """A fit with other sizes of one of its effects, as far aside as two engines differ about it."""
    at = len(now.z) - len(now.names) + now.names.index(name)
    low, high = (ends[at] for ends in search.sight.box(now.names))
    made = [replace(now, z=now.z.copy()) for _ in shares]
    for fit, share in zip(made, shares, strict=True):
        fit.z[at] = np.clip((1.0 + share * ENGINES_SHARE) * now.z[at], low, high)
    return made


def best_size(
    search: RobotSearch,
    now: RobotFit,
    name: str,
    cost: Callable[[RobotFit], float],
    steps: Sequence[float] = (),
) -> tuple[RobotFit, float]:
    """The fit at the size of one of its effects that costs least, and its cost; itself if it does.

    Of a few sizes, and then of those that are each of ``steps`` aside of the best so far.
    """
    tried = {0.0: (cost(now), now)}

    def ask(shares: Sequence[float]) -> None:
        made = _at_other_sizes(search, now, name, shares)
        tried.update((s, (cost(fit), fit)) for s, fit in zip(shares, made, strict=True))

    def best() -> float:
        return min(tried, key=lambda share: tried[share][0])

    ask(SIZES)
    for step in steps:
        at = best()
        ask([share for share in (at - step, at + step) if abs(share) <= max(SIZES)])
    least, fit = tried[best()]
    return fit, least
