"""What small things do to a robot, weighed together: half of them one way in every replay.

Where a foot sticks and where it slips hangs on everything, so that two replays of nearly one robot
differ by more than what was changed. Changed one by one, each thing is told by one replay, and has
the roughness of that one and of the plain one. Changed all at once, by a design whose columns are
orthogonal, each is told by all replays. Sources: H. Hotelling, Some improvements in
weighing and other experimental techniques, 1944; R. E. A. C. Paley, On orthogonal matrices, 1933.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import count

import numpy as np
from numpy.typing import NDArray

from .curves import Rows
from .features import Features, RobotKind
from .nuisances import Trial
from .pool import Job

Floats = NDArray[np.float64]
Settings = tuple[tuple[str, float], ...]  #: placed effects and values of their knobs
Shown = Mapping[str, Rows]  #: what each trial does to a motion, for one unit of it

#: of a trial's size, either way; together that is as far as a robot within its tolerances is from
#: what is believed. Foretells robots within tolerances better than the whole size (two robots)
LEVEL = 0.5
FEW = 8  #: replays that say whether what is known still holds
#: mean square of what is not foretold of those, over that of how they differ, up to which it does.
#: What was weighed of the robot itself leaves 0.12 of other replays
HOLDS = 0.18


def levels(trials: Sequence[Trial]) -> Floats:
    """How much of each trial's size (columns) every replay has (rows), in an order of no meaning.

    What goes one way only is there in half of them. Every replay has its opposite, so that what two
    things do together, as a punch in a weak motor, counts as neither. Source: G. E. P. Box and
    J. S. Hunter, The 2^(k-p) fractional factorial designs, 1961.
    """
    half = _orthogonal(len(trials) + 1)[:, 1 : len(trials) + 1]
    signs = np.concatenate([half, -half])
    one_way = np.array([trial.one_way for trial in trials])
    found: Floats = LEVEL * np.where(one_way, 0.5 * (signs + 1.0), signs)
    return found[np.random.default_rng(3).permutation(len(found))]


def _orthogonal(least: int) -> Floats:
    """The smallest matrix of +-1 of Paley's first kind with so many rows: a first column of 1."""
    primes = (q for q in count(3, 4) if all(q % d for d in range(2, int(q**0.5) + 1)))
    q = next(q for q in primes if q + 1 >= least)
    squares = {x * x % q for x in range(1, q)}
    sign = np.array([0.0] + [1.0 if x in squares else -1.0 for x in range(1, q)])
    found = np.ones((q + 1, q + 1))
    found[1:, 0] = -1.0
    found[1:, 1:] = sign[np.subtract.outer(np.arange(q), np.arange(q)) % q] + np.eye(q)
    return found * found[:, :1]


def weighed(weights: Floats, replays: Sequence[Rows]) -> list[Rows]:
    """What each trial does, for its whole size, of replays with so much of each (rows of both).

    Rows that are not in every replay are 0.
    """
    traces: list[Rows] = [{} for _ in range(weights.shape[1])]
    for kind in replays[0]:
        own, apart = _about_mean(weights, replays, kind)
        for trace, rows in zip(traces, np.linalg.lstsq(own, apart, rcond=None)[0], strict=True):
            trace[kind] = rows
    return traces


def unforetold(weights: Floats, replays: Sequence[Rows], traces: Sequence[Rows]) -> float:
    """Mean square of what traces do not foretell of how replays' joints differ, over all of it."""
    own, apart = _about_mean(weights, replays, RobotKind.JOINTS)
    seen = apart.any(axis=0)
    left = apart - own @ np.array([trace[RobotKind.JOINTS] for trace in traces])
    return float(np.sum(left[:, seen] ** 2) / max(np.sum(apart**2), 1e-30))


def _about_mean(weights: Floats, replays: Sequence[Rows], kind: RobotKind) -> tuple[Floats, Floats]:
    """Weights and rows of one kind about their means, of replays that the engine could run."""
    every = np.array([replay[kind] for replay in replays])
    ran = ~np.isnan(every).all(axis=1) if every.shape[1] else np.ones(len(every), bool)
    if not ran.any():
        return 0.0 * weights, np.zeros_like(every)
    own, rows = weights[ran], every[ran]
    rows = np.where(np.isnan(rows).any(axis=0), 0.0, rows)
    return own - own.mean(axis=0), rows - rows.mean(axis=0)


class Weighing:
    """What some trials do to each of some motions, wherever it was asked.

    ``run`` replays some jobs into rows.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        motions: Sequence[Features],
        run: Callable[[Sequence[Job]], list[Rows]],
    ) -> None:
        self._trials, self._motions, self._run = trials, motions, run
        self._levels = levels(trials)
        self._weighed: list[tuple[int, list[Rows]]] = []  #: by motion, in order

    def known(self, m: int, settings: Settings, nuisances: tuple[float, ...]) -> Shown:
        """What trials do to a motion of a robot: as was weighed elsewhere if that holds, or anew.

        A few replays say whether it holds, and which of it best. Where a robot is changed little,
        it does; and a walk with a weight is often moved as one without.
        """
        found = None
        if elsewhere := self._elsewhere(m):
            few = self._replayed(m, settings, nuisances, self._levels[:FEW])
            off = [unforetold(self._levels[:FEW], few, known) for known in elsewhere]
            if min(off) < HOLDS:
                found = elsewhere[int(np.argmin(off))]
        if found is None:
            replays = self._replayed(m, settings, nuisances, self._levels)
            found = weighed(self._levels, replays)
            self._weighed.append((m, found))
        return {
            trial.name: {kind: rows / trial.size for kind, rows in trace.items()}
            for trial, trace in zip(self._trials, found, strict=True)
        }

    def _elsewhere(self, m: int) -> list[list[Rows]]:
        """All that was weighed, in the rows of a motion; not of motions that lack some of them."""
        found = []
        for other, traces in self._weighed:
            own = self._motions[other].rows_of(self._motions[m])
            if own is not None:
                found.append([{kind: t[kind][rows] for kind, rows in own.items()} for t in traces])
        return found

    def _replayed(
        self, m: int, settings: Settings, nuisances: tuple[float, ...], weights: Floats
    ) -> list[Rows]:
        names = [trial.name for trial in self._trials]
        told = [
            tuple((n, x) for n, x in zip(names, row, strict=True) if x) for row in weights.tolist()
        ]
        return self._run([Job(m, settings, t, nuisances, short=True) for t in told])
