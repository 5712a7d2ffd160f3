"""What an effect changes, against what two sound simulations of one joint differ by.

Such differences repeat, so that gains grow with them as with physics that was left out: however
sure the likelihood is, what changes no more than they do has no name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from .fit import Fit, bounds, prior_cost
from .floor import engines_rad
from .model import JointModel, Kind
from .nuisances import LATE_S
from .remaining import remaining
from .worth import shown

Floats = NDArray[np.float64]

OTHERS = (Kind.DUTY, Kind.VOLTAGE)
#: times the mean square by which two sound simulations differ: what a name must take off that of
#: positions in some group of recordings, and in the mean of all. On 25 rigs of another engine with
#: nothing hidden, whatever a search without this rule found took off 0.99 and 0.24 at most
ONCE, SHARED = 1.25, 0.35
#: the same of a name that is sure (:data:`SURELY`): of two nulls of a third engine in which another
#: name was found without any such rule, the positions of one changed by half of this
SURE_ONCE, SURE_SHARED = 0.1, 0.04
#: gain [nats, deflated] where it was fitted, and on groups left out, from which a name is sure. On
#: 90 rigs of two other engines with nothing hidden, whatever a search without these rules found
#: gained 65 and 28 at most
SURELY = 80.0
#: squares of its rounding that it may take off another register's mean square instead, and the
#: share of that: a duty that is read at another instant than it was made has a rest of many times
#: its rounding, and a wrong instant of reading took up 15 % of one
READ, SHARE = 10.0, 0.3
#: share of positions' mean square by which they may be worse with a name that a register shows. Of
#: a case that was opened (0009 of the twentieth run) a true one made them worse by 0.19
BY_CHANCE = 0.25
#: quantile of their priors within which tolerances are, taken together. Fits shrink what recordings
#: do not show: of 35 rigs with nothing hidden the farthest was at 0.68
BELIEVED = 0.95

Squares = Mapping[Kind, Sequence[float]]  #: mean squares by kind, of every group of recordings


def changes_little(
    models: Sequence[JointModel], without: Fit, with_it: Fit, effect: str, nats: float = 0.0
) -> bool:
    """Whether a fit is hardly nearer to the recordings of some models with an effect than without.

    What takes recordings' positions farther off is no better, whatever another register gains. A
    time of less than :data:`LATE_S` is where a firmware's ticks lie, which nobody knows. What takes
    a strain off tolerances changes much, though recordings are followed no better for it. ``nats``
    is what is gained wherever it was looked: much of it may leave a small trace.
    """
    if within_ticks(with_it, len(models[0].nuisances), effect):
        return True
    if contradicted(models, without, with_it):
        return True
    if strained(models[0], without) and not strained(models[0], with_it):
        return False
    return hardly_better(models, without, with_it, sure=nats > SURELY)


def hardly_better(
    models: Sequence[JointModel], one: Fit, other: Fit, *, sure: bool = False
) -> bool:
    """Whether the other fit is nearer to recordings by no more than two sound engines differ.

    Of a ``sure`` one, by next to nothing at all.
    """
    before, now = (group_squares(models, found) for found in (one, other))
    least = (SURE_ONCE, SURE_SHARED) if sure else (ONCE, SHARED)
    return faint(before, now, engines_rad(models[0]) ** 2, models[0].floors(), least)


def contradicted(models: Sequence[JointModel], without: Fit, with_it: Fit) -> bool:
    """Whether positions are farther off with an effect, by what it would have to take off them.

    What a controller's register shows is made of its own instants and filters, which nobody
    documents; a cause that is in the motion does not make the motion worse. What takes most of what
    is left of such a register may: where something else moves a joint about, fits of all else
    follow that by chance.
    """
    before, now = (group_squares(models, found)[Kind.POSITION] for found in (without, with_it))
    worse = float(np.mean(np.array(now) - np.array(before)))
    bearable = SHARED * engines_rad(models[0]) ** 2
    if worse > bearable and shown(models, without, with_it):
        bearable = max(bearable, BY_CHANCE * float(np.mean(before)))
    return worse > bearable


def strained(model: JointModel, found: Fit) -> bool:
    """Whether tolerances, taken together, are further off than anybody believes."""
    low, high = bounds(model, found.hypothesis)
    free = int(np.sum((low < high)[: len(model.nuisances)]))
    return 2.0 * prior_cost(model, found.z) > float(chi2.ppf(BELIEVED, free))


def within_ticks(found: Fit, count: int, effect: str) -> bool:
    """Whether all sizes of an effect are times, and less than a firmware's ticks may make.

    ``count`` is the number of nuisances in the fit's vector.
    """
    sizes = [
        (knob.parameter.unit, knob.value(z))
        for knob, z in zip(found.hypothesis.knobs, found.z[count:].tolist(), strict=True)
        if knob.effect == effect and not knob.parameter.shape
    ]
    return all(unit == "s" and abs(value) < LATE_S for unit, value in sizes)


def faint(
    before: Squares,
    now: Squares,
    engines: float,
    rounding: Mapping[Kind, float],
    least: tuple[float, float] = (ONCE, SHARED),
) -> bool:
    """Whether what a name takes off mean squares is next to nothing.

    ``engines`` is the mean square by which two simulations of the joint differ [rad^2],
    ``rounding`` the deviation that a register's step makes; ``least`` times the engines' it must
    take off positions in some group, and in the mean of all.
    """
    fall = {kind: np.array(some) - np.array(now[kind]) for kind, some in before.items()}
    seen = fall[Kind.POSITION]
    if seen.max() > least[0] * engines and seen.mean() > least[1] * engines:
        return False
    return not any(
        (fall[kind] > np.maximum(READ * rounding[kind] ** 2, SHARE * np.array(before[kind]))).any()
        for kind in OTHERS
        if kind in fall
    )


def group_squares(models: Sequence[JointModel], found: Fit) -> dict[Kind, list[float]]:
    """Mean square that a fit leaves of every kind in the recordings of every group.

    Of a joint that is let go only what came before: see :func:`~.remaining.while_driven`.
    """
    values: dict[Kind, dict[object, list[Floats]]] = {}
    for model in models:
        for (r, kind), block in remaining(model, found, driven=True).items():
            group = id(model), model.observed[r].group
            values.setdefault(kind, {}).setdefault(group, []).append(block.value)
    return {
        kind: [float(np.mean(np.concatenate(some) ** 2)) for some in groups.values()]
        for kind, groups in values.items()
    }
