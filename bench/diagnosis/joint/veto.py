"""What speaks against a name, however well it fits: an impossible size, a register, nothing new."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sim.effects import Effect, catalogue

from ..knobs import VISCOUS, effect_knobs
from ..observed import Channel, Observed
from .beginning import EARLY_S
from .confidence import NORMAL
from .contradiction import named_source
from .fit import EDGE, Fit, fit
from .intervals import Spread
from .model import SOURCE, JointModel
from .nuisances import LATE_S
from .screening import screen
from .search import NUMBER_NATS, Gain, confirm, drop
from .valleys import elsewhere

PLAINER = {"stribeck_friction": "coulomb_friction"}  #: effects that hold a plainer one
SPLIT = {"directional_load_friction": "load_friction"}  #: the same, where two numbers are one
AGREES = "its two numbers differ by no more than chance, which is "
SAME_SHARE = 0.05  #: of each of two such numbers, by which engines may differ about it
WAVES = "periods"  #: number of an effect that is a wave, which ends where nothing is one any more
LIMITS = "torque_limit"  #: an effect that is a limit of what the duty's register shows
PACE = "velocity_limit"  #: an effect that is a limit of how fast a goal moves
SWING = "acceleration_limit"  #: the same of how fast that changes
#: times what a servo is capable of, beyond which its goals' acceleration is not limited; assumed
FASTER = 1.5
#: times a limit, beyond which a duty denies it (a fit is not exact), and in how many samples
BEYOND, SAMPLES = 1.04, 5
BEHIND = 0.5  #: of the gain of a name taken back that another must have, to take its place


def objection(
    model: JointModel, found: Fit, gain: Gain, effects: Mapping[str, Effect]
) -> str | None:
    """Why an effect of a fit is not named; ``None`` where nothing speaks against it."""
    why = _implausible(model, found, gain.effect)
    if why is None and gain.effect == LIMITS:
        why = _shown_beyond(model, found)
    if why is None and gain.effect in (PACE, SWING):
        why = _never_reached(model, found, gain.effect)
    if why is None and gain.effect == SOURCE:
        source = named_source(model, found)
        why = str(source) if source is not None and source.contradicts else None
    if why is not None:
        return why
    if gain.effect in SPLIT and _agree(model, found, gain.effect):
        return AGREES + SPLIT[gain.effect]
    plainer = PLAINER.get(gain.effect)
    if plainer is None or plainer in found.hypothesis.effects:
        return None
    without, own = drop(model, found, gain.effect)
    plain = catalogue()[plainer]
    _, _, start = screen(model, without, [plain])[0]
    best = confirm(model, without, plain, start)
    best = replace(best, fit=elsewhere(model, best.fit)).over(model, without)
    if own.deflated - best.counted(own.inflation) < 2.0 * NUMBER_NATS:
        named = "" if plainer in effects else ", which is not to be named"
        return f"nothing is seen of what sets it apart from {plainer}{named}"
    return None


def impossible(model: JointModel, found: Fit) -> bool:
    """Whether a fit needs a size of an effect that nothing has."""
    return any(_implausible(model, found, effect) for effect in found.hypothesis.effects)


def _implausible(model: JointModel, found: Fit, effect: str) -> str | None:
    """That a number of an effect is one that nothing has, if it is."""
    count = len(model.nuisances)
    for knob, z in zip(found.hypothesis.knobs, found.z[count:].tolist(), strict=True):
        if knob.effect != effect:
            continue
        low, high = knob.bounds
        if knob.parameter.name == WAVES and z <= low + EDGE:
            return "half a wave a turn, or less, is no wave of a sensor: an angle off or a slope"
        if knob.parameter.shape:
            continue
        none_left = effect == VISCOUS and z <= low + EDGE  # a drive may have none
        if z >= high - EDGE or (low < 0.0 and z <= low + EDGE and not none_left):
            return (
                f"it would need {knob.parameter.name} = {knob.value(z):.3g} {knob.parameter.unit} "
                "or beyond, which is not plausible"
            )
    return None


def _shown_beyond(model: JointModel, found: Fit) -> str | None:
    """That a limit of the duty is denied by the register of the duty, if it is."""
    count = len(model.nuisances)
    knobs = zip(found.hypothesis.knobs, found.z[count:].tolist(), strict=True)
    (limit,) = (knob.value(z) for knob, z in knobs if knob.effect == LIMITS)
    shown: list[float] = []
    for observed in model.observed:
        samples = observed.channels.get(Channel.DUTY)
        if samples is not None:
            sizes = np.abs(samples.value[samples.good])
            shown += sizes[sizes > BEYOND * limit + samples.quantum].tolist()
    if len(shown) < SAMPLES:
        return None
    return (
        f"it would be {limit:.3g} of full duty, and the duty's own register shows up to "
        f"{max(shown):.3g}"
    )


def _never_reached(model: JointModel, found: Fit, effect: str) -> str | None:
    """That a limit of how fast goals move limits nothing, if so: no step of one takes any time."""
    count = len(model.nuisances)
    knobs = zip(found.hypothesis.knobs, found.z[count:].tolist(), strict=True)
    limit = next(knob.value(z) for knob, z in knobs if knob.effect == effect)
    if effect == PACE:
        late_s = max(largest_step(one) for one in model.observed) / limit
        if late_s >= LATE_S:
            return None
        return (
            f"at {limit:.3g} rad/s no step of a goal takes longer than {1e3 * late_s:.2g} ms: "
            "that is where a firmware's ticks lie"
        )
    drive, voltage_v = model.base.joints[model.index].drive, model.base.supply.voltage_v
    able = drive.stall_torque_nm(voltage_v) / drive.rotor_inertia_kg_m2
    if limit < FASTER * able:
        return None
    return f"it would be {limit:.3g} rad/s^2, and the servo itself is capable of {able:.3g} at most"


def largest_step(observed: Observed) -> float:
    """By how much a goal changes at once at most [rad]; what was first written is no change."""
    times, goals = observed.goal
    return float(np.max(np.abs(np.diff(goals)[times[1:] > EARLY_S]), initial=0.0))


def _agree(model: JointModel, found: Fit, effect: str) -> bool:
    """Whether the two numbers of an effect may be the same, by the widest of their variances.

    What two sound simulations make of each number differs as well.
    """
    one, other = (i for i, k in enumerate(found.hypothesis.knobs) if k.effect == effect)
    away = np.zeros(len(found.z))
    away[len(model.nuisances) + one] = found.hypothesis.knobs[one].unit
    away[len(model.nuisances) + other] = -found.hypothesis.knobs[other].unit
    variance = max(float(away @ account @ away) for account in Spread(model, found).accounts)
    variance += float(np.sum((SAME_SHARE * away * found.z) ** 2))
    return abs(float(away @ found.z)) < NORMAL * float(np.sqrt(variance))


def as_plainer(model: JointModel, found: Fit, name: str, plainer: Effect) -> tuple[Fit, Gain]:
    """A fit with a plainer effect in the place of one whose numbers agree, and what that gains.

    It begins where those numbers are: a search for it anew may end in a hollow before that.
    """
    count, knobs = len(model.nuisances), found.hypothesis.knobs
    own = np.array([knob.effect == name for knob in knobs])
    sizes = [knob.value(z) for knob, z in zip(knobs, found.z[count:].tolist(), strict=True)]
    hypothesis = found.hypothesis.without(name) + effect_knobs(plainer)
    size = hypothesis.knobs[-1].at(float(np.mean(np.array(sizes)[own])))
    start = np.concatenate([found.z[:count], found.z[count:][~own], [size]])
    after = fit(model, hypothesis, start, found.noise)
    return after, drop(model, after, plainer.name)[1]
