"""What speaks against a name, however well it fits: an impossible size, or nothing of its own."""

from __future__ import annotations

from collections.abc import Mapping

from sim.effects import Effect, catalogue

from .fit import EDGE, Fit
from .model import JointModel
from .search import NUMBER_NATS, Gain, confirm, drop, screen

#: effects that hold a plainer one, which they are when their numbers agree
PLAINER = {
    "directional_load_friction": "load_friction",
    "stribeck_friction": "coulomb_friction",
}
BEHIND = 0.5  #: of the gain of a name taken back that another must have, to take its place


def objection(
    model: JointModel, found: Fit, gain: Gain, effects: Mapping[str, Effect]
) -> str | None:
    """Why an effect of a fit cannot be the cause; ``None`` where nothing speaks against it."""
    count = len(model.nuisances)
    for knob, z in zip(found.hypothesis.knobs, found.z[count:].tolist(), strict=True):
        if knob.effect != gain.effect or knob.parameter.shape:
            continue
        low, high = knob.bounds
        if z >= high - EDGE or (low < 0.0 and z <= low + EDGE):
            return (
                f"it would need {knob.parameter.name} = {knob.value(z):.3g} {knob.parameter.unit} "
                "or beyond, which is not plausible"
            )
    plainer = PLAINER.get(gain.effect)
    if plainer is None or plainer in effects or plainer in found.hypothesis.effects:
        return None
    without, own, inflation = drop(model, found, gain.effect)
    plain = catalogue()[plainer]
    _, _, start = screen(model, without, [plain])[0]
    best = confirm(model, without, plain, start)
    if (own - best.nats) / inflation < 2.0 * NUMBER_NATS:
        return f"nothing is seen of what sets it apart from {plainer}, which is not to be named"
    return None
