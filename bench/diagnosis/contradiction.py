"""A name that fits the motion and contradicts another register.

A supply that sags loses torque where much is asked for, and so do a bridge's limit and a warm
winding. From positions alone the sag may well explain most. Where the voltage register was read,
it knows better: what resistance the motion asks for is compared with what the register shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sim.drive import lanes
from sim.effects import effect

from .fit import Fit, fit
from .intervals import covariances
from .knobs import effect_knobs
from .model import JointModel, Kind
from .observed import Channel, Observed, Samples
from .search import NEEDED, Progress, inflation

APART = 3.0  #: joint deviations between two values of one resistance that contradict each other
TIMES = 2.0  #: and their ratio
AT_FIRST = 0.3  #: of its typical size, where the fit of a resistance to the register begins


def supply_contradiction(
    model: JointModel, found: Fit, say: Progress
) -> tuple[Mapping[str, Any], ...]:
    """Whether the motion asks for a source resistance that the voltage register denies."""
    if not all(model.recorded_supply) or "voltage_sag" in found.hypothesis.effects:
        return ()
    say("what the motion would make of the supply, and what the voltage register says")
    knobs = effect_knobs(effect("voltage_sag"))
    deaf = [_without_voltage(o) for o in model.observed]
    motion = model.of(deaf)
    plain = fit(motion, found.hypothesis, found.z, {Kind.POSITION: found.noise[Kind.POSITION]})
    tempted = fit(motion, found.hypothesis + knobs, np.append(plain.z, 1.0), plain.noise)
    wanted, wanted_error = _resistance(motion, tempted)
    gain = (plain.cost - tempted.cost) / inflation(motion, tempted, [len(tempted.z) - 1])
    begun = (np.append(found.z, size) for size in (AT_FIRST, knobs[0].at(wanted)))
    both = [fit(model, found.hypothesis + knobs, start, found.noise) for start in begun]
    read = min(both, key=lambda one: one.cost)  # begun at little, a fit may stop there
    told, told_error = _resistance(model, read)
    apart = abs(wanted - told) / float(np.hypot(wanted_error, told_error))
    if gain < NEEDED or apart < APART or wanted < TIMES * told:
        return ()
    return (
        {
            "effect": "voltage_sag",
            "gain_nats": float(gain),
            "because": (
                f"the motion alone would want a source resistance of {wanted:.2f} ohm; "
                f"the voltage register, read at the same time, shows {told:.2f} ohm"
            ),
            "from_motion_ohm": [wanted, wanted_error],
            "from_register_ohm": [told, told_error],
        },
    )


def _without_voltage(one: Observed) -> Observed:
    """A recording as if the voltage register had not been read."""
    events = one.replay.events
    replay = replace(one.replay, events=events[events[:, 1] < lanes.SUPPLY_EVENT])
    channels: dict[Channel, Samples] = dict(one.channels)
    del channels[Channel.VOLTAGE]
    return replace(one, replay=replay, channels=channels, supplied=False)


def _resistance(model: JointModel, found: Fit) -> tuple[float, float]:
    """Source resistance of a fit whose last number it is, and its deviation [ohm]."""
    _, sandwich = covariances(model, found)
    knob = found.hypothesis.knobs[-1]
    return knob.value(float(found.z[-1])), knob.unit * float(np.sqrt(sandwich[-1, -1]))
