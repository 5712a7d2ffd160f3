"""What of an effect is left beside the tolerances: what no nuisance within its bounds imitates.

A size is measured with all else known. Whoever diagnoses is told a mass within 5 % and a friction
within 30 %, and cannot see an effect that these can imitate. So a case's trace, as the case truly
is, is held against the same case without the effect, where every nuisance that moves the joint may
have any value within its bounds (nuisances are uniform there), and every other part, be it another
hidden effect or an ordinary misfit, any size from nothing to its double. The least RMS difference
over the noise floor, in the groups that are for fitting, is what is left.

It is a bounded least squares: tangents by finite differences where the case truly is, then steps,
each of which is rolled out, and tangents mended by what came of it (Broyden, Math. Comp. 19, 1965)
or, where they promised too much, taken anew. What is told was rolled out: a local minimum can make
it too large, nothing too small.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from .case import Case, Hidden
from .legged_case import LeggedHidden
from .nuisances import bounds
from .sizing import EDGE, noise_floor, rms

Floats = NDArray[np.float64]

STEPS = 4  #: at most, with the tangents of one place
ENOUGH = 0.02  #: a step that promises less, in noise floors, is not taken
APART = 0.2  #: tangents that promised so much less than was reached, in floors, are taken anew
STRIDES = (1.0, 0.3)  #: how far tangents reach, at first and anew, in steps of what is free
PART_STEP = 0.2  #: share of another part's size, for its tangent
PART_MOST = 2.0  #: of the size that another part has


@dataclass(frozen=True, slots=True)
class Left:
    """What no nuisance can imitate, and by what the rest is imitated best."""

    ratio: float  #: RMS of the difference over the noise floor
    imitation: Mapping[str, float]  #: values of nuisances, sizes of other parts


@dataclass(frozen=True, slots=True)
class Free:
    """A number of a case that whoever diagnoses does not know."""

    name: str
    now: float  #: in truth
    low: float
    high: float
    step: float  #: the unit in which it is moved: half its tolerance, or a share of a part's size
    part: int | None = None  #: among the other parts; none: a nuisance

    def value(self, units: float) -> float:
        """The number so many steps from the truth."""
        return min(max(self.now + units * self.step, self.low), self.high)


def left_of(case: Case, index: int) -> Left:
    """What is left of one of the hidden effects of a case, beside all else in it."""
    channel = case.hidden[index].effect.channel
    without = case.without(index)
    free = _free(without)
    floor = noise_floor(case.ground.key, channel)
    true = case.fitted_trace(channel)

    def rest_at(units: Floats) -> Floats:
        return true - _moved(without, free, units).fitted_trace(channel)

    return imitated(rest_at, free, floor)


def imitated(rest_at: Callable[[Floats], Floats], free: Sequence[Free], floor: float) -> Left:
    """What is left where a rest is least, with numbers as they are there."""
    low = np.array([(f.low - f.now) / f.step for f in free])
    high = np.array([(f.high - f.now) / f.step for f in free])
    at, rest = least(rest_at, low, high, floor)
    imitation = {f.name: f.value(units) for f, units in zip(free, at.tolist(), strict=True)}
    return Left(rms(rest) / floor, imitation)


def least(
    rest_at: Callable[[Floats], Floats], low: Floats, high: Floats, floor: float
) -> tuple[Floats, Floats]:
    """Where a rest is least within bounds, begun at 0 and as near as the floor asks for; the rest.

    Bounds (n,) have 0 between them and are 2 or more apart.
    """
    at = np.zeros(len(low))
    rest = rest_at(at)
    for stride in STRIDES:
        towards = np.where(high - at > at - low, stride, -stride)
        moved = [rest - rest_at(at + one) for one in np.diag(towards)]
        tangents = np.stack(moved, axis=1) / towards
        hoped = math.inf
        for _ in range(STEPS):
            step: Floats = lsq_linear(tangents, rest, (low - at, high - at), method="bvls").x
            promised = rest - tangents @ step
            hoped = min(hoped, rms(promised))
            if rms(rest) - rms(promised) < ENOUGH * floor:
                break
            tried = rest_at(at + step)
            tangents += np.outer(promised - tried, step) / (step @ step)
            if rms(tried) < rms(rest):
                at, rest = at + step, tried
        if rms(rest) - hoped < APART * floor:
            break
    return at, rest


def _free(case: Case) -> tuple[Free, ...]:
    found = []
    for name, (low, high) in bounds(case.ground.rig.sheet.rated_voltage_v).items():
        now, half = float(getattr(case.nuisances, name)), 0.5 * (high - low)
        found.append(Free(name, now, low, high, half))
    return *found, *of_parts((*case.ordinary, *case.hidden))


def of_parts(parts: Sequence[Hidden | LeggedHidden]) -> Iterator[Free]:
    """Sizes of other parts."""
    for i, part in enumerate(parts):
        high = min(PART_MOST * part.size, part.effect.most)
        yield Free(f"{part.name}.size", part.size, EDGE, high, PART_STEP * part.size, i)


def _moved(case: Case, free: Sequence[Free], units: Floats) -> Case:
    """A case with other values of what is free."""
    told = list(zip(free, units.tolist(), strict=True))
    values: dict[str, Any] = {f.name: f.value(u) for f, u in told if f.part is None}
    parts = [*case.ordinary, *case.hidden]
    for f, u in told:
        if f.part is not None:
            parts[f.part] = dataclasses.replace(parts[f.part], size=f.value(u))
    masks = len(case.ordinary)
    return dataclasses.replace(
        case,
        nuisances=dataclasses.replace(case.nuisances, **values),
        ordinary=tuple(parts[:masks]),
        hidden=tuple(parts[masks:]),
    )
