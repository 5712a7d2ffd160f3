"""Fits of a whole robot whose replays are exact where they end.

Traces and curves say which way to go; there the recordings are replayed, and the fit goes on from
that, until nothing is gained.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..noise import Noise
from .features import MEANS, RobotKind
from .fit import ENOUGH, RobotFit, Sight
from .model import RobotModel

Floats = NDArray[np.float64]

WIDENED = 3  #: times at most that a curve is made longer for a fit
SHARES = (1.0, 0.6, 0.3, 0.1)  #: of the way that a fit would go, of which the best is gone
SETTLED = 3  #: times at most that exact replays and a fit take turns
REFINED = 3  #: times at most that what nuisances do is taken anew where a fit has led
#: times what traces and curves lead to that fits may gain beyond it in further rounds. Of 56 tries
#: in three opened cases (both robots) none gained more than 0.9 times
AGAIN = 1.0
WORTH = 5.0  #: gain [nats] of the first of them from which there is another


class ExactFits:
    """Fits of some recordings of a model, with some kinds of channels."""

    def __init__(
        self,
        model: RobotModel,
        which: Sequence[int] | None = None,
        kinds: Iterable[RobotKind] = MEANS,
    ) -> None:
        self.model = model
        self.which = list(range(len(model.features)) if which is None else which)
        self.sight = Sight(model, self.which, kinds)

    def thoroughly(
        self,
        names: Sequence[str],
        knobs: Floats,
        noise: Mapping[RobotKind, Noise] | None = None,
        nuisances: Floats | None = None,
        most: float = math.inf,
    ) -> RobotFit:
        """A fit begun as :meth:`begun` says, with what nuisances do where it leads.

        Repeats of a motion follow the first of them until all are replayed in the end. What begins
        to cost more than ``most`` is left there.
        """
        with self.model.following():
            found = self.begun(names, knobs, noise, nuisances, most)
            if found.cost > most:
                return found
            found = self.refined(found)
        return self.replayed(found)

    def begun(
        self,
        names: Sequence[str],
        knobs: Floats,
        noise: Mapping[RobotKind, Noise] | None = None,
        nuisances: Floats | None = None,
        most: float = math.inf,
    ) -> RobotFit:
        """An exact fit that begins with all as believed (or ``nuisances``) but for its effects.

        What nuisances do is left as it is known from elsewhere. One that will cost more than
        ``most`` in the end is left where that shows, its cost a guess.
        """
        ordinary = np.zeros(len(self.model.nuisances)) if nuisances is None else nuisances
        z = np.clip(np.concatenate([ordinary, knobs]), *self.sight.box(names))
        at = RobotFit(tuple(names), z, noise or {}, np.inf)
        self.model.bend(at.settings, at.nuisances)
        self.model.recentre(at.settings, at.nuisances, self.which)
        return self.settle(self.fitted(at.names, at.z, noise), most=most)

    def settle(
        self, found: RobotFit, begun: RobotFit | None = None, most: float = math.inf
    ) -> RobotFit:
        """A fit whose replays are exact where it is: traces and curves only lead there.

        It goes as much of that way as does best, from ``begun`` if that is given. Where traces and
        curves lead to so little that with as much again it costs more than ``most``, it does not go
        there, and half of that is told as gained.
        """
        best = begun
        for left in reversed(range(SETTLED)):
            exact = self.replayed(found) if best is None else self._on_the_way(best, found)
            if best is not None and exact.cost > best.cost - ENOUGH:
                break
            best = exact
            if not left:
                break
            self.model.recentre(best.settings, best.nuisances, self.which)
            found = self.fitted(exact.names, exact.z, exact.noise)
            if found.cost - AGAIN * (exact.cost - found.cost) > most:
                return replace(found, cost=0.5 * (exact.cost + found.cost))
        assert best is not None
        self.model.recentre(best.settings, best.nuisances, self.which)
        return best

    def _on_the_way(self, here: RobotFit, found: RobotFit) -> RobotFit:
        """The best of some shares of the way that a fit would go, by exact replays.

        Where contacts are, traces lead too far more often than not. Shorter shares are tried until
        one does worse than what already is better than ``here``; two at least, so they are
        replayed in pairs.
        """
        best: RobotFit | None = None
        ways = [replace(found, z=here.z + share * (found.z - here.z)) for share in SHARES]
        for k, way in enumerate(ways):
            if k % 2 == 0:
                self.model.ahead([(w.settings, w.nuisances) for w in ways[k : k + 2]], self.which)
            there = self.replayed(way)
            if best is not None and there.cost > best.cost and best.cost < here.cost:
                break
            best = there if best is None or there.cost < best.cost else best
        assert best is not None
        return best

    def refined(self, settled: RobotFit) -> RobotFit:
        """A settled fit that goes on with what nuisances do there, which is where that is left."""
        for _ in range(REFINED):
            before = settled.cost
            self.model.retrace(settled.settings, settled.nuisances)
            further = self.fitted(settled.names, settled.z, settled.noise)
            settled = self.settle(further, settled)
            if settled.cost > before - WORTH:
                break
        return settled

    def around(self, found: RobotFit) -> None:
        """Let the model be exact at a fit, and know what nuisances do there."""
        self.model.retrace(found.settings, found.nuisances)
        self.model.recentre(found.settings, found.nuisances, self.which)

    def replayed(self, found: RobotFit) -> RobotFit:
        """A fit as it is, told anew by replays of that very robot.

        One that the engine cannot run costs more than any other.
        """
        off_rad = self.model.recentre(found.settings, found.nuisances, self.which)
        return self.sight.at(found) if math.isfinite(off_rad) else replace(found, cost=math.inf)

    def fitted(
        self, names: Sequence[str], start: Floats, noise: Mapping[RobotKind, Noise] | None
    ) -> RobotFit:
        """A fit whose knobs are not at the ends of their curves, which are made longer."""
        found = self.sight.fit(names, start, noise)
        for _ in range(WIDENED):
            longer = [name for name, z in found.settings if self.model.curves.widen(name, z)]
            if not longer:
                break
            found = self.sight.fit(names, found.z, found.noise)
        return found
