"""What is never exactly as the operator of a whole robot believes, and is no finding.

Nuisances are small, so their traces add up: each is one trace a unit of its prior's deviation,
weighed together (or told by the replay itself), and every hypothesis may turn it under its prior.
Joints differ from each other, and all together from what a data sheet says of their make. What
makes a joint soft or stiff acts on that joint's own error first, so one replay with all joints of a
kind changed gives the traces of each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.drive.parameters import DriveParameters
from sim.effects import effect
from sim.effects.effect import shared
from sim.effects.link_mass import scaled
from sim.shapes import MassProperties
from sim.tree import SEGMENTS, PhysicalRobot

from ..joint.nuisances import PUNCH, SHARE, STALL, WITHIN, Reaching

Floats = NDArray[np.float64]

ROOT3 = math.sqrt(3.0)  #: a uniform spread of +-b has the deviation b / sqrt(3)
#: deviations that a zero may take, 2.3 degrees: farther off it is a finding; assumed
ZERO_WITHIN = 4.0

ZERO = "zero"  #: first word of a nuisance of one joint's zero
LATE = "late"  #: nuisance of when commands act, beside what replays take for that
TIPS = "tips"  #: nuisance of feet that are not rigid
TURNING = "turning"  #: nuisance of how feet rub that turn on their spot
TIP_KG = 0.07  #: on a tip that touches the ground, for its damping; assumed: a tibia's share

Change = Callable[[PhysicalRobot, float], PhysicalRobot]


@dataclass(frozen=True, slots=True)
class Trial:
    """One thing that can be changed, by ``size`` or a share of it; ``one_way``: not by less."""

    name: str
    size: float
    change: Change
    one_way: bool = False


@dataclass(frozen=True, slots=True)
class RobotNuisance(Reaching):
    """Something never exactly as believed; ``deviation`` is that of its prior, in ``unit``.

    ``trial`` is the replay that shows its trace (none: the base replay tells), ``joint`` the only
    joint whose rows of it count. ``reach`` is how many deviations it may take, either way unless
    ``least`` says how few; beyond that it is a finding, under one of the names of ``same`` (effects
    at places): where one of those is on, the nuisance is idle, as it is where one of ``idle`` is.
    ``doubt`` is the share by which the number itself may be off and yet be no finding.
    """

    name: str
    unit: str
    deviation: float
    source: str
    trial: str = ""
    joint: str = ""
    reach: float = WITHIN
    same: tuple[str, ...] = ()
    least: float | None = None
    idle: tuple[str, ...] = ()
    doubt: float = 0.0

    @property
    def common(self) -> bool:
        """Whether it is of the whole robot, and has an effect's name; zeros are a joint's."""
        return bool(self.same) and self.name.split()[0] != ZERO

    def far(self, z: float, share: float) -> bool:
        """Whether it has gone that share of as far as it may, and so stands in for something."""
        return self.name != STALL and self.unit != SHARE and abs(z) > share * self.reach


def _drives(segment: str, change: Callable[[DriveParameters, float], DriveParameters]) -> Change:
    def changed(robot: PhysicalRobot, x: float) -> PhysicalRobot:
        joints = tuple(
            replace(j, drive=change(j.drive, x)) if j.segment == segment else j
            for j in robot.joints
        )
        return replace(robot, joints=joints)

    return changed


def _torque(drive: DriveParameters, x: float) -> DriveParameters:
    return replace(
        drive,
        torque_constant_nm_a=drive.torque_constant_nm_a * (1.0 + x),
        back_emf_v_s_rad=drive.back_emf_v_s_rad * (1.0 + x),
    )


def _friction(drive: DriveParameters, x: float) -> DriveParameters:
    level = replace(
        drive.friction,
        coulomb_nm=drive.friction.coulomb_nm * (1.0 + x),
        viscous_nm_s_rad=drive.friction.viscous_nm_s_rad * (1.0 + x),
    )
    return replace(drive, friction=level)


def _mass(mass: MassProperties, x: float) -> MassProperties:
    return scaled(mass, {"scale": 1.0 + x})


def _trunk_mass(robot: PhysicalRobot, x: float) -> PhysicalRobot:
    if robot.trunk is None:
        return robot
    return replace(robot, trunk=replace(robot.trunk, mass=_mass(robot.trunk.mass, x)))


def _link_mass(segment: str) -> Change:
    def changed(robot: PhysicalRobot, x: float) -> PhysicalRobot:
        some = [b for b in robot.bodies if b.name.endswith(f".{segment}")]
        return robot.with_bodies(*(replace(b, mass=_mass(b.mass, x)) for b in some))

    return changed


def _of_all(change: Callable[[DriveParameters, float], DriveParameters]) -> Change:
    def changed(robot: PhysicalRobot, x: float) -> PhysicalRobot:
        joints = tuple(replace(j, drive=change(j.drive, x)) for j in robot.joints)
        return replace(robot, joints=joints)

    return changed


def later(robot: PhysicalRobot, x: float) -> PhysicalRobot:
    """The robot whose goals all act so much later [s] than believed: sooner, if that is negative.

    A replay's act ``robot_replay.LATE_S`` and up to a tick after they were sent: there is room.
    """
    return _of_all(lambda drive, s: replace(drive, delay_s=drive.delay_s + s))(robot, x)


def _supply(robot: PhysicalRobot, x: float) -> PhysicalRobot:
    volts = robot.supply.voltage_v * (1.0 + x)
    return replace(robot, supply=replace(robot.supply, voltage_v=volts))


def _gain(drive: DriveParameters, x: float) -> DriveParameters:
    return replace(drive, gain_scale=drive.gain_scale * (1.0 + x))


def _rotor(drive: DriveParameters, x: float) -> DriveParameters:
    return replace(drive, rotor_inertia_kg_m2=drive.rotor_inertia_kg_m2 * (1.0 + x))


def _punch(drive: DriveParameters, x: float) -> DriveParameters:
    return replace(drive, punch_left_out=shared(drive.punch_left_out, x))


def tip_of(give_m_n: float) -> tuple[float, float]:
    """Stiffness [N/m] of a foot that gives by so much, and half its critical damping [N s/m].

    No stiffer than the effect of that name may be, as what gives less is as good as rigid; nor
    softer, as where feet are as soft as that already.
    """
    bounds = effect("foot_compliance").parameters[0]
    stiffness = min(max(1.0 / give_m_n, bounds.low), bounds.high)
    return stiffness, math.sqrt(TIP_KG * stiffness)


def _tips(robot: PhysicalRobot, x: float) -> PhysicalRobot:
    kind = effect("foot_compliance")
    for leg in robot.legs:
        stiffness, damping = tip_of(1.0 / leg.foot.stiffness_n_m + x)
        values = {"stiffness_n_m": stiffness, "damping_n_s_m": damping}
        robot = kind.apply(robot, (leg.name,), values)
    return robot


def turning(robot: PhysicalRobot, x: float) -> PhysicalRobot:
    """The robot whose feet rub so much more than believed where they turn (a share of that)."""
    feet = [replace(g.foot, turning_m=max(0.0, (1.0 + x) * g.foot.turning_m)) for g in robot.legs]
    legs = [replace(leg, foot=foot) for leg, foot in zip(robot.legs, feet, strict=True)]
    return replace(robot, legs=tuple(legs))


def _of_each_leg(robot: PhysicalRobot, name: str) -> tuple[str, ...]:
    return tuple(f"{name}@{leg.name}" for leg in robot.legs)


def _of_effect(name: str, parameter: str, where: tuple[str, ...], *, over: float = 0.0) -> Change:
    def changed(robot: PhysicalRobot, x: float) -> PhysicalRobot:
        kind = effect(name)
        return kind.apply(robot, where, kind.off | {parameter: over + x})

    return changed


def legs_aside_m(robot: PhysicalRobot) -> dict[str, float]:
    """By how much legs are heavier on one side than on the other, by the name of a nuisance [m].

    Each link weighs up to 5 % more or less than believed, each its own. What counts is where the
    weight of all is, as if the trunk's centre were aside: this is its deviation, of legs that are
    stretched out (with knees bent as in a walk, a twentieth less).
    """
    if robot.trunk is None:
        return {}
    square = dict.fromkeys(CENTRES, 0.0)
    masses = {body.name: body.mass for body in robot.bodies}
    for leg in robot.legs:
        out_m = 0.0
        for segment in SEGMENTS:
            mass = masses[f"{leg.name}.{segment}"]
            at_m = out_m + mass.centre_m[0]
            moment = MASS_OFF * mass.mass_kg / robot.trunk.mass.mass_kg
            square["centre x"] += (moment * (leg.x_m + at_m * math.cos(leg.yaw_rad))) ** 2
            square["centre y"] += (moment * (leg.y_m + at_m * math.sin(leg.yaw_rad))) ** 2
            out_m += leg.lengths_m[segment]
    return {name: math.sqrt(value) for name, value in square.items()}


def nuisances(robot: PhysicalRobot, quantum_rad: float) -> tuple[RobotNuisance, ...]:
    """All nuisances of a legged robot, in the order of a vector."""
    found = []
    aside = legs_aside_m(robot)
    for joint in robot.joints:
        found.append(
            RobotNuisance(
                f"{ZERO} {joint.name}",
                "rad",
                math.radians(1.0) / ROOT3,
                "zero +-1 deg",
                f"{ZERO} {joint.name}",
                reach=ZERO_WITHIN,
                same=(f"zero_offset@{joint.name}",),
            )
        )
        for what, spread in (("torque", 0.10), ("friction", 0.30)):
            found.append(
                RobotNuisance(
                    f"{what} {joint.name}",
                    "(ratio)",
                    spread / ROOT3,
                    f"specimens: +-{spread:.0%}",
                    f"{what} {joint.segment}",
                    joint.name,
                )
            )
        found.append(
            RobotNuisance(
                f"reading {joint.name}",
                "rad",
                quantum_rad / math.sqrt(12.0),
                "rounding of a register",
                joint=joint.name,
            )
        )
    for trial in trials(robot):
        if trial.name.split()[0] not in (ZERO, "torque", "friction"):
            unit, deviation, source = COMMON[trial.name.split()[0]]
            if trial.name in aside:
                deviation = math.hypot(deviation, aside[trial.name])
            same = SAME.get(trial.name, ())
            doubt = DOUBT.get(trial.name, 0.0)
            one = RobotNuisance(
                trial.name, unit, deviation, source, trial.name, same=same, doubt=doubt
            )
            if trial.name == TIPS:
                one = replace(one, least=0.0, idle=_of_each_leg(robot, "foot_compliance"))
            elif trial.name == STALL:
                lost = max(joint.drive.lost_at_stall for joint in robot.joints)
                one = replace(one, deviation=lost, reach=0.0, least=-1.0)
            found.append(replace(one, reach=1.0, least=0.0) if unit == SHARE else one)
    late = "jitter and turnaround of a bus; assumed"
    found.append(RobotNuisance("sampling", "s", 0.0015, late))
    found.append(RobotNuisance("turn", "(ratio)", 0.15, "when it is a servo's turn; assumed"))
    return tuple(found)


#: nuisances of a register's reading: no replay has them, but their traces are exact
READ = frozenset({"reading", "sampling", "turn"})


def replayable(nuisances: Sequence[RobotNuisance], z: Floats) -> Floats:
    """Values that a replay has: 0 of what is only read otherwise."""
    able = [nuisance.name.split()[0] not in READ for nuisance in nuisances]
    return np.where(able, z, 0.0)


def with_nuisances(
    robot: PhysicalRobot, every: Sequence[RobotNuisance], z: Sequence[float]
) -> PhysicalRobot:
    """The robot with nuisances at some values of deviations, those that a replay can have."""
    known = {trial.name: trial for trial in _changes(robot)}
    own = {"torque": _torque, "friction": _friction}
    for nuisance, deviations in zip(every, z, strict=True):
        x = deviations * nuisance.deviation
        change = own.get(nuisance.name.split()[0])
        if x == 0.0:
            continue
        if change is None:
            robot = known[nuisance.name].change(robot, x)
        else:
            joints = tuple(
                replace(j, drive=change(j.drive, x)) if j.name == nuisance.joint else j
                for j in robot.joints
            )
            robot = replace(robot, joints=joints)
    return robot


MASS_OFF = 0.05 / ROOT3  #: deviation of a mass over what it is believed to be; masses +-5 %
CENTRES = ("centre x", "centre y")  #: nuisances that stand for what legs weigh on each side, too

#: of the whole robot: unit, deviation, source
COMMON = {
    "mass": ("(ratio)", MASS_OFF, "masses +-5 %"),
    "centre": ("m", 0.003 / ROOT3, "centre of mass +-3 mm, and legs of unlike masses"),
    "tilt": ("rad", math.radians(1.0) / ROOT3, "tilt up to 1 deg"),
    "supply": ("(ratio)", 0.02, "battery from charge to charge; assumed"),
    "gain": ("(ratio)", 0.03, "scale of a gain register; assumed"),
    LATE: ("s", 0.001, "a host's adapter; assumed"),
    "grip": ("(ratio)", 0.20 / ROOT3, "friction of a floor +-20 %; assumed"),
    TURNING: ("(ratio)", 0.5, "a foot turns on a point, or on all of its width; assumed"),
    "motors": ("(ratio)", 0.10 / ROOT3, "motors of one make: +-10 %"),
    STALL: ("(ratio)", 0.06, "whether a stall torque is told with friction or before it; assumed"),
    "gears": ("(ratio)", 0.15, "friction of one make, warm or cold; assumed"),
    "rotors": ("(ratio)", 0.02, "rotors of one make; assumed"),
    TIPS: ("m/N", 2.5e-5, "no foot is rigid, the stiffest rubber tips give 50 um/N; assumed"),
    PUNCH: (SHARE, 1.0, "whether a PID law adds its punch is documented nowhere; assumed"),
}

#: share by which a number may be off that no data sheet has, and files assume; assumed as well
DOUBT = {"rotors": 0.2}

#: effects at places that are a nuisance without its prior
SAME = {
    **{f"mass {segment}": (f"link_mass@{segment}",) for segment in SEGMENTS},
    "mass trunk": ("link_mass@trunk", "payload@all"),
    **{f"centre {axis}": (f"com_offset.{axis}@trunk",) for axis in "xyz"},
    **{f"tilt {axis}": (f"ground_tilt.{axis}@all",) for axis in ("pitch", "roll")},
    "supply": ("supply_voltage@all",),
    "gain": ("gain_error@all",),
    LATE: ("transport_delay@all",),
    "grip": ("foot_slip@all",),
    TIPS: ("foot_compliance@all",),
    "motors": ("torque_constant@all",),
    "rotors": ("rotor_inertia@all",),
    PUNCH: ("punch@all",),
}


def trials(robot: PhysicalRobot) -> tuple[Trial, ...]:
    """The replays that show the nuisances' traces; of feet only if nobody told how they give."""
    rigid = all(math.isinf(leg.foot.stiffness_n_m) for leg in robot.legs)
    return tuple(trial for trial in _changes(robot) if rigid or trial.name != TIPS)


def _changes(robot: PhysicalRobot) -> list[Trial]:
    found = [
        Trial(
            f"{ZERO} {j.name}",
            math.radians(1.0) / ROOT3,
            _of_effect("zero_offset", "offset_rad", (j.name,)),
        )
        for j in robot.joints
    ]
    for segment in SEGMENTS:
        found.append(Trial(f"torque {segment}", 0.1, _drives(segment, _torque)))
        found.append(Trial(f"friction {segment}", 0.3, _drives(segment, _friction)))
        found.append(Trial(f"mass {segment}", 0.1, _link_mass(segment)))
    found.append(Trial("mass trunk", 0.05, _trunk_mass))
    for axis in "xyz":
        found.append(
            Trial(f"centre {axis}", 0.003, _of_effect("com_offset", f"{axis}_m", ("trunk",)))
        )
    for axis in ("pitch", "roll"):
        change = _of_effect("ground_tilt", f"{axis}_rad", ())
        found.append(Trial(f"tilt {axis}", math.radians(1.0), change))
    found.append(Trial("supply", 0.03, _supply))
    found.append(Trial("gain", 0.05, _of_all(_gain)))
    found.append(Trial("motors", 0.06, _of_all(_torque)))
    found.append(Trial(STALL, -0.05, _of_effect(STALL, "scale", (), over=1.0), one_way=True))
    found.append(Trial("gears", 0.2, _of_all(_friction)))
    found.append(Trial("rotors", 0.2, _of_all(_rotor)))
    found.append(Trial(PUNCH, 0.5, _of_all(_punch), one_way=True))
    found.append(Trial(LATE, 0.002, later, one_way=True))
    found.append(Trial(TIPS, 2e-5, _tips, one_way=True))
    found.append(Trial("grip", 0.15, _of_effect("foot_slip", "scale", (), over=1.0)))
    found.append(Trial(TURNING, 0.5, turning))
    return found
