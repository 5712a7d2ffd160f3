"""What placed effects do to the motions of a whole robot, replayed at a few sizes each.

Between its replays a curve is interpolated; curves add up. All else is as believed in them, and so
where a fit has come to, a curve goes as steeply as replays beside all that is fitted say
(:meth:`Curves.bend`): beside soft tips a spring may do the opposite of what it does alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .effects import Placed
from .features import RobotKind
from .pool import Job

Floats = NDArray[np.float64]
Rows = dict[RobotKind, Floats]

GRID = (0.3, 1.0, 3.0, 8.0)  #: of a knob, in first tries, at which an effect is replayed
FARTHER = 2.5  #: times the last of them that is replayed next, where a fit has come to the end
LARGER = 8.0  #: times a first try that moves nothing, which is tried next
NEAR = 0.3  #: step to either side for how steep a curve is, of a knob or its value: less is rough
BENT = 5.0  #: such steps as far as which that is believed
LEAST_RAD = 0.3e-3  #: RMS of joint rows below which it moves nothing that one could compare


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """How much steeper a curve is than alone, for one unit of the knob, around ``z``."""

    z: float
    steeper: Floats
    far: float  #: from ``z``, as far as which it is so

    def at(self, z: float) -> Floats:
        """What that adds to the curve."""
        return self.steeper * float(np.clip(z - self.z, -self.far, self.far))


class Curves:
    """Rows of each motion against the knobs of placed effects.

    ``plain`` are the rows of each motion as believed, ``run`` replays some jobs into rows.
    """

    def __init__(
        self,
        placed: Mapping[str, Placed],
        plain: Mapping[int, Rows],
        run: Callable[[Sequence[Job]], list[Rows]],
    ) -> None:
        self._placed, self._plain, self._run = placed, plain, run
        self._curves: dict[tuple[str, int], PchipInterpolator] = {}
        self._first: dict[str, float] = {}  #: first tries that were too small, as they are now
        self._beyond: dict[str, list[float]] = {}  #: knobs that were replayed beyond the grid
        self._bends: dict[tuple[str, int], Bend] = {}

    def prepare(self, names: Sequence[str], motions: Sequence[int]) -> None:
        """Replay effects at their first tries."""
        self._replay(names, motions, self.tries)

    def _replay(
        self,
        names: Sequence[str],
        motions: Sequence[int],
        knobs: Callable[[str], Sequence[float]],
    ) -> None:
        self._run([Job(m, ((n, z),), short=True) for m in motions for n in names for z in knobs(n)])

    def first_z(self, name: str) -> float:
        """The knob of an effect's first try."""
        return self._first.get(name, self._placed[name].first_z)

    def tries(self, name: str) -> list[float]:
        """Knobs at which an effect is screened: its first tries, and of one sign a large one."""
        first, (low, high) = self.first_z(name), self._placed[name].knob.bounds
        large = min(high, GRID[-1] * first)
        few = [first, *(z for z in self._placed[name].levels if first < z < large)]
        return [*few, large] if low >= 0.0 and large > first else few

    def enlarge(self, names: Sequence[str], motions: Sequence[int]) -> None:
        """Make first tries larger that move nothing of the first of some motions; replay those."""
        m = motions[0]
        for name in names:
            larger = min(self._placed[name].knob.bounds[1], LARGER * self._placed[name].first_z)
            if name in self._first or larger <= self.first_z(name) or self._placed[name].levels:
                continue
            (rows,) = self._run([Job(m, ((name, self.first_z(name)),), short=True)])
            moved = rows[RobotKind.JOINTS] - self._plain[m][RobotKind.JOINTS]
            if np.sqrt(np.mean(moved**2)) < LEAST_RAD:
                self._first[name] = larger
        self.prepare(names, motions)

    def widen(self, name: str, z: float) -> bool:
        """Let the curve of an effect go farther, if a knob has come to its end; whether it does."""
        grid = self._grid(name)
        low, high = self._placed[name].knob.bounds
        end = grid[-1] if z > 0.0 else grid[0]
        farther = min(high, max(low, FARTHER * end))
        if abs(z) < 0.98 * abs(end) or z * end <= 0.0 or farther == end:
            return False
        self._beyond.setdefault(name, []).append(farther)
        for key in [key for key in self._curves if key[0] == name]:
            del self._curves[key]
        return True

    def _grid(self, name: str) -> list[float]:
        low, high = self._placed[name].knob.bounds
        sizes = [self.first_z(name) * x for x in GRID]
        middle = sizes[1:3]
        both = [-z for z in reversed(middle)] + middle if low < 0.0 else sizes
        more = (*self._placed[name].levels, *self._beyond.get(name, ()))
        inside = [min(high, max(low, z)) for z in (*both, *more)]
        return sorted({z for z in inside if z != 0.0})

    def trace_at(self, name: str, z: float, m: int) -> Rows:
        """What an effect does to a motion at a value of its knob, for one unit of it."""
        (rows,) = self._run([Job(m, ((name, z),), short=True)])
        return {
            kind: np.nan_to_num((rows[kind] - base) / z) for kind, base in self._plain[m].items()
        }

    def _curve(self, name: str, m: int) -> PchipInterpolator:
        """What an effect does to a motion against its knob: all kinds' rows after each other."""
        key = (name, m)
        if key not in self._curves:
            self._replay([name], [m], self._grid)
            zs = [0.0]
            values = [np.zeros(sum(len(v) for v in self._plain[m].values()))]
            base = np.concatenate(list(self._plain[m].values()))
            for z in self._grid(name):
                (rows,) = self._run([Job(m, ((name, z),), short=True)])
                moved = np.concatenate(list(rows.values())) - base
                if np.isfinite(moved).any():
                    zs.append(z)
                    values.append(np.nan_to_num(moved))
            order = np.argsort(zs)
            self._curves[key] = PchipInterpolator(
                np.array(zs)[order], np.array(values)[order], axis=0, extrapolate=True
            )
        return self._curves[key]

    def bend(
        self,
        settings: tuple[tuple[str, float], ...],
        nuisances: tuple[float, ...],
        motions: Sequence[int],
    ) -> None:
        """Let curves be as steep as replays around some settings and nuisances are."""
        self._bends = {}
        for k, (name, z) in enumerate(settings):
            step = NEAR * max(1.0, abs(z))
            low, high = np.clip([z - step, z + step], *self._placed[name].knob.bounds).tolist()
            sides = [(*settings[:k], (name, x), *settings[k + 1 :]) for x in (low, high)]
            jobs = [Job(m, s, nuisances=nuisances, short=True) for m in motions for s in sides]
            found = [np.concatenate(list(rows.values())) for rows in self._run(jobs)]
            for m, below, above in zip(motions, found[::2], found[1::2], strict=True):
                curve = self._curve(name, m)
                ends = np.clip([low, high], curve.x[0], curve.x[-1])
                alone = curve(ends[1]) - curve(ends[0])
                steeper = np.nan_to_num((above - below - alone) / (high - low))
                self._bends[name, m] = Bend(z, steeper, BENT * step)

    def effects(self, m: int, settings: Sequence[tuple[str, float]]) -> Rows:
        """What effects together do to a motion, as the curves have it."""
        base = self._plain[m]
        total = np.zeros(sum(len(v) for v in base.values()))
        for name, z in settings:
            curve = self._curve(name, m)
            total += curve(np.clip(z, curve.x[0], curve.x[-1]))
            if (name, m) in self._bends:
                total += self._bends[name, m].at(z)
        ends = np.cumsum([len(v) for v in base.values()])[:-1]
        return dict(zip(base, np.split(total, ends), strict=True))
