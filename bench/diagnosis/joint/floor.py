"""How small a misfit can be: rounding, and the spread of repeats of one experiment."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.drive import fields

from ..noise import Block
from ..observed import Observed
from .model import Blocks, Hypothesis, JointModel, Kind

Floats = NDArray[np.float64]

ENGINE_RAD = 0.0015  #: what two sound simulations of a usual joint differ by, band and all
SOUND_RAD = 0.0010  #: the same without dry friction, tolerances fitted; see docs on two engines
#: share by which the way that goals go may be another: loops that write them run at other instants
#: each time, and slow ones miss the ends of a motion; assumed
SAME_WAY = 0.04
REPEATS = 0.05  #: assumed: share by which dry friction is another from one motion to the next


def tolerance(floor_rad: float) -> float:
    """Deviation [rad] below which a difference between a model and a recording is no physics."""
    return float(np.hypot(floor_rad, ENGINE_RAD))


def noise_floor(observed: Sequence[Observed], blocks: Blocks) -> float:
    """Deviation [rad] of a position that a perfect model would leave.

    Rounding to the register's step; where an experiment was repeated, how differently a model's
    residuals ``blocks`` come out in the repeats, if that is more: what is the same in all repeats,
    the model's own error, cancels, and so do goals that came at other instants.
    """
    return max(_rounding(observed), _repeated(observed, blocks) or 0.0)


def judged_floor(floor_rad: float, judged: Sequence[Observed], left: Blocks) -> float:
    """That of recordings that were fitted, or less [rad], where repeats that judge differ by less.

    ``left`` are their residuals. Those that were fitted may differ as what is the matter falls on
    another instant in each: a servo that lets go before a host tells it to, at a time of its own.
    """
    differ = _repeated(judged, left)
    return floor_rad if differ is None else min(floor_rad, max(_rounding(judged), differ))


def _rounding(observed: Sequence[Observed]) -> float:
    return float(max(o.position.quantum for o in observed) / np.sqrt(12.0))


def _repeated(observed: Sequence[Observed], blocks: Blocks) -> float | None:
    """Deviation [rad] by which residuals differ in repeats of experiments; None without any."""
    groups: dict[str, list[int]] = {}
    for r, one in enumerate(observed):
        if (r, Kind.POSITION) in blocks:
            groups.setdefault(one.group, []).append(r)
    squares = [
        square
        for some in groups.values()
        for a, b in itertools.pairwise(some)
        if same_goals(observed[a], observed[b])
        and (square := _difference(blocks[a, Kind.POSITION], blocks[b, Kind.POSITION])) is not None
    ]
    return float(np.sqrt(np.mean(squares))) if squares else None


def same_goals(one: Observed, other: Observed) -> bool:
    """Whether the goals of two recordings of a group go as far, as those of repeats do.

    An experiment may be done again a little farther or faster, under the name that it had.
    """
    ways = [float(np.sum(np.abs(np.diff(each.goal[1])))) for each in (one, other)]
    return bool(abs(ways[0] - ways[1]) <= SAME_WAY * max(ways) + one.position.quantum)


def _difference(one: Block, other: Block) -> float | None:
    """Variance of a single repeat, from the difference of two at like times since the start."""
    inside = one.t_s <= other.t_s[-1]
    if inside.sum() < 10:
        return None
    difference = np.interp(one.t_s[inside], other.t_s, other.value) - one.value[inside]
    return float(np.mean(difference**2) / 2.0)


def engines_rad(model: JointModel) -> float:
    """What two sound simulations of a joint may differ by, as its robot file has it [rad].

    Dry friction holds a joint anywhere within friction over stiffness of where it would rest
    without (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994: stiction and
    presliding), and lets it lag by as much when it moves. Friction is the same from one motion to
    the next, and from one way to reckon it to another, to some per cent; that share of the band is
    what no model knows.
    """
    bands = [held_band_rad(model, r) for r in range(len(model.observed))]
    return float(np.hypot(SOUND_RAD, REPEATS * np.sqrt(np.mean(np.square(bands)))))


def held_band_rad(model: JointModel, r: int) -> float:
    """How far to either side dry friction can hold the joint of one recording [rad], as believed.

    Friction at rest over the stiffness of the position law and of gravity, which the mean over the
    recorded angles has. 0 where no position law holds the joint.
    """
    one = model.observed[r]
    believed = model.candidate(Hypothesis(), np.zeros(len(model.nuisances)), r)
    drive, start = believed.drive, one.replay.start
    gain = float(max(start[fields.GAIN_CW], start[fields.GAIN_CCW])) * drive[fields.GAIN_SCALE]
    if start[fields.MODE] != fields.MODE_POSITION or gain <= 0.0:
        return 0.0
    stall = drive[fields.TORQUE_CONSTANT] * believed.voltage_v / drive[fields.RESISTANCE]
    angles, load = one.position.value[one.position.good], believed.load
    gravity = np.mean(load.sine_nm) * np.mean(np.cos(angles))
    gravity += np.mean(load.cosine_nm) * np.mean(np.sin(angles))
    stiffness = gain * stall + max(0.0, float(gravity))
    return float((drive[fields.COULOMB] + drive[fields.STRIBECK]) / stiffness)
