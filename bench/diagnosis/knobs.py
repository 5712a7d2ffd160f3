"""What a hypothesis may turn: parameters of effects, as plain numbers around zero.

Every knob is a number ``z`` that is 0 where its effect is off. Amplitudes are in units of their
typical size, limits (off is infinite) enter by their reciprocal, and parameters that only shape an
effect are logarithmic where they can be.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from sim.drive import fields
from sim.drive.parameters import DriveParameters
from sim.effects import Effect, Parameter, Scope, catalogue
from sim.robot import PhysicalRobot

OUTSIDE = frozenset(
    {
        "back_emf",
        "stall_torque",
        "foot_compliance",
        "foot_slip",
        "ground_compliance",
        "gear_spring",
        "load_of_gear",
        "presliding",
        "punch_left_out",
        "ground_tilt",
        "leg_geometry",
        "latency_timer",
        "lost_samples",
        "load_refresh",
    }
)  #: effects that one joint on a rig cannot have, that are seen in the data itself, or that nobody
#: tells from another (back-EMF from viscous friction)


SEEN = frozenset({"load_refresh", "lost_samples"})  #: effects that are seen in the data itself


@dataclass(frozen=True, slots=True)
class Knob:
    """One parameter of one effect, at some places (none: everywhere)."""

    effect: str
    parameter: Parameter
    where: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """``effect.parameter``."""
        return f"{self.effect}.{self.parameter.name}"

    @property
    def inverse(self) -> bool:
        """Whether it is a limit: off at infinity."""
        return math.isinf(self.parameter.off)

    @property
    def unit(self) -> float:
        """The size of the parameter at ``z = 1`` (over ``off``)."""
        p = self.parameter
        size = p.typical if self.inverse else abs(p.typical - p.off)
        return size or (p.high - p.low) / 6.0

    @property
    def logarithmic(self) -> bool:
        """Whether ``z`` is the logarithm of the parameter over its typical size."""
        return self.parameter.shape and self.parameter.low > 0.0

    @property
    def bounds(self) -> tuple[float, float]:
        """The least and the greatest ``z``."""
        p = self.parameter
        if self.logarithmic:
            return math.log(p.low / p.typical), math.log(p.high / p.typical)
        if self.inverse:
            return 0.0, self.unit / p.low
        sign = -1.0 if p.typical < p.off else 1.0
        ends = sorted(sign * (end - p.off) / self.unit for end in (p.low, p.high))
        return ends[0], ends[1]

    def value(self, z: float) -> float:
        """The parameter at ``z``."""
        p = self.parameter
        if self.logarithmic:
            return min(p.high, max(p.low, p.typical * math.exp(z)))
        if self.inverse:
            return p.off if z * p.high <= self.unit else max(p.low, self.unit / z)
        sign = -1.0 if p.typical < p.off else 1.0
        return min(p.high, max(p.low, p.off + sign * self.unit * z))

    def at(self, value: float) -> float:
        """The ``z`` at which the parameter has a value."""
        p = self.parameter
        if self.logarithmic:
            return math.log(value / p.typical)
        if self.inverse:
            return self.unit / value
        return (-1.0 if p.typical < p.off else 1.0) * (value - p.off) / self.unit

    def slope(self, z: float) -> float:
        """How fast the parameter goes with ``z``: its unit of error."""
        if self.logarithmic:
            return self.value(z)
        if self.inverse:
            return self.unit / max(z, 1e-9) ** 2
        return self.unit


#: effects that are a nuisance without its prior, and that nuisance
TWINS = {
    "coulomb_friction": "coulomb_level",
    "viscous_friction": "viscous_level",
    "payload": "payload",
    "gain_error": "gain",
    "zero_offset": "zero",
    "supply_voltage": "supply",
    "torque_constant": "torque_constant",
    "link_mass": "link",
    "read_skew": "sampling",
    "rotor_inertia": "rotor_level",
}


SOFTER = "joint_compliance"
VISCOUS = "viscous_friction"
#: parameters that one joint on a rig cannot show: a weight is where the robot file puts it; and a
#: gear's damping, of which nobody knows enough to call any a finding
NOT_TURNED = frozenset(
    {("payload", "x_m"), ("payload", "y_m"), ("payload", "z_m"), (SOFTER, "damping_nm_s_rad")}
)
#: of a nuisance that its effect counts in another unit: what the ratio is of
AMOUNTS = {"coulomb_level": fields.COULOMB, "viscous_level": fields.VISCOUS}


def effect_knobs(effect: Effect, where: Iterable[str] = ()) -> tuple[Knob, ...]:
    """All knobs of an effect that one joint can show."""
    return tuple(
        Knob(effect.name, parameter, tuple(where))
        for parameter in effect.parameters
        if (effect.name, parameter.name) not in NOT_TURNED
    )


def joint_effects() -> dict[str, Effect]:
    """Effects that one joint on a rig can have."""
    scopes = (Scope.JOINT, Scope.ROBOT, Scope.BODY, Scope.BUS)
    return {
        name: effect
        for name, effect in catalogue().items()
        if name not in OUTSIDE and effect.scope in scopes
    }


def of_drive(effects: Mapping[str, Effect], drive: DriveParameters) -> dict[str, Effect]:
    """The same effects, of which none takes more friction from a drive than it is believed to have.

    An effect changes nothing beyond that, and a size that is told of it would be none.
    """
    least = {
        "coulomb_friction": drive.friction.coulomb_nm,
        VISCOUS: drive.friction.viscous_nm_s_rad,
    }
    bounded = dict(effects)
    for name in least.keys() & effects.keys():
        (amount,) = effects[name].parameters
        low = max(amount.low, -least[name])
        bounded[name] = replace(effects[name], parameters=(replace(amount, low=low),))
    return bounded


def with_effects(robot: PhysicalRobot, knobs: Sequence[Knob], z: Sequence[float]) -> PhysicalRobot:
    """The robot with every effect of some knobs at its values."""
    by_effect: dict[tuple[str, tuple[str, ...]], dict[str, float]] = {}
    for knob, x in zip(knobs, z, strict=True):
        by_effect.setdefault((knob.effect, knob.where), {})[knob.parameter.name] = knob.value(x)
    known = catalogue()
    for (name, where), values in by_effect.items():
        effect = known[name]
        robot = effect.apply(robot, where, effect.off | values)
    return robot
