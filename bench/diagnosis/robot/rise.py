"""How a robot stands up before it walks: means of its joints over windows of time until then.

It lies on its belly and rises on all feet, which drag over the floor under the largest load of the
whole recording. What chance makes of that is small, as every robot begins alike: other starts move
these means by a milliradian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .features import APART_S, Features
from .gait import WINDOW_S, Bins

Floats = NDArray[np.float64]

LONGEST_S = 3.0  #: of what is compared, from the beginning; assumed
SHORTEST_S = 1.0  #: below which nothing is: a robot that stands has not risen; assumed


@dataclass(frozen=True, slots=True, eq=False)
class Rise:
    """Windows of every joint of one recording; rows are joint by joint, as many for each.

    ``recorded`` [rad] is NaN where nobody looked.
    """

    sample_s: tuple[Floats, ...]
    windows: int
    recorded: Floats

    @classmethod
    def of(cls, features: Features) -> Rise | None:
        """The windows before a robot walks; None where it does not, or does so at once."""
        if features.phase is None:
            return None
        begins = features.phase.t_s[np.isfinite(features.phase.cycles)]
        windows = int(min(begins.min(initial=np.inf), LONGEST_S) / WINDOW_S)
        if windows * WINDOW_S < SHORTEST_S:
            return None
        course = features.course
        rise = cls(course.sample_s, windows, np.empty(0))
        return cls(course.sample_s, windows, rise.rows(course.position_rad))

    @property
    def end_s(self) -> float:
        """When it is over [s]."""
        return self.windows * WINDOW_S

    @property
    def t_s(self) -> Floats:
        """Times that stand for rows, the joints apart (rows,)."""
        own = (np.arange(self.windows) + 0.5) * WINDOW_S
        starts = APART_S * np.arange(len(self.sample_s))
        return np.asarray((starts[:, None] + own).ravel(), np.float64)

    def rows(self, values: Sequence[Floats]) -> Floats:
        """Means of something sampled with the positions (rows,)."""
        found = np.full((len(self.sample_s), self.windows), np.nan)
        for own, t, value in zip(found, self.sample_s, values, strict=True):
            means = Bins.of_time(t, 0.0).within(t, (0.0, self.end_s)).mean(value)[: self.windows]
            own[: len(means)] = means
        return found.ravel()
