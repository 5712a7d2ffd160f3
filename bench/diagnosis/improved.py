"""The better model: the operator's robot file with what a diagnosis found added to it."""

from __future__ import annotations

import os
import statistics
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import tomli_w

from busemu.tables import Robot
from sim.effects import Scope, effect
from sim.model import Addition, Estimate, with_additions

from .joint import JointFindings

WORTH = 0.3  #: deviations of its prior below which a nuisance is left as believed
#: nuisances as effects: the effect's parameter, and its value for a nuisance of ``x`` (in its unit)
PLACES = {
    "torque_constant": ("torque_constant", "scale"),
    "link": ("link_mass", "scale"),
    "zero": ("zero_offset", "offset_rad"),
    "sampling": ("read_skew", "skew_s"),
    "supply": ("supply_voltage", "scale"),
    "gain": ("gain_error", "scale"),
    "rotor_level": ("rotor_inertia", "scale"),
}
LEVELS = {
    "coulomb_level": ("coulomb_friction", "more_nm", "coulomb_nm"),
    "viscous_level": ("viscous_friction", "more_nm_s_rad", "viscous_nm_s_rad"),
}


def additions(findings: Sequence[JointFindings], on: date) -> list[Addition]:
    """Effects that make the operator's model the fitted one, with where they come from."""
    made = []
    for found in findings:
        names = sorted({o.group for o in found.model.observed})
        told = f"fitted to recordings {', '.join(names)}; {on.isoformat()}"
        joint = found.model.observed[0].joint
        made += _nuisances(found, joint, told)
        for cause in found.diagnosis.causes:
            estimates = {
                name: Estimate(e.value, told, e.ci95)
                for name, e in cause.parameters.items()
                if e.value != effect(cause.effect).off[name]
            }
            made.append(Addition(effect(cause.effect), _where(cause.effect, joint), estimates))
    made = [addition for addition in made if addition.estimates]
    return made if len(findings) == 1 else _of_arm(made, len(findings))


def _of_arm(made: Sequence[Addition], joints: int) -> list[Addition]:
    """What joints found for themselves as additions to one arm.

    What every joint has of its own stays. What the whole robot has once (its supply, its bus) is
    the median over all joints, those that found nothing counting as off. Masses are left out: a
    joint's scale is of all that hangs on it, and bodies hang on several joints.
    """
    own = [addition for addition in made if addition.effect.scope is Scope.JOINT]
    shared = [a for a in made if a.effect.scope in (Scope.ROBOT, Scope.BUS)]
    for name in dict.fromkeys(a.effect.name for a in shared):
        some = [a for a in shared if a.effect.name == name]
        estimates = {}
        for key, off in some[0].effect.off.items():
            values = [a.values[key] for a in some] + [off] * (joints - len(some))
            if (value := statistics.median(values)) != off:
                source = next(a.estimates[key].source for a in some if key in a.estimates)
                estimates[key] = Estimate(value, f"median over {joints} joints; {source}")
        if estimates:
            own.append(Addition(some[0].effect, (), estimates))
    return own


def write_improved(robot: Robot, findings: Sequence[JointFindings], path: Path, on: date) -> None:
    """Write the robot file with the effects, whole or not at all."""
    document = with_additions(robot, additions(findings, on))
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(tomli_w.dumps(document), "utf-8")
    os.replace(temporary, path)


def _nuisances(found: JointFindings, joint: str, told: str) -> list[Addition]:
    made = []
    drive = found.model.base.joints[found.model.index].drive
    for nuisance, z in zip(found.model.nuisances, found.after.z.tolist(), strict=False):
        x = z * nuisance.deviation
        if abs(z) < WORTH:
            continue
        if nuisance.name in PLACES:
            name, parameter = PLACES[nuisance.name]
            off = effect(name).parameter(parameter).off
        elif nuisance.name in LEVELS:
            name, parameter, level = LEVELS[nuisance.name]
            off, x = 0.0, x * getattr(drive.friction, level)
        else:
            continue  # tilt of the stand and extent of the weight are not the robot's
        told_of = f"nuisance {nuisance.name}; {told}"
        known = effect(name).parameter(parameter)
        value = min(known.high, max(known.low, off + x))  # samples earlier than told are no skew
        if value != known.off:
            there = {parameter: Estimate(value, told_of)}
            made.append(Addition(effect(name), _where(name, joint), there))
    return made


def _where(name: str, joint: str) -> tuple[str, ...]:
    return (joint,) if effect(name).scope.value in ("joint", "body") else ()
