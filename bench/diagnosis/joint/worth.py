"""What a name takes off a misfit, and what of that a register shows."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from ..observed import Observed
from .fit import Fit
from .model import JointModel, Kind
from .play import STANDING_COUNTS
from .remaining import block_rms, remaining

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

LITTLE = 0.25  #: share of a misfit that a name must explain, where more of it is left
#: share of what is left of a register that a name must take away to be shown by it, where that is
#: more than so many of the least that noise leaves
SHOWN, SEEN = 0.6, 2.0
#: times the mean square that a register may be farther off with a name. Of names of 134 cases of
#: other engines in which a duty was read, one made it more than 1.1; it was not true
FARTHER = 1.5
#: for how long neither goal nor joint moved where a controller's duty is that of its law alone: no
#: ramp, delay or instant of reading is in it; and so many samples of that tell. Assumed
REST_S, ENOUGH = 0.3, 20
REGISTERS = (Kind.DUTY, Kind.VOLTAGE)  #: each judges a part of the signal's path by itself


def rms_of(judge: JointModel, found: Fit) -> float:
    """What a fit leaves of the positions of recordings, as they are [rad]."""
    return block_rms(judge.residuals(found.hypothesis, [found.z])[0], Kind.POSITION)


def explained(
    judges: Collection[JointModel], before: Fit, without: Fit, after: Fit, floor: float
) -> float:
    """Share of the squared misfit above the floor that an effect takes away, in some recordings."""
    was, missing, left = (
        mean_square(judges, fit, Kind.POSITION) for fit in (before, without, after)
    )
    explainable = was - floor**2
    if explainable <= 0.0:
        return 0.0
    return float(np.clip((missing - left) / explainable, -1.0, 1.0))


def explains_little(
    judges: Collection[JointModel], before: Fit, without: Fit, after: Fit, floor: float
) -> bool:
    """Whether an effect explains little of a misfit, and less than is left of it.

    Where another has taken away most, what is little of all may be most of the rest.
    """
    if explained(judges, before, without, after, floor) >= LITTLE:
        return False
    missing, left = (mean_square(judges, fit, Kind.POSITION) for fit in (without, after))
    return missing - left < left - floor**2


def shown(judges: Collection[JointModel], without: Fit, after: Fit) -> bool:
    """Whether a register shows an effect, however little it moves the joint."""
    return shown_share(judges, without, after) > SHOWN


def shown_share(judges: Collection[JointModel], without: Fit, after: Fit) -> float:
    """The most that an effect takes of what is left of a register without it; 0 to 1.

    The duty is compared with what the firmware's law makes of the positions that were read, and a
    voltage with what the supply makes of the current: neither is better for a name that makes up
    for something else.
    """
    most = 0.0
    for missing, left, noise in _registers(judges, without, after):
        if missing > SEEN**2 * noise:
            most = max(most, (missing - left) / (missing - noise))
    return min(1.0, most)


def register_denies(judges: Collection[JointModel], without: Fit, after: Fit) -> bool:
    """Whether a register is much farther off with an effect, however much nearer the motion is.

    That of the duty all the time, or where the joint is at rest: what a motion asks of a law may
    drown what the law itself does.
    """
    seen = [*_registers(judges, without, after), *_at_rest(judges, without, after)]
    return any(left > max(FARTHER * missing, SEEN**2 * noise) for missing, left, noise in seen)


def resting(one: Observed, t_s: Floats) -> Mask:
    """Whether goal and joint have stood still for a while, at times [s] of shape (n,)."""
    times, goals = one.goal
    changed = np.append(-np.inf, times[1:][np.diff(goals) != 0.0])
    last = changed[np.searchsorted(changed, t_s, side="right") - 1]
    samples = one.position
    known = samples.t_s[samples.good], samples.value[samples.good]
    way = np.interp(t_s, *known) - np.interp(t_s - REST_S, *known)
    still = np.abs(way) <= STANDING_COUNTS * samples.quantum
    return np.asarray(still & (t_s - last >= REST_S) & (t_s - known[0][0] >= REST_S))


def _at_rest(
    judges: Collection[JointModel], without: Fit, after: Fit
) -> Iterator[tuple[float, float, float]]:
    """The same of the duty, where joints are at rest; nothing where they hardly ever are."""
    missing, left = (_resting_duties(judges, fit) for fit in (without, after))
    if len(missing) >= ENOUGH:
        noise = next(float(m.floors()[Kind.DUTY]) for m in judges if Kind.DUTY in m.floors())
        yield float(np.mean(missing**2)), float(np.mean(left**2)), noise**2


def _resting_duties(judges: Collection[JointModel], found: Fit) -> Floats:
    """What a fit leaves of duties where joints are at rest and driven."""
    values = [np.zeros(0)]
    for judge in judges:
        for (r, kind), block in remaining(judge, found, driven=True).items():
            if kind is Kind.DUTY:
                values.append(block.value[resting(judge.observed[r], block.t_s)])
    return np.concatenate(values)


def _registers(
    judges: Collection[JointModel], without: Fit, after: Fit
) -> Iterator[tuple[float, float, float]]:
    """Mean squares of every register that was read: without an effect, with it, and of noise."""
    for kind in REGISTERS:
        floors = [float(model.floors()[kind]) for model in judges if kind in model.floors()]
        if floors:
            missing, left = (mean_square(judges, fit, kind) for fit in (without, after))
            yield missing, left, floors[0] ** 2


def mean_square(judges: Collection[JointModel], found: Fit, kind: Kind = Kind.POSITION) -> float:
    """Mean square of what a fit leaves of a register in some recordings; 0 if nobody read it."""
    values = [
        block.value
        for judge in judges
        for (_, one), block in remaining(judge, found).items()
        if one is kind
    ]
    return float(np.mean(np.concatenate(values) ** 2)) if values else 0.0
