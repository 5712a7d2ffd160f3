"""What each effect changes in a specimen, and what its parameters truly are at a size.

Sizes go from the off value 0 upward. Where a nuisance of every case is of the same kind (a mass off
by 5 %), a size counts from the nuisance's bound, so that an effect is never less than what a null
may have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from . import parts
from .instant import OPEN, Gate, Gated, GateKind, Part
from .specimen import Specimen

PLAINLY = 0.2  #: share by which a period that is renewed more seldom is longer, at least


class Quantity(NamedTuple):
    """A true value with its unit; ``off`` is the value at which the effect is not there."""

    value: float
    unit: str
    off: float


Truth = dict[str, Quantity]


@dataclass(frozen=True, slots=True)
class Setting:
    """What an effect has besides its size: a sign, a number that chooses, and where it is."""

    sign: int = 1
    choice: float = 0.5  #: 0 to 1
    gate: Gate = OPEN


def _part(specimen: Specimen, part: Part, gate: Gate) -> Specimen:
    return specimen.plus(part if gate.kind is GateKind.ALWAYS else Gated(part, gate))


def backlash(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Play between rotor and output; rare: in a sector of worn teeth."""
    return s.gear_but(play_rad=p, play_gate=how.gate), {"width_rad": Quantity(p, "rad", 0.0)}


def joint_compliance(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A gear more springy than it is built; the size is the compliance beyond [rad/(N m)]."""
    built = s.gear.stiffness_nm_rad or math.inf
    if p == 0.0:
        return s, {"stiffness_nm_rad": Quantity(built, "N m/rad", built)}
    stiffness = 1.0 / (1.0 / built + p)
    inertia = s.arm.mass_kg * sum(x * x for x in s.arm.com_m) + s.arm.inertia_kg_m2[1]
    inertia += s.payload_kg * s.payload_at_m**2
    ratio = 0.03 + 0.07 * how.choice
    damping = 2.0 * ratio * math.sqrt(stiffness * inertia)
    truth = {
        "stiffness_nm_rad": Quantity(stiffness, "N m/rad", built),
        "damping_nm_s_rad": Quantity(damping, "N m s/rad", 0.0),
    }
    more = s.gear.damping_nm_s_rad + damping
    return s.gear_but(stiffness_nm_rad=stiffness, damping_nm_s_rad=more), truth


def rotor_inertia(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """More inertia of the rotor, at the output shaft."""
    truth = {"inertia_kg_m2": Quantity(p, "kg m^2", 0.0)}
    return s.but(armature_kg_m2=s.armature_kg_m2 + p), truth


def viscous(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """More viscous friction than the believed."""
    more = (0.3 * s.sheet.viscous_nm_s_rad if p else 0.0) + p
    truth = {"coefficient_nm_s_rad": Quantity(more, "N m s/rad", 0.0)}
    return _part(s, parts.Viscous(more), how.gate), truth


def coulomb(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """More dry friction than the believed."""
    more = (0.3 * s.sheet.coulomb_nm if p else 0.0) + p
    return _part(s, parts.Coulomb(more), how.gate), {"torque_nm": Quantity(more, "N m", 0.0)}


def stribeck(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Friction that is higher at standstill and falls with the speed."""
    velocity = 0.08 + 0.3 * how.choice
    truth = {
        "torque_nm": Quantity(p, "N m", 0.0),
        "velocity_rad_s": Quantity(velocity, "rad/s", math.nan),
    }
    return _part(s, parts.Stribeck(p, velocity), how.gate), truth


def load_friction(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Friction that grows with the transmitted torque."""
    return _part(s, parts.LoadFriction(p), how.gate), {"coefficient": Quantity(p, "", 0.0)}


def directional(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Friction of load that differs between driving and being driven."""
    external = p * (0.1 + 0.4 * how.choice)
    truth = {
        "motor_coefficient": Quantity(p, "", 0.0),
        "external_coefficient": Quantity(external, "", 0.0),
    }
    return _part(s, parts.DirectionalFriction(p, external), how.gate), truth


def cable(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A cable that pulls to where it was laid."""
    rest = how.sign * (0.3 + 0.9 * how.choice)
    truth = {
        "stiffness_nm_rad": Quantity(p, "N m/rad", 0.0),
        "rest_rad": Quantity(rest, "rad", math.nan),
    }
    return _part(s, parts.Cable(p, rest), how.gate), truth


def dead_zone(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """An error that the firmware lets stand, each side, beyond the register's margin."""
    return s.but(margin_rad=s.margin_rad + p), {"margin_rad": Quantity(p, "rad", 0.0)}


def punch(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A least duty beyond the register's."""
    return s.but(punch=s.punch + p), {"duty": Quantity(p, "", 0.0)}


def gain(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A position gain other than its register says."""
    factor = 1.0 + how.sign * (p + (0.1 if p else 0.0))
    return s.but(gain_factor=s.gain_factor * factor), {"factor": Quantity(factor, "", 1.0)}


def integral(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """An integral gain that nobody set."""
    truth = {"gain_per_rad_s": Quantity(p, "1/(rad s)", 0.0)}
    return s.plus(parts.Integral(p)), truth


def velocity_limit(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A limit of the goal's speed; the size is its inverse [s/rad]."""
    limit = math.inf if p == 0.0 else 1.0 / p
    return s.plus(parts.SpeedLimit(limit)), {"limit_rad_s": Quantity(limit, "rad/s", math.inf)}


def torque_limit(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A duty limit; the size is what is missing to full duty."""
    part = parts.DutyLimit(1.0 - p)
    return _part(s, part, how.gate), {"duty_limit": Quantity(1.0 - p, "", 1.0)}


def delay(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Goals that act late."""
    return s.but(goal_late_s=s.goal_late_s + p), {"delay_s": Quantity(p, "s", 0.0)}


def supply(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A constant supply voltage other than typed in."""
    nominal = s.sheet.rated_voltage_v
    volts = s.supply_v + how.sign * nominal * (p + (0.03 if p else 0.0))
    return s.but(supply_v=volts), {"voltage_v": Quantity(volts, "V", nominal)}


def sag(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A source resistance of supply and wires."""
    truth = {"resistance_ohm": Quantity(p, "ohm", 0.0)}
    if p == 0.0:
        return s, truth
    return _part(s, parts.Sag(p, s.back_emf_v_s_rad), how.gate), truth


def thermal(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A winding that warms up and loses torque; the size is its resistance to heat [K/W]."""
    constant_s = 4.0 + 8.0 * how.choice
    truth = {
        "heat_resistance_k_w": Quantity(p, "K/W", 0.0),
        "time_constant_s": Quantity(constant_s, "s", math.nan),
    }
    return s.plus(parts.Heat(p, constant_s, s.sheet.rated_voltage_v)), truth


def overload(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A shutdown above a duty; the size is what is missing to full duty."""
    hold_s = 0.2 + 0.5 * how.choice
    truth = {
        "duty": Quantity(1.0 - p, "", math.inf),
        "overload_s": Quantity(hold_s, "s", math.inf),
    }
    if p == 0.0:
        return s, truth
    return s.plus(parts.Overload(1.0 - p, hold_s)), truth


def zero(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A horn that sits a little turned on its shaft."""
    angle = how.sign * (p + (math.radians(1.0) if p else 0.0))
    truth = {"angle_rad": Quantity(s.sensing.zero_rad + angle, "rad", 0.0)}
    return s.sensing_but(zero_rad=s.sensing.zero_rad + angle), truth


def encoder(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """An angle sensor that is off the axis: an error once a turn."""
    phase = 2.0 * math.pi * how.choice
    # seen - true = atan2(sin q + y, cos q + x) - q, to first order y cos q - x sin q
    changed = s.sensing_but(eccentric_x=-p * math.cos(phase), eccentric_y=p * math.sin(phase))
    truth = {
        "amplitude_rad": Quantity(p, "rad", 0.0),
        "harmonic": Quantity(1.0, "", math.nan),
        "phase_rad": Quantity(phase, "rad", math.nan),
    }
    return changed, truth


def read_skew(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Positions that are older than the reply."""
    return s.sensing_but(late_s=s.sensing.late_s + p), {"skew_s": Quantity(p, "s", 0.0)}


def load_refresh(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A load register that is renewed more seldom than believed: plainly so, if at all.

    One that is believed to show every value is renewed at the firmware's ticks.
    """
    renewed_s = max(s.sensing.hold_s, s.tick_s)
    period = renewed_s * (1.0 + PLAINLY) + p if p else s.sensing.hold_s
    truth = {"period_s": Quantity(period, "s", s.sheet.load_refresh_s)}
    return s.sensing_but(hold_s=period), truth


def lost(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """Positions with a bit turned over."""
    return s.sensing_but(outlier_rate=p), {"rate": Quantity(p, "", 0.0)}


def link_mass(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """An arm heavier or lighter than weighed, evenly."""
    factor = 1.0 + how.sign * (p + (0.05 if p else 0.0))
    inertia = (
        s.arm.inertia_kg_m2[0] * factor,
        s.arm.inertia_kg_m2[1] * factor,
        s.arm.inertia_kg_m2[2] * factor,
    )
    changed = s.arm_but(mass_kg=s.arm.mass_kg * factor, inertia_kg_m2=inertia)
    return changed, {"factor": Quantity(factor, "", 1.0)}


def payload(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """A weight heavier than written down."""
    more = p + (0.05 * s.heaviest_kg if p else 0.0)
    return s.but(payload_kg=s.payload_kg + more), {"mass_kg": Quantity(more, "kg", 0.0)}


def com(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    """An arm whose centre of mass lies off its middle."""
    off = how.sign * (p + (0.003 if p else 0.0))
    x, y, z = s.arm.com_m
    return s.arm_but(com_m=(x + off, y, z)), {"x_m": Quantity(off, "m", 0.0)}
