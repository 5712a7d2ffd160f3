"""What an effect is: physics that can be switched on in a robot, with its parameters.

An effect takes a robot and gives a robot: nothing is changed in place. With every parameter at its
``off`` value the robot that comes out is equal to the one that went in, so the model is the base
model to the bit.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from ..drive.parameters import DriveParameters
from ..entries import PhysicsError
from ..shapes import MassProperties
from ..tree import Joint, Leg, PhysicalRobot

Values = Mapping[str, float]
TRUNK = "trunk"


class Group(enum.Enum):
    """Families of the catalogue."""

    GEAR = "gear and link"
    FRICTION = "friction"
    CONTROLLER = "controller"
    ELECTRICAL = "electrical, thermal"
    SENSING = "sensing and bus"
    BODY = "body and contact"


class Scope(enum.Enum):
    """What one instance of an effect belongs to."""

    JOINT = "joint"
    LEG = "leg"
    BODY = "body"  #: named by the joint that moves it; a hexapod's root is ``trunk``
    ROBOT = "robot"
    BUS = "bus"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an effect: its unit, bounds, a typical size, and where it is off."""

    name: str
    unit: str
    low: float
    high: float
    typical: float
    off: float
    source: str  #: of bounds and typical size, or "assumed"
    shape: bool = False  #: gives the effect its form only: alone it does nothing

    def check(self, value: float) -> None:
        """Raise :class:`PhysicsError` when a value is not within the bounds."""
        if not (value == self.off or self.low <= value <= self.high):  # no bound holds for NaN
            raise PhysicsError(
                f"{self.name} = {value:g} {self.unit} is not within {self.low:g} to "
                f"{self.high:g} {self.unit}"
            )


@dataclass(frozen=True, slots=True)
class Effect:
    """One piece of physics of the catalogue.

    ``change(robot, where, values)`` gives the robot with the effect; ``where`` holds the names of
    joints, legs or bodies, as the scope says, and is empty for the rest.
    """

    name: str
    group: Group
    scope: Scope
    enters: str  #: ``drive``, ``controller``, ``sensor``, ``bus``, ``body`` or ``contact``
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    change: Callable[[PhysicalRobot, frozenset[str], Values], PhysicalRobot]
    note: str = ""  #: what else a user has to know, in sentences

    def parameter(self, name: str) -> Parameter:
        """A parameter by its name. Raises :class:`PhysicsError`."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        known = ", ".join(p.name for p in self.parameters)
        raise PhysicsError(f"effect {self.name} has no parameter {name!r}: it has {known}")

    @property
    def off(self) -> dict[str, float]:
        """Parameters at which the robot stays as it is."""
        return {p.name: p.off for p in self.parameters}

    @property
    def typical(self) -> dict[str, float]:
        """Parameters of a typical size."""
        return {p.name: p.typical for p in self.parameters}

    def places(self, robot: PhysicalRobot) -> frozenset[str]:
        """Every place of a robot where the effect may act."""
        if self.scope is Scope.JOINT:
            return frozenset(joint.name for joint in robot.joints)
        if self.scope is Scope.LEG:
            return frozenset(leg.name for leg in robot.legs)
        if self.scope is Scope.BODY:
            trunk = () if robot.trunk is None else (TRUNK,)
            return frozenset((*trunk, *(body.name for body in robot.bodies)))
        return frozenset()

    def apply(self, robot: PhysicalRobot, where: Iterable[str], values: Values) -> PhysicalRobot:
        """The robot with the effect at some places (none named: everywhere).

        Values not given are typical ones. Raises :class:`PhysicsError` for a place the robot does
        not have, an unknown parameter or a value out of its bounds.
        """
        places = self.places(robot)
        wide = self.scope in (Scope.ROBOT, Scope.BUS)
        if not wide and not places:
            raise PhysicsError(f"effect {self.name}: {robot.name} has no {self.scope.value}")
        chosen = frozenset(where) or places
        if unknown := sorted(chosen - places):
            if wide:
                raise PhysicsError(
                    f"effect {self.name} acts on the whole {self.scope.value}, not on "
                    f"{unknown[0]!r}: leave where away"
                )
            raise PhysicsError(
                f"effect {self.name}: {robot.name} has no {self.scope.value} {unknown[0]!r}: use "
                f"{', '.join(sorted(places))}, or leave where away for all of them"
            )
        for name, value in values.items():
            try:
                self.parameter(name).check(value)
            except PhysicsError as error:
                raise PhysicsError(f"effect {self.name}: {error}") from None
        return self.change(robot, chosen, self.typical | dict(values))


def on_joints(change: Callable[[Joint, Values], Joint]) -> Callable[..., PhysicalRobot]:
    """An effect's ``change`` from what it does to one joint."""

    def everywhere(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
        joints = tuple(change(j, values) if j.name in where else j for j in robot.joints)
        return replace(robot, joints=joints)

    return everywhere


def shared(now: float, share: float) -> float:
    """How much of all there is, once a share of what there was ``now`` to add has been added."""
    return now + (1.0 - now) * share


def on_drives(
    change: Callable[[DriveParameters, Values], DriveParameters],
) -> Callable[..., PhysicalRobot]:
    """An effect's ``change`` from what it does to one servo's drive."""
    return on_joints(lambda joint, values: replace(joint, drive=change(joint.drive, values)))


def on_legs(change: Callable[[Leg, Values], Leg]) -> Callable[..., PhysicalRobot]:
    """An effect's ``change`` from what it does to one leg's foot."""

    def everywhere(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
        legs = tuple(change(leg, values) if leg.name in where else leg for leg in robot.legs)
        return replace(robot, legs=legs)

    return everywhere


def on_masses(
    change: Callable[[MassProperties, Values], MassProperties],
) -> Callable[..., PhysicalRobot]:
    """An effect's ``change`` from what it does to the mass properties of one body."""

    def everywhere(robot: PhysicalRobot, where: frozenset[str], values: Values) -> PhysicalRobot:
        if robot.trunk is not None and TRUNK in where:
            trunk = replace(robot.trunk, mass=change(robot.trunk.mass, values))
            robot = replace(robot, trunk=trunk)
        chosen = [body for body in robot.bodies if body.name in where]
        return robot.with_bodies(
            *(replace(body, mass=change(body.mass, values)) for body in chosen)
        )

    return everywhere
