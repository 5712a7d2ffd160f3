"""A source resistance that fits the motion and that the voltage register denies.

A supply that sags loses torque where much is asked for, and so do a bridge's limit and a warm
winding. From positions alone the sag may well explain most. Where the voltage register was read,
it knows better: what resistance the motion asks for is compared with what the register shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.effects import effect

from ..commands import without_supply
from ..knobs import effect_knobs
from ..observed import Channel, Observed, Samples
from .fit import Fit, fit
from .intervals import covariances
from .model import SOURCE, JointModel, Kind
from .search import NEEDED, Progress, inflation

APART = 3.0  #: joint deviations between two values of one resistance that contradict each other
TIMES = 2.0  #: and their ratio
AT_FIRST = 0.3  #: of its typical size, where the fit of a resistance to the register begins


@dataclass(frozen=True, slots=True)
class Resistance:
    """What the motion alone would make of a source, and what the register shows: each +- [ohm]."""

    motion: tuple[float, float]
    register: tuple[float, float]

    @property
    def contradicts(self) -> bool:
        """Whether the register denies what the motion wants."""
        (wanted, one), (told, other) = self.motion, self.register
        return abs(wanted - told) >= APART * float(np.hypot(one, other)) and wanted >= TIMES * told

    def __str__(self) -> str:
        return (
            f"the motion alone would want a source resistance of {self.motion[0]:.2f} ohm; "
            f"the voltage register, read at the same time, shows {self.register[0]:.2f} ohm"
        )


def named_source(model: JointModel, found: Fit) -> Resistance | None:
    """What motion and register make of a source that a fit has; none where no register rules."""
    if not all(model.recorded_supply):
        return None
    motion = model.of([_without_voltage(o) for o in model.observed])
    moved = fit(motion, found.hypothesis, found.z, {Kind.POSITION: found.noise[Kind.POSITION]})
    return Resistance(_resistance(motion, moved), _by_register(model, found))


def supply_contradiction(
    model: JointModel, before: Fit, after: Fit, say: Progress
) -> tuple[Mapping[str, Any], ...]:
    """Whether the motion asks for a source resistance that the voltage register denies.

    That is said of a source that is not named, beside what is named, or else as the joint was
    believed: a fit to the motion would have begun with it. One that is named is asked
    :func:`named_source`.
    """
    if not all(model.recorded_supply) or SOURCE in after.hypothesis.effects:
        return ()
    say("what the motion would make of the supply, and what the voltage register says")
    motion = model.of([_without_voltage(o) for o in model.observed])
    for found in dict.fromkeys((after, before)):
        if denied := _denied(model, motion, found):
            return denied
    return ()


def _denied(model: JointModel, motion: JointModel, found: Fit) -> tuple[Mapping[str, Any], ...]:
    knobs = effect_knobs(effect(SOURCE))
    plain = fit(motion, found.hypothesis, found.z, {Kind.POSITION: found.noise[Kind.POSITION]})
    tempted = fit(motion, found.hypothesis + knobs, np.append(plain.z, 1.0), plain.noise)
    gain = (plain.cost - tempted.cost) / inflation(motion, tempted, [len(tempted.z) - 1])
    wanted = _resistance(motion, tempted)
    if gain < NEEDED or wanted[0] < APART * wanted[1]:
        return ()
    z = np.append(found.z, knobs[0].at(wanted[0]))
    shown = _by_register(model, replace(found, hypothesis=tempted.hypothesis, z=z))
    both = Resistance(wanted, shown)
    if not both.contradicts:
        return ()
    return (
        {
            "effect": SOURCE,
            "gain_nats": float(gain),
            "because": str(both),
            "from_motion_ohm": list(both.motion),
            "from_register_ohm": list(both.register),
        },
    )


def _without_voltage(one: Observed) -> Observed:
    """A recording as if the voltage register had not been read."""
    channels: dict[Channel, Samples] = dict(one.channels)
    del channels[Channel.VOLTAGE]
    return replace(one, replay=without_supply(one.replay), channels=channels, supplied=False)


def _by_register(model: JointModel, found: Fit) -> tuple[float, float]:
    """What the register shows of a source: motions are under the recorded voltage then."""
    ruled, at = model.ruled(), _place(model, found)
    least = found.z.copy()
    least[at] = AT_FIRST
    both = [fit(ruled, found.hypothesis, start, found.noise) for start in (least, found.z)]
    return _resistance(ruled, min(both, key=lambda one: one.cost))  # begun at little, one may stop


def _place(model: JointModel, found: Fit) -> int:
    """Which number of a vector a source's resistance is."""
    names = [knob.effect for knob in found.hypothesis.knobs]
    return len(model.nuisances) + names.index(SOURCE)


def _resistance(model: JointModel, found: Fit) -> tuple[float, float]:
    """Source resistance of a fit that has one, and its deviation [ohm]."""
    _, sandwich = covariances(model, found)
    at = _place(model, found)
    knob = found.hypothesis.knobs[at - len(model.nuisances)]
    return knob.value(float(found.z[at])), knob.unit * float(np.sqrt(sandwich[at, at]))
