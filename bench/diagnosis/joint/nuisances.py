"""What is never exactly as the operator believes and is no finding: nuisances of one joint.

They are fitted with every hypothesis, under a normal prior whose deviation is their unit. A
nuisance that has to go far outside its prior is a finding, under the name of the effect of the same
kind: then that effect's own parameter, without a prior, takes it up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.drive import fields
from sim.effects.effect import shared
from sim.entries import Section
from sim.rollout import Candidate, Load
from sim.stepped import TICK_S

Floats = NDArray[np.float64]

WITHIN = 2.0  #: deviations that a nuisance with a tolerance may take
FARTHEST = 4.0  #: deviations that a nuisance may take whose deviation was stated
#: how late all may be [s] by where a firmware's ticks lie: a goal waits for one, what a register
#: shows of an angle is of one before, and they are up to 1.5 ms apart (assumed), of which a model
#: with ticks of its own has half of one
LATE_S = 2 * 0.0015 - TICK_S / 2

LOGARITHM = "(logarithm)"  #: unit of a nuisance that is a factor
SHARE = "(share)"  #: unit of one that lies between nothing and all, and either end is as believable

#: nuisance of a position law that leaves its punch register out of the duty, idle beside the effect
#: of that name; and the law whose manuals do not say
PUNCH, UNDOCUMENTED = "punch", "pid"
PRESLIDING = "presliding"  #: nuisance of friction that gives way before it slips, and its effect
#: nuisance of what load friction knows of the torque through its gear, and its effect
LOAD_OF_GEAR = "load_of_gear"
STALL = "stall_torque"  #: nuisance of a stall torque that was told before friction, and its effect
#: share of a rotor's inertia that is left at least: a spring cannot move none
LIGHTEST = 0.02
MASS, CENTRE_M = 0.05, 0.003  #: tolerances of a link's mass and of where its centre is
#: nuisances of a gear that is a spring; the stiffness is an effect's where that is a softer one
GEAR_LEVELS = frozenset({"gear_stiffness", "gear_damping"})


class Reaching:
    """What may go as many deviations as its ``reach``; ``least`` is the other end if not as far."""

    __slots__ = ()
    reach: float
    least: float | None

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest value [deviations]."""
        return -self.reach if self.least is None else self.least, self.reach


@dataclass(frozen=True, slots=True)
class Nuisance(Reaching):
    """Something never exactly as believed; ``deviation`` is that of its prior, in ``unit``.

    ``change`` takes a candidate of its own and what is added, and changes or replaces it.
    ``reach`` is how many deviations it may take. What has a tolerance lies anywhere within it and
    never far outside: two deviations are 1.15 times the tolerance, and beyond that it is a finding.
    ``least`` is the least it may take, if that is not as far the other way.
    """

    name: str
    unit: str
    deviation: float
    source: str
    change: Callable[[Candidate, float], Candidate]
    reach: float = WITHIN
    least: float | None = None

    @property
    def logarithmic(self) -> bool:
        """Whether what is added is the logarithm of a factor."""
        return self.unit == LOGARITHM

    @property
    def stands_in(self) -> bool:
        """Whether it stands in for something else where it has gone as far as it may."""
        return self.unit != SHARE and self.name not in {PRESLIDING, STALL}

    def value(self, z: float, off: float, size: float = 1.0) -> float:
        """What ``z`` deviations make of a number that is ``off`` without.

        ``size`` is what a unit of the nuisance is in that number's unit; of a factor, no matter.
        """
        if self.logarithmic:
            return off * math.exp(z * self.deviation)
        return off + z * self.deviation * size

    def at(self, value: float, off: float, size: float = 1.0) -> float:
        """The ``z`` at which :meth:`value` gives a value; far away where the size is 0."""
        if self.logarithmic:
            return math.log(value / off) / self.deviation
        return (value - off) / max(self.deviation * size, 1e-12)


def _scaled(*which: int, least: float = 0.0) -> Callable[[Candidate, float], Candidate]:
    def change(candidate: Candidate, x: float) -> Candidate:
        for field in which:
            candidate.drive[field] *= max(least, 1.0 + x)
        return candidate

    return change


def _times(field: int) -> Callable[[Candidate, float], Candidate]:
    def change(candidate: Candidate, x: float) -> Candidate:
        candidate.drive[field] *= math.exp(x)
        return candidate

    return change


def _share(field: int) -> Callable[[Candidate, float], Candidate]:
    """A share of what the robot's file leaves, as an effect of that name takes it."""

    def change(candidate: Candidate, x: float) -> Candidate:
        candidate.drive[field] = shared(candidate.drive[field], x)
        return candidate

    return change


def _presliding(candidate: Candidate, x: float) -> Candidate:
    candidate.drive[fields.BREAKAWAY] += x
    return candidate


def _zero(candidate: Candidate, x: float) -> Candidate:
    candidate.drive[fields.ZERO_OFFSET] += x
    return candidate


def _payload(candidate: Candidate, x: float) -> Candidate:
    if candidate.payload is None:
        return candidate
    return replace(candidate, load=candidate.load.plus(candidate.payload, x))


def _link(candidate: Candidate, x: float) -> Candidate:
    load = candidate.load.plus(candidate.load, x)
    if candidate.payload is not None:
        load = load.plus(candidate.payload, -x)
    return replace(candidate, load=load)


def _centre(candidate: Candidate, x: float) -> Candidate:
    """The link's own weight turned about the joint, a payload's left where it is."""
    none = Load(0.0, np.zeros(1), np.zeros(1))
    own = candidate.load.plus(candidate.payload or none, -1.0)
    turned = Load(0.0, -x * own.cosine_nm, x * own.sine_nm)
    return replace(candidate, load=candidate.load.plus(turned, 1.0))


def _inertia(candidate: Candidate, x: float) -> Candidate:
    inertia = candidate.load.inertia_kg_m2 * max(0.05, 1.0 + x)
    return replace(candidate, load=replace(candidate.load, inertia_kg_m2=inertia))


def _lean(along: float, across: float) -> Callable[[Candidate, float], Candidate]:
    return lambda c, x: replace(c, load=c.load.tilted(along * x, across * x))


NUISANCES = (
    Nuisance(
        "torque_constant",
        "(ratio)",
        0.06,
        "specimens: +-10 %",
        _scaled(fields.TORQUE_CONSTANT, fields.BACK_EMF),
    ),
    Nuisance(
        STALL,
        "(ratio)",
        0.06,  # of an XL-320; a joint has its own
        "whether a stall torque is told with friction or before it is in no data sheet; assumed",
        _scaled(fields.TORQUE_CONSTANT),
        reach=0.0,
        least=-1.0,
    ),
    Nuisance(
        "back_emf",
        "(ratio)",
        0.04,
        "no-load figures of data sheets; assumed",
        _scaled(fields.BACK_EMF),
    ),
    Nuisance("coulomb_level", "(ratio)", 0.18, "specimens: +-30 %", _scaled(fields.COULOMB)),
    Nuisance("viscous_level", "(ratio)", 0.18, "specimens: +-30 %", _scaled(fields.VISCOUS)),
    Nuisance(
        "rotor_level",
        "(ratio)",
        0.02,
        "rotors of one make; assumed",
        _scaled(fields.ROTOR_INERTIA, least=LIGHTEST),
    ),
    Nuisance("link", "(ratio)", 0.05, "mass +-5 %, centre of mass +-3 mm along it", _link),
    Nuisance("centre", "rad", 0.02, "centre of mass +-3 mm across the link", _centre),
    Nuisance("payload", "(ratio)", 0.03, "mass +-5 %", _payload),
    Nuisance("load_inertia", "(ratio)", 0.05, "centre +-3 mm, extent of weights", _inertia),
    Nuisance("zero", "rad", 0.0101, "zero +-1 deg", _zero),
    Nuisance("tilt", "rad", 0.0101, "stand tilted up to 1 deg", _lean(1.0, 0.0)),
    Nuisance("tilt_across", "rad", 0.0101, "stand tilted up to 1 deg", _lean(0.0, 1.0)),
    Nuisance(
        "sampling",
        "s",
        LATE_S / WITHIN,
        "turnaround of a bus, goals and angles taken at a firmware's ticks; assumed",
        lambda c, x: replace(c, late_s=c.late_s + x),
    ),
    Nuisance(
        "supply",
        "(ratio)",
        0.02,
        "battery from charge to charge; assumed",
        lambda c, x: replace(c, voltage_v=c.voltage_v * (1.0 + x)),
    ),
    Nuisance(
        "gain", "(ratio)", 0.03, "scale of a gain register; assumed", _scaled(fields.GAIN_SCALE)
    ),
    Nuisance(
        PUNCH,
        SHARE,
        1.0,
        "whether a PID law adds its punch register to the duty is documented nowhere; assumed",
        _share(fields.PUNCH_LEFT_OUT),
        reach=1.0,
        least=0.0,
    ),
    Nuisance(
        PRESLIDING,
        "rad",
        0.001,
        "how far teeth and bearings give way before they slip is in no data sheet; assumed",
        _presliding,
        reach=1.0,
        least=0.0,
    ),
    Nuisance(
        LOAD_OF_GEAR,
        SHARE,
        1.0,
        "whether load friction knows the load's inertia is in no data sheet; assumed",
        _share(fields.LOAD_OF_GEAR),
        reach=1.0,
        least=0.0,
    ),
    Nuisance(
        "gear_stiffness",
        LOGARITHM,
        math.log(4.0),
        "no data sheet tells a gear's stiffness; softer is a finding; assumed",
        _times(fields.GEAR_STIFFNESS),
        least=0.0,
    ),
    Nuisance(
        "gear_damping",
        LOGARITHM,
        math.log(4.0),
        "no data sheet tells a gear's damping; assumed",
        _times(fields.GEAR_DAMPING),
    ),
)


#: entries of a robot file's [drive] that may say how sure they are, and whose nuisance they widen
DOUBTS = {
    "stall_torque_nm": "torque_constant",
    "torque_constant_nm_a": "torque_constant",
    "no_load_velocity_rad_s": "back_emf",
    "back_emf_v_s_rad": "back_emf",
    "coulomb_nm": "coulomb_level",
    "no_load_current_a": "viscous_level",
    "viscous_nm_s_rad": "viscous_level",
    "motor_inertia_kg_m2": "rotor_level",
}


def nuisances(
    drive: Section,
    body: Section | None = None,
    lever_m: float | None = None,
    law: str = UNDOCUMENTED,
    lost: float = 0.0,
) -> tuple[Nuisance, ...]:
    """The nuisances of a joint, as wide as a robot file says of servo and body, else as usual.

    ``lever_m`` is how far the link's centre of mass is from the axis, if that is known: the nearer,
    the more a tolerance of its place means. ``law`` is the position law of the control table.
    ``lost`` is the share of the stalled motor's torque that friction takes; it is in doubt where
    the torque constant is made of a stall torque.
    """
    told = {
        DOUBTS[key]: deviation for key in DOUBTS if (deviation := drive.deviation(key)) is not None
    }
    if body is not None and (deviation := body.deviation("mass_kg")) is not None:
        told["link"] = deviation
    usual = {n.name: n.deviation for n in NUISANCES}
    usual[STALL] = 0.0 if "torque_constant_nm_a" in drive else lost
    if lever_m is not None:
        off = CENTRE_M / max(lever_m, CENTRE_M)
        usual["link"] = (MASS + off) / WITHIN
        usual["centre"] = off / math.sqrt(3.0)
    return tuple(
        replace(n, deviation=told[n.name], reach=FARTHEST)
        if n.name in told
        else replace(n, deviation=usual[n.name])
        for n in NUISANCES
        if (n.name != PUNCH or law == UNDOCUMENTED) and usual[n.name] > 0.0
    )


def has_punch(start: Floats, changed: Floats, values: Floats) -> bool:
    """Whether drives are ever told a punch: by commands at first, or by changes of fields."""
    return bool((start[fields.PUNCH] > 0.0).any() or (values[changed == fields.PUNCH] > 0.0).any())
