"""Whether what is left is noise, what two sound simulations may differ by, or unexplained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .fit import Fit, fit
from .floor import engines_rad, tolerance
from .model import Blocks, JointModel, Kind
from .remainder import Remainder, remainder
from .remaining import block_rms, remaining

STRUCTURE = 0.5  #: of the noise floor: a predictable rest below it says nothing
ENGINES = 1.2  #: times what two engines usually differ by: so large a rest may be that alone
#: times noise and engines together that a rest may be before it is called unexplained, predictable
#: or not: of 30 nulls on rigs of two other engines it was 1.74 at most where it was looked at once
MISFIT = 2.1
#: roundings, and share of what is believed, from which volts that nothing explains are no noise: of
#: 241 answers of other engines in which a voltage was read 239 leave 3.3 roundings at most, the two
#: others lacked an effect
VOLTS, LEVEL = 5.0, 0.02
STRUCTURE_SHARE = 0.15  #: of the squared rest that must be predictable
STRUCTURE_AGREEING = 0.6  #: share of the recordings that must agree


@dataclass(frozen=True, slots=True)
class Rest:
    """What a fit leaves of the recordings that judge it, and what can be predicted of that."""

    blocks: Blocks
    remainder: Remainder
    structured: bool  #: whether it is called unexplained

    @property
    def foretold(self) -> float:
        """The square of what is foretold, where that is no noise [rad^2]."""
        return self.remainder.predicted_rad**2 if self.structured else 0.0


def rest_of(model: JointModel, judge: JointModel, found: Fit, floor: float, seed: int = 0) -> Rest:
    """What a fit to ``model`` leaves of ``judge``, which may be the same.

    Nuisances are known no better than the recordings that were fitted tell them, and a little off
    there may be much where a motion is another. So a rest that seems structured is looked at again
    after a fit to all recordings: what tolerances take up there lacks no physics.
    """
    rest = _rest(judge, found, floor, seed)
    if judge is model or not rest.structured:
        return rest
    everything = model.beside(judge)
    return _rest(judge, fit(everything, found.hypothesis, found.z, found.noise), floor, seed)


def _rest(judge: JointModel, found: Fit, floor: float, seed: int) -> Rest:
    blocks = remaining(judge, found)
    told = remainder(judge, blocks, seed)
    rms = block_rms(blocks, Kind.POSITION)
    return Rest(blocks, told, is_structured(told, rms, floor, engines_rad(judge)))


def volts_left(model: JointModel, found: Fit) -> float:
    """What a fit leaves of the voltage that was read [V], where that is more than noise; else 0."""
    rounding = model.floors().get(Kind.VOLTAGE)
    if rounding is None:
        return 0.0
    left = block_rms(remaining(model, found, driven=True), Kind.VOLTAGE)
    return left if left > max(VOLTS * rounding, LEVEL * model.base.supply.voltage_v) else 0.0


def is_worse(before_rad: float, after_rad: float, floor: float) -> bool:
    """Whether names leave more of the recordings that judge than none do, and more than noise."""
    return after_rad > max(before_rad, tolerance(floor))


def is_structured(rest: Remainder, left_rad: float, floor: float, engines: float) -> bool:
    """Whether a rest is predictable enough, or so large, that it is called unexplained.

    ``floor`` is the noise's deviation, ``engines`` what two engines may differ by [rad].
    """
    return left_rad > MISFIT * float(np.hypot(floor, engines)) or bool(
        rest.predicted_rad > np.hypot(STRUCTURE * floor, ENGINES * engines)
        and rest.share > STRUCTURE_SHARE
        and rest.agreeing >= STRUCTURE_AGREEING
    )
