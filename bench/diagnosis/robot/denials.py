"""What registers say of a fit: other voltages than the model has, or other duties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.effects import Group

from .features import RobotKind
from .fit import RobotFit, voltage_noise
from .model import RobotModel
from .regulated import most_off
from .search import RobotSearch

VOLTS_OFF = 3.0  #: deviations of voltage registers by which they may show another supply
DUTIES_OFF = 4.0  #: deviations of duties from which they show another law
#: share of either below which a name must bring it for registers to ask for it; assumed
MOST = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Denials:
    """Recordings whose registers may deny a fit; ``which`` fit and ``judges`` judge (numbers)."""

    search: RobotSearch
    which: Sequence[int]
    judges: Sequence[int]

    @property
    def model(self) -> RobotModel:
        """The model that is judged."""
        return self.search.model

    def volts_denied(self, found: RobotFit) -> float:
        """How much more voltage servos show than a fit has [V], where that is too much; else 0."""
        more = self.volts_more(found)
        return more if abs(more) > VOLTS_OFF * voltage_noise(self.model, 1).coloured else 0.0

    def volts_more(self, found: RobotFit) -> float:
        """How much more voltage servos show than a fit has [V]; 0 where nobody read it."""
        self.model.recentre(found.settings, found.nuisances, self.judges)
        blocks = self.model.residuals(found.names, found.z, self.judges)
        own = [b.value for (_, kind), b in blocks.items() if kind is RobotKind.VOLTAGE]
        return float(np.mean(np.concatenate(own))) if own else 0.0

    def duties_denied(self, found: RobotFit) -> float:
        """How far duties are off, in deviations, where that is too much; else 0."""
        off = self.duties_off(found)
        return off if off > DUTIES_OFF else 0.0

    def duties_off(self, found: RobotFit) -> float:
        """How far duties that loads show are off, where that is most: :meth:`duties_most`."""
        return self.duties_most(found)[0]

    def duties_most(self, found: RobotFit) -> tuple[float, str]:
        """How far duties that loads show are off from what laws make of recorded angles, and where.

        In deviations, of the joint, kind of joint or leg (or all) where it is most. All recordings
        tell it, as hardly a tolerance does anything about it where it is fitted.
        """
        every = sorted({*self.which, *self.judges})
        self.model.recentre(found.settings, found.nuisances, every)
        blocks = self.model.residuals(found.names, found.z, every)
        own = {r: b for (r, kind), b in blocks.items() if kind is RobotKind.DUTY and len(b.value)}
        return most_off(self.model, own) if own else (0.0, "")

    def restores(self, without: RobotFit, now: RobotFit) -> bool:
        """Whether a register asks for a name: it denies the model, and less than half so with it.

        Voltages do, or duties: these where the two differ by an effect of the controller's, as
        along the recorded angles nothing else plays a part in them. What is left of it then is
        told. Positions of two engines may want another size.
        """
        names = set(now.names).symmetric_difference(without.names)
        laws = [n for n in names if self.model.placed[n].effect.group is Group.CONTROLLER]
        return any(
            before != 0.0 and abs(off(now)) < MOST * abs(before)
            for off in (self.volts_denied, *((self.duties_denied,) if laws else ()))
            if (before := off(without))
        )
