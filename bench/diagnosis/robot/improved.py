"""The better model of a whole robot: what a search found, as effects for the robot's file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import tomli_w

from bench.files import write_text
from busemu.tables import Robot
from sim.effects import Parameter, effect
from sim.model import Addition, Estimate, with_additions
from sim.tree import Joint, PhysicalRobot

from ..joint.nuisances import PUNCH, STALL
from ..result import Estimate as Found
from .effects import Placed
from .nuisances import LATE, TIPS, TURNING, RobotNuisance, later, tip_of, turning

FRICTION, GEARS = "friction", "gears"  #: nuisances of one joint's friction, and of that of all
#: nuisances as effects, by the first word of their names: the effect and its parameter
PLACES = {
    "zero": ("zero_offset", "offset_rad"),
    "torque": ("torque_constant", "scale"),
    "motors": ("torque_constant", "scale"),
    STALL: ("stall_torque", "scale"),
    "mass": ("link_mass", "scale"),
    "supply": ("supply_voltage", "scale"),
    "gain": ("gain_error", "scale"),
    LATE: ("transport_delay", "delay_s"),
    "grip": ("foot_slip", "scale"),
    "rotors": ("rotor_inertia", "scale"),
    PUNCH: ("punch_left_out", "share"),
}


def of_causes(
    placed: Sequence[tuple[Placed, Mapping[str, Found]]], recordings: str
) -> list[Addition]:
    """Named effects with their estimates; what only goes with them is typical, and says so."""
    return [
        _placed(
            one,
            {
                name: Estimate(within(one.parameter, e.value), recordings, e.ci95)
                for name, e in found.items()
            },
            recordings,
        )
        for one, found in placed
    ]


def of_settings(
    placed: Mapping[str, Placed], settings: Iterable[tuple[str, float]], recordings: str
) -> list[Addition]:
    """Effects at values of their knobs, as :func:`of_causes` has them once they are named."""
    made = []
    for name, z in settings:
        one = placed[name]
        value = within(one.parameter, one.knob.value(z))
        own = {one.parameter.name: Estimate(value, recordings)}
        made.append(_placed(one, own, recordings))
    return made


def _placed(one: Placed, estimates: dict[str, Estimate], recordings: str) -> Addition:
    for name, value in one.companions.items():
        if name not in estimates and value != one.effect.off[name]:
            source = f"assumed, typical: goes with {one.parameter.name}; {recordings}"
            estimates[name] = Estimate(value, source)
    return Addition(one.effect, one.where, estimates)


def of_nuisances(
    base: PhysicalRobot, nuisances: Sequence[RobotNuisance], z: Sequence[float], recordings: str
) -> list[Addition]:
    """What is never exactly as believed, as it was fitted: what belongs to the robot itself.

    Instants of sampling, roundings, the ground's tilt and how feet turn on it do not.
    """
    values = {n.name: x * n.deviation for n, x in zip(nuisances, z, strict=False) if x != 0.0}
    made = []
    for name, x in values.items():
        made += _addition(base, name, x, f"nuisance {name}; {recordings}")
    gears = 1.0 + values.get(GEARS, 0.0)
    for joint in base.joints:
        own = f"{FRICTION} {joint.name}"
        more = (1.0 + values.get(own, 0.0)) * gears - 1.0
        if more != 0.0:
            made += _friction(joint, more, f"nuisances {own} and {GEARS}; {recordings}")
    return made


def of_room(nuisances: Sequence[RobotNuisance], z: Sequence[float]) -> list[Addition]:
    """The tilt of the ground as it was fitted: true of the room, and so in no robot's file."""
    return [
        _one("ground_tilt", f"{n.name.split()[1]}_rad", x * n.deviation, (), "nuisance")
        for n, x in zip(nuisances, z, strict=False)
        if n.name.startswith("tilt ")
    ]


def where_recorded(
    robot: PhysicalRobot, nuisances: Sequence[RobotNuisance], z: Sequence[float]
) -> PhysicalRobot:
    """The robot in the room and at the host of its recordings, which are in no robot's file.

    That is ground as it was fitted, how feet rub that turn on it, and goals that act sooner than
    replays take them to.
    """
    robot = with_all(robot, of_room(nuisances, z))
    for nuisance, x in zip(nuisances, z, strict=False):
        if nuisance.name == LATE and x < 0.0:
            robot = later(robot, x * nuisance.deviation)
        elif nuisance.name == TURNING:
            robot = turning(robot, x * nuisance.deviation)
    return robot


def knob_of(
    base: PhysicalRobot, one: Placed, nuisance: RobotNuisance, deviations: float
) -> float | None:
    """The knob at which an effect is what a nuisance is; ``None`` where it has another number."""
    x = deviations * nuisance.deviation
    same = of_room([nuisance], [deviations]) or _addition(base, nuisance.name, x, "")
    for addition in same:
        if addition.effect is one.effect:
            z = one.knob.at(within(one.parameter, addition.values[one.parameter.name]))
            low, high = one.knob.bounds
            return min(high, max(low, z))
    return None


def tolerated(
    base: PhysicalRobot, placed: Placed, nuisances: Sequence[RobotNuisance]
) -> tuple[float, float] | None:
    """The least and the greatest value of an effect that a tolerance has; None where none has."""
    same = next((n for n in nuisances if placed.name in n.same), None)
    if same is None:
        return None
    knobs = [knob_of(base, placed, same, end) for end in same.ends if end]
    ends = [placed.knob.value(knob) for knob in knobs if knob is not None]
    ends.append(placed.parameter.off)  # of what goes one way only it is the other end
    return (min(ends), max(ends)) if len(ends) > 1 else None


def _addition(base: PhysicalRobot, name: str, x: float, told: str) -> list[Addition]:
    word, _, where = name.partition(" ")
    if word == TIPS:
        values = dict(zip(("stiffness_n_m", "damping_n_s_m"), tip_of(x), strict=True))
        tip = {key: Estimate(value, told) for key, value in values.items()}
        return [Addition(effect("foot_compliance"), (), tip)]
    if word == "centre":
        return [_one("com_offset", f"{where}_m", x, ("trunk",), told)]
    if word not in PLACES:
        return []
    kind, parameter = PLACES[word]
    places: tuple[str, ...] = ()
    if word == "mass":
        bodies = tuple(b.name for b in base.bodies if b.name.endswith(f".{where}"))
        places = (where,) if where == "trunk" else bodies
    elif where:
        places = (where,)
    value = effect(kind).parameter(parameter).off + x
    if word == LATE and value <= 0.0:
        return []  # a command that acts sooner than believed is its host's, not the robot's
    return [_one(kind, parameter, value, places, told)]


def _friction(joint: Joint, x: float, told: str) -> list[Addition]:
    levels = {
        "coulomb_friction": ("more_nm", joint.drive.friction.coulomb_nm),
        "viscous_friction": ("more_nm_s_rad", joint.drive.friction.viscous_nm_s_rad),
    }
    return [
        _one(kind, parameter, x * level, (joint.name,), told)
        for kind, (parameter, level) in levels.items()
        if level != 0.0
    ]


def _one(kind: str, parameter: str, value: float, where: tuple[str, ...], told: str) -> Addition:
    known = effect(kind)
    return Addition(
        known, where, {parameter: Estimate(within(known.parameter(parameter), value), told)}
    )


def within(parameter: Parameter, value: float) -> float:
    """A value, or the nearest that a parameter may have."""
    return min(parameter.high, max(parameter.low, value))


def with_all(robot: PhysicalRobot, added: Sequence[Addition]) -> PhysicalRobot:
    """The robot with every addition, in their order, as a file that lists them has it."""
    for addition in added:
        robot = addition.to(robot)
    return robot


def write_model(robot: Robot, added: Sequence[Addition], path: Path) -> None:
    """Write the robot file with the additions, whole or not at all."""
    write_text(path, tomli_w.dumps(with_additions(robot, added)))
