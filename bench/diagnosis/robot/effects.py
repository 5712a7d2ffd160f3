"""Effects of a whole robot, place by place: all joints, a kind of them, a leg, a joint.

Each is an effect of the catalogue narrowed to one number: a name like ``joint_compliance@tibia`` or
``com_offset.y@trunk`` says which effect, which of its parameters if it has several that act alone,
and where. What only goes with the number (the damping of a spring) is typical, or off where it
would act by itself.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from sim.effects import Effect, Group, Parameter, Scope, catalogue
from sim.effects.effect import TRUNK
from sim.tree import SEGMENTS, PhysicalRobot

from ..knobs import Knob

#: effects that no walk shows, that nobody tells from another, or of the reading of a register
OUTSIDE = frozenset(
    {
        "acceleration_limit",
        "back_emf",
        "encoder_nonlinearity",
        "gear_spring",
        "latency_timer",
        "load_of_gear",
        "load_refresh",
        "lost_samples",
        "overload_shutdown",
        "presliding",
        "punch_left_out",
        "read_skew",
        "stall_torque",
        "thermal_derating",
        "torque_droop",
    }
)
#: effects of one specimen, which no two joints have alike
SINGLE = frozenset({"zero_offset"})
#: effects of a servo's model, which joints of one kind have no more than others of the same servo
OF_MODEL = frozenset({"rotor_inertia"})
EVERYWHERE = "all"
CARRYING = ("femur", "tibia")  #: joints with level axes, which carry the robot; gears wear in both
#: ``z`` of a first try, where the unit is far from what one meets
FIRST = {"roll_rad": 0.1, "yaw_rad": 0.3, "resistance_ohm": 2.0}
#: ``z`` of further first tries of what does nothing up to a level, and soon too much: limits of
#: 0.5, 0.4 and 0.3 of a motor's duty, which walking robots ask for; assumed
LEVELS = {"duty": (1.25, 1.5, 1.75)}
#: a trunk that is heavier and a weight on it differ by nothing but where in the trunk the mass is:
#: whoever has no name for the second has none for the first. Where neither gains more, it is the
#: second: a trunk was weighed, and what is put on it later nobody has to tell
ONE_WITH = {f"link_mass@{TRUNK}": f"payload@{EVERYWHERE}"}


@dataclass(frozen=True, slots=True)
class Placed:
    """One number of an effect at one place."""

    effect: Effect
    parameter: Parameter
    place: str
    where: tuple[str, ...]
    companions: Mapping[str, float]
    several: bool  #: the effect has other numbers that act alone

    @property
    def name(self) -> str:
        """As in the module's text."""
        number = f".{self.parameter.name.split('_')[0]}" if self.several else ""
        return f"{self.effect.name}{number}@{self.place}"

    @property
    def knob(self) -> Knob:
        """The number as a knob; its effect bears the full name."""
        return Knob(self.name, self.parameter, self.where)

    def left_out(self, without: Collection[str]) -> bool:
        """Whether it goes with effects that are left out of the catalogue."""
        kind = ONE_WITH.get(self.name, "").partition("@")[0]
        return self.effect.name in without or kind in without

    @property
    def first_z(self) -> float:
        """A first try."""
        return FIRST.get(self.parameter.name, 1.0)

    @property
    def levels(self) -> tuple[float, ...]:
        """Further first tries."""
        return LEVELS.get(self.parameter.name, ())

    def apply(self, robot: PhysicalRobot, value: float) -> PhysicalRobot:
        """The robot with it; exactly the robot itself where the value is off."""
        values = {**self.companions} | {self.parameter.name: value}
        return self.effect.apply(robot, self.where, values)


def placed_effects(robot: PhysicalRobot) -> dict[str, Placed]:
    """All effects at all places of a legged robot, by name."""
    found = {}
    for kind in catalogue().values():
        if kind.name in OUTSIDE:
            continue
        for place, where in _places(kind, robot):
            numbers = _numbers(kind, robot)
            for parameter in numbers:
                companions = _companions(kind, robot, parameter)
                placed = Placed(kind, parameter, place, where, companions, len(numbers) > 1)
                found[placed.name] = placed
    return found


def _places(kind: Effect, robot: PhysicalRobot) -> list[tuple[str, tuple[str, ...]]]:
    legs = [leg.name for leg in robot.legs]
    if kind.scope is Scope.JOINT:
        names = [joint.name for joint in robot.joints]
        if kind.name in SINGLE:
            return [(name, (name,)) for name in names]
    elif kind.scope is Scope.LEG:
        return [(EVERYWHERE, ()), *((leg, (leg,)) for leg in legs)]
    elif kind.scope is Scope.BODY:
        names = [body.name for body in robot.bodies]
        trunk: list[tuple[str, tuple[str, ...]]] = [(TRUNK, (TRUNK,))]
        if kind.name == "com_offset":
            return trunk
        return trunk + [(s, _ending(names, s)) for s in SEGMENTS]
    else:
        return [(EVERYWHERE, ())]
    alike = kind.name in OF_MODEL and all(j.drive == robot.joints[0].drive for j in robot.joints)
    kinds = [] if alike else [(s, _ending(names, s)) for s in SEGMENTS]
    worn = kind.group is Group.GEAR and not alike
    pair = "+".join(CARRYING)
    carrying = [(pair, tuple(n for s in CARRYING for n in _ending(names, s)))]
    found = [
        (EVERYWHERE, ()),
        *kinds,
        *(carrying if worn else ()),
    ]
    for leg in legs:
        own = [n for n in names if n.startswith(f"{leg}.")]
        found.append((leg, tuple(own)))
        if worn:
            found.append((f"{leg}.{pair}", tuple(n for s in CARRYING for n in _ending(own, s))))
        found += [(joint, (joint,)) for joint in own]
    return found


def leg_of(place: str, legs: Collection[str]) -> str:
    """The leg that a place is in; none if it is in several."""
    leg = place.partition(".")[0]
    return leg if leg in legs else ""


def _ending(names: list[str], segment: str) -> tuple[str, ...]:
    return tuple(name for name in names if name.endswith(f".{segment}"))


def _numbers(kind: Effect, robot: PhysicalRobot) -> list[Parameter]:
    """Parameters that do something alone; of effects outside the body only the first."""
    amplitudes = [p for p in kind.parameters if not p.shape]
    if kind.group is not Group.BODY:
        return amplitudes[:1]
    some = []
    for parameter in amplitudes:
        values = kind.off | {parameter.name: Knob(kind.name, parameter).value(0.3)}
        if kind.apply(robot, (), values) != robot:
            some.append(parameter)
    return some


def _companions(kind: Effect, robot: PhysicalRobot, parameter: Parameter) -> dict[str, float]:
    off = {parameter.name: parameter.off}
    if kind.apply(robot, (), kind.typical | off) == robot:
        return kind.typical
    shapes = {p.name: p.typical for p in kind.parameters if p.shape}
    return kind.off | shapes
