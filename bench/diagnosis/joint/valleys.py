"""Out of the first hollow: fits whose numbers make up for each other.

Numbers like a heat resistance and its time constant, or a spring and where it rests, lie in a long,
bent and rough valley, in which least squares stop early. So each number that shapes an effect is
moved by hand and held while the others are fitted; if that leads further down, the fit goes on
from there.

Nuisances that have strayed far stand in for what a hypothesis lacks, and a fit of the effect that
it lacked begins among them: with both there are two causes for one misfit, in a valley that is not
the deepest. So it is begun once more where all nuisances are as believed.

Where a joint comes to rest depends on friction in steps, and so does the likelihood, the more the
less noise is left: from there no small change leads on. So a hypothesis that is taken is begun once
more with more and with less friction of either kind.

A command that comes late holds a whole number of ticks later, so that the likelihood has steps in
a time, and instants of samples that may be off make up for what is wrong with it. So times of what
is taken are moved by two ticks, too, as far as that leads on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from sim.effects import catalogue

from ..knobs import Knob
from .fit import TICKS_S, Fit, fit
from .model import JointModel
from .nuisances import WITHIN
from .screening import screen

MOVE = 0.7  #: in units of a shape; of the value, for a number that is an amount
LOOSE = 0.1  #: least of these units for an amount
DEEPER = 3.0  #: gain [nats] that counts: friction and rounding leave the likelihood rough
#: gain [nats] for which times are moved: fits of one hypothesis have ended 25 apart by where they
#: began, and what is as likely within that is told by what is believed of instants
LATE = 25.0
WALKS = 4  #: how often the best move is followed
STRAYED = 0.9 * WITHIN  #: deviations of a nuisance that stands in for something else
FRICTION = ("coulomb_level", "viscous_level")  #: nuisances with which fits are begun elsewhere
AWAY = 1.5  #: deviations of these
ROUNDS = 3  #: of fitting and estimating the noise, as where an effect is confirmed


def explore(model: JointModel, found: Fit, effect: str) -> Fit:
    """The fit, or a deeper one with the numbers of an effect elsewhere."""
    count = len(model.nuisances)
    own = [count + i for i, k in enumerate(found.hypothesis.knobs) if k.effect == effect]
    return _walked(model, found, own, _far, DEEPER) if len(own) > 1 else found


def _walked(
    model: JointModel,
    found: Fit,
    which: Sequence[int],
    far: Callable[[Knob, float], float],
    deeper: float,
) -> Fit:
    """The fit, or one that is ``deeper`` [nats]: some numbers of it moved by hand and held.

    ``far`` says of a knob and its value how far it is moved; on it goes as long as that leads on.
    """
    count = len(model.nuisances)
    for _ in range(WALKS):
        best = found
        for k in which:
            knob = found.hypothesis.knobs[k - count]
            for sign in (-1.0, 1.0):
                start = found.z.copy()
                start[k] = np.clip(start[k] + sign * far(knob, start[k]), *knob.bounds)
                if start[k] == found.z[k]:
                    continue
                tried = fit(
                    model, found.hypothesis, start, found.noise, rounds=1, evaluations=2, held=[k]
                )
                if tried.cost < best.cost:
                    best = tried
        if best.cost > found.cost - deeper:
            break
        found = fit(model, best.hypothesis, best.z, best.noise)
    return found


def _far(knob: Knob, z: float) -> float:
    """How far :func:`explore` moves a number."""
    return MOVE * (1.0 if knob.parameter.shape else max(LOOSE, abs(z)))


def _ticks(knob: Knob, z: float) -> float:
    """Two ticks of firmware, in a knob's unit."""
    return TICKS_S / knob.unit


def afresh(model: JointModel, base: Fit, found: Fit, effect: str) -> Fit:
    """The fit of an effect over ``base``, or a deeper one begun from nuisances as believed.

    Only where those of ``base``, from which it was begun, have strayed far.
    """
    count = len(model.nuisances)
    if not strayed(model, base):
        return found
    z = np.concatenate([np.zeros(count), base.z[count:]])
    ((_, _, start),) = screen(model, replace(base, z=z), [catalogue()[effect]])
    again = fit(model, found.hypothesis, start, found.noise, rounds=ROUNDS)
    return again if again.cost < found.cost - DEEPER else found


def strayed(model: JointModel, found: Fit) -> bool:
    """Whether any nuisance of a fit is about as far off as a tolerance reaches."""
    return bool((np.abs(found.z[: len(model.nuisances)]) > STRAYED).any())


def elsewhere(model: JointModel, found: Fit) -> Fit:
    """The fit, or a deeper one: begun with other friction, all else as believed; of other times."""
    names = [n.name for n in model.nuisances]
    idle = model.idle(found.hypothesis)
    own = [names.index(name) for name in FRICTION if name in names and name not in idle]
    best = found
    for signs in product((-AWAY, AWAY), repeat=len(own)):
        start = found.z.copy()
        start[: len(names)] = 0.0
        start[own] = signs
        tried = fit(model, found.hypothesis, start)
        if tried.cost < best.cost - DEEPER:
            best = tried
    return retimed(model, best)


def retimed(model: JointModel, found: Fit) -> Fit:
    """The fit, or a much deeper one in which things are late by some ticks more or less."""
    count, knobs = len(model.nuisances), found.hypothesis.knobs
    times = [
        count + i
        for i, knob in enumerate(knobs)
        if knob.parameter.unit == "s" and not knob.parameter.shape
    ]
    return _walked(model, found, times, _ticks, LATE)
