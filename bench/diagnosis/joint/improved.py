"""The better model: the operator's robot file with what a diagnosis found added to it.

Nuisances that are the robot's (friction level, strength of the motor, ...) are written as the
effect of the same kind. Those that are not (tilt of the stand, the weight that hung on it) go back
to what was believed, and the rest goes where it is then likeliest: a fit holds as a whole, and half
of two numbers that balance each other would be worse than neither.

What is likeliest is a question of what is noise. Where something structured is left, noise with a
memory takes most of it up, and numbers that follow the motion less closely cost nothing: such a fit
tells causes apart, and foretells badly. There the last fit is least squares over the positions,
with the numbers of the named effects free as well, and with the spring of the file, which the
emulator has though the gear was taken for rigid.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from bench.files import write_text
from busemu.tables import Robot
from sim.effects import Effect, Parameter, Scope, effect
from sim.model import Addition, Estimate, with_additions

from ..noise import Noise
from ..result import DEAD
from .diagnosis import JointFindings
from .fit import EDGE, bounds, estimate_noise, least_squares
from .gear import with_spring
from .left import runs_away
from .model import Blocks, JointModel, Kind
from .nuisances import LOAD_OF_GEAR, PRESLIDING, PUNCH, STALL, Nuisance
from .remaining import block_rms
from .shared import mean, of_robot

Floats = NDArray[np.float64]

SHARED = (Scope.ROBOT, Scope.BUS)  #: scopes of what an arm has once
ROUNDS, STEPS = 2, 4  #: of least squares, from a fit whose other numbers are where they belong
FORETELLING = 6  #: of these rounds where positions are foretold: what was likely may be far off
#: random beginnings there, a deviation of tolerances about the fit, and of sizes in their units
BEGINNINGS, AROUND = 5, 0.3
LEFT = frozenset(
    {"partly_explained", "unexplained"}
)  #: verdicts where something structured is left
#: nuisances as effects: the effect and its parameter
PLACES = {
    "torque_constant": ("torque_constant", "scale"),
    STALL: ("stall_torque", "scale"),
    "back_emf": ("back_emf", "scale"),
    "coulomb_level": ("coulomb_friction", "more_nm"),
    "viscous_level": ("viscous_friction", "more_nm_s_rad"),
    "link": ("link_mass", "scale"),
    "zero": ("zero_offset", "offset_rad"),
    "sampling": ("read_skew", "skew_s"),
    "supply": ("supply_voltage", "scale"),
    "gain": ("gain_error", "scale"),
    "rotor_level": ("rotor_inertia", "scale"),
    PUNCH: ("punch_left_out", "share"),
    PRESLIDING: ("presliding", "breakaway_rad"),
    LOAD_OF_GEAR: ("load_of_gear", "share"),
    "gear_stiffness": ("gear_spring", "stiffness_scale"),
    "gear_damping": ("gear_spring", "damping_scale"),
}
#: of those whose effect counts in another unit than the nuisance: the friction that it scales
LEVELS = {"coulomb_level": "coulomb_nm", "viscous_level": "viscous_nm_s_rad"}


def additions(findings: Sequence[JointFindings], on: date) -> list[Addition]:
    """Effects that make the operator's model the fitted one, with where they come from."""
    made = []
    once = _once(findings) if len(findings) > 1 else {}
    for found in findings:
        names = sorted({o.group for o in found.model.observed})
        told = f"fitted to recordings {', '.join(names)}; {on.isoformat()}"
        joint = found.model.observed[0].joint
        vector = carried(found, once)
        if foretold(found):
            told += "; least squares over positions, as something is left that is not explained"
        made += _nuisances(found, vector, joint, told)
        moved = _moved(found, vector, told)
        for cause in found.diagnosis.causes:
            if cause.effect not in found.after.hypothesis.effects and cause.probability < 0.5:
                continue  # seen in the data, and as likely something else
            off = effect(cause.effect).off
            estimates = {
                name: moved.get((cause.effect, name), Estimate(e.value, told, e.ci95))
                for name, e in cause.parameters.items()
                if e.state != DEAD or e.value != off[name]
            }
            estimates = {name: e for name, e in estimates.items() if e.value != off[name]}
            made.append(Addition(effect(cause.effect), _where(cause.effect, joint), estimates))
    made = [addition for addition in made if addition.estimates]
    return made if len(findings) == 1 else _of_arm(made, len(findings))


def _of_arm(made: Sequence[Addition], joints: int) -> list[Addition]:
    """What joints found for themselves as additions to one arm.

    What every joint has of its own stays. What the whole robot has once (its supply, its bus) is
    the median over all joints, those that found nothing counting as off; or, if most of them found
    it with an interval, their mean as the diagnosis makes it. Masses are left out: a joint's scale
    is of all that hangs on it, and bodies hang on several joints.
    """
    own = [addition for addition in made if addition.effect.scope is Scope.JOINT]
    shared = [a for a in made if a.effect.scope in SHARED]
    for name in dict.fromkeys(a.effect.name for a in shared):
        some = [a for a in shared if a.effect.name == name]
        estimates = {}
        for key, off in some[0].effect.off.items():
            told = [a.estimates[key] for a in some if key in a.estimates]
            known = [(one.value, one.ci95) for one in told if one.ci95 is not None]
            if of_robot(name) and 2 * len(known) > joints:
                value, interval = mean(*zip(*known, strict=True))
                source = f"mean over {len(known)} joints; {told[0].source}"
                estimates[key] = Estimate(value, source, interval)
                continue
            values = [a.values[key] for a in some] + [off] * (joints - len(some))
            if (value := statistics.median(values)) != off:
                estimates[key] = Estimate(value, f"median over {joints} joints; {told[0].source}")
        if estimates:
            own.append(Addition(some[0].effect, (), estimates))
    return own


def write_improved(robot: Robot, findings: Sequence[JointFindings], path: Path, on: date) -> None:
    """Write the robot file with the effects, whole or not at all."""
    write_text(path, tomli_w.dumps(with_additions(robot, additions(findings, on))))


def _place(name: str) -> tuple[Effect, Parameter]:
    told = effect(PLACES[name][0])
    return told, told.parameter(PLACES[name][1])


def _size(found: JointFindings, nuisance: Nuisance) -> float:
    """What a unit of a nuisance is, as its effect counts it."""
    level = LEVELS.get(nuisance.name)
    drive = found.model.base.joints[found.model.index].drive
    return float(getattr(drive.friction, level)) if level else 1.0


def _once(findings: Sequence[JointFindings]) -> Mapping[str, float]:
    """Nuisances that an arm has once, by name: the median of all joints [deviations]."""
    values: dict[str, list[float]] = {}
    for found in findings:
        for nuisance, z in zip(found.model.nuisances, found.after.z.tolist(), strict=False):
            if nuisance.name in PLACES and _place(nuisance.name)[0].scope in SHARED:
                values.setdefault(nuisance.name, []).append(z)
    return {name: statistics.median(some) for name, some in values.items()}


def foretold(found: JointFindings) -> bool:
    """Whether the better model is fitted to foretell positions: something structured is left."""
    return found.diagnosis.verdict in LEFT


def carried(found: JointFindings, once: Mapping[str, float]) -> Floats:
    """The fitted vector with only what a robot file can carry, at its likeliest.

    ``once`` are nuisances whose value is given [deviations]; in an arm (it is not empty) a link's
    mass is not the joint's own. Parameters of effects stay as they are, unless positions are to be
    foretold.
    """
    z = found.after.z.copy()
    model = _foretelling(found) if foretold(found) else found.model
    low, high = bounds(model, found.after.hypothesis)
    count = len(model.nuisances)
    if not foretold(found):
        low[count:] = high[count:] = z[count:]
    for k, nuisance in enumerate(model.nuisances):
        ends = (0.0, 0.0)
        if nuisance.name in once:
            ends = (once[nuisance.name], once[nuisance.name])
        elif nuisance.name in PLACES and not (once and nuisance.name == "link"):
            _, known = _place(nuisance.name)
            size = _size(found, nuisance)
            ends = nuisance.at(known.low, known.off, size), nuisance.at(known.high, known.off, size)
        low[k], high[k] = np.clip(ends, low[k], high[k])
    start = np.clip(z, low, high)
    if (start == z).all() and not foretold(found):
        return start
    return _settled(found, model, start, low, high)


def _foretelling(found: JointFindings) -> JointModel:
    """The joint with the spring of its file, unless no replay can carry it."""
    sprung = with_spring(found.model)
    away = runs_away(sprung.residuals(found.after.hypothesis, [found.after.z])[0])
    return found.model if away else sprung


def _settled(
    found: JointFindings, model: JointModel, z: Floats, low: Floats, high: Floats
) -> Floats:
    """Least squares within bounds, from a fit that had other ones, another gear or noise.

    Where positions are to be foretold, hollows are many: several beginnings are tried, the fit,
    what was believed and some around the fit, and what comes nearest to the recordings goes on.
    """
    if not foretold(found):
        return _descended(found, model, z, (low, high), ROUNDS)
    chance, count = np.random.default_rng(0), len(model.nuisances)
    spread = np.append(np.ones(count), np.full(len(z) - count, AROUND))
    begun = [z, np.append(np.zeros(count), z[count:])]
    begun += [z + spread * chance.standard_normal(len(z)) for _ in range(BEGINNINGS)]
    ends = [_descended(found, model, np.clip(x, low, high), (low, high), ROUNDS) for x in begun]
    best = min(ends, key=lambda x: _left(found, model, x))
    return _descended(found, model, best, (low, high), FORETELLING)


def _descended(
    found: JointFindings, model: JointModel, z: Floats, box: tuple[Floats, Floats], rounds: int
) -> Floats:
    hypothesis = found.after.hypothesis
    for _ in range(rounds):
        blocks = model.residuals(hypothesis, [z])[0]
        noise = estimate_noise(model, blocks, found.after.noise)
        if foretold(found):
            noise[Kind.POSITION] = _white(blocks)
        z = least_squares(model, hypothesis, z, noise, None, box, STEPS)
    return z


def _left(found: JointFindings, model: JointModel, z: Floats) -> float:
    """Root mean square of what a vector leaves of the positions that are fitted [rad]."""
    return block_rms(model.residuals(found.after.hypothesis, [z])[0], Kind.POSITION)


def _white(blocks: Blocks) -> Noise:
    """Noise without a memory, as large as the positions' residuals are."""
    return Noise(block_rms(blocks, Kind.POSITION), 0.0, 1.0)


def _nuisances(found: JointFindings, vector: Floats, joint: str, told: str) -> list[Addition]:
    made = []
    for nuisance, z in zip(found.model.nuisances, vector.tolist(), strict=False):
        if nuisance.name not in PLACES or abs(z) < EDGE:  # or a rounding
            continue
        there, parameter = _place(nuisance.name)
        value = nuisance.value(z, parameter.off, _size(found, nuisance))
        value = min(parameter.high, max(parameter.low, value))
        if value != parameter.off:
            estimate = Estimate(value, f"nuisance {nuisance.name}; {told}")
            made.append(Addition(there, _where(there.name, joint), {parameter.name: estimate}))
    return made


def _moved(found: JointFindings, vector: Floats, told: str) -> dict[tuple[str, str], Estimate]:
    """Numbers of effects that are not where the diagnosis has them, by effect and parameter."""
    count = len(found.model.nuisances)
    pairs = zip(found.after.z[count:].tolist(), vector[count:].tolist(), strict=True)
    return {
        (knob.effect, knob.parameter.name): Estimate(knob.value(now), told)
        for knob, (before, now) in zip(found.after.hypothesis.knobs, pairs, strict=True)
        if now != before
    }


def _where(name: str, joint: str) -> tuple[str, ...]:
    return (joint,) if effect(name).scope.value in ("joint", "body") else ()
