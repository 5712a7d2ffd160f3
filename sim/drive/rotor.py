"""What turns a servo's rotor and what holds it: motor, friction, gear. Compiled.

Motor: ``torque = k i / (1 + droop |i|)`` with ``i = (duty V - ke w) / R``; the droop of most is 0.

Friction is a budget (Duclusaud et al., Extended Friction Models for the Physics Simulation of Servo
Actuators, 2025): the friction that would stop the rotor within the step, limited by a level, so
that a resting rotor rests. The level is their model M6; M1 to M5 are M6 with zeros. Before it
slips, friction may give way by a small angle, as a spring and a damper do (presliding: Dupont,
Hayward, Armstrong and Altpeter, IEEE Trans. Autom. Control 47(5), 2002); an angle of 0 is none.
"""

from __future__ import annotations

from typing import NamedTuple

from ..compiling import inlined
from .elementary import decay
from .fields import (
    BACK_EMF,
    BACKLASH,
    BREAKAWAY,
    COULOMB,
    CURRENT_CAP,
    FALLING,
    GEAR_DAMPING,
    GEAR_STIFFNESS,
    LOAD_EXTERNAL,
    LOAD_EXTERNAL_STRIBECK,
    LOAD_MOTOR,
    LOAD_MOTOR_STRIBECK,
    QUADRATIC_EXTERNAL,
    QUADRATIC_MOTOR,
    STRIBECK,
    STRIBECK_EXPONENT,
    STRIBECK_VELOCITY,
    TORQUE_CONSTANT,
    TORQUE_DROOP,
    VISCOUS,
    Array,
)

#: how long the damper beside friction's spring takes to let it go [s]; assumed: a rotor of 0.004
#: kg m^2 that 0.05 N m hold with 1 mrad is then damped a little less than halfway to critical
LETS_GO_S = 0.004
LEAST = 1e-30  #: [rad] what a rotor without friction is divided by


class Train(NamedTuple):
    """What the rotor's motion within one tick takes from the arrays, as plain numbers."""

    volts: float  #: at the bridge, 0 when it is open
    conductance: float  #: of the winding, 0 when the bridge is open
    torque_constant: float
    back_emf: float
    current_cap: float
    torque_droop: float
    coulomb: float
    viscous: float
    load_motor: float
    load_external: float
    stribeck: float
    stribeck_velocity: float
    stribeck_exponent: float
    load_motor_stribeck: float
    load_external_stribeck: float
    quadratic_motor: float
    quadratic_external: float
    slow: bool  #: whether any term falls with velocity
    raised: bool  #: whether that is to another power than 1, which takes long
    stiffness: float
    damping: float
    half_backlash: float
    breakaway: float


@inlined
def falling(params: Array, i: int) -> bool:
    """Whether any term of a servo's friction falls with velocity."""
    found = False
    for field in FALLING:
        found |= params[field, i] != 0.0
    return found


@inlined
def is_raised(params: Array, i: int) -> bool:
    """Whether a servo's friction falls with another power of the velocity than 1."""
    return bool(params[STRIBECK_EXPONENT, i] != 1.0)


@inlined
def train(
    params: Array, i: int, volts: float, conductance: float, slow: bool, raised: bool
) -> Train:
    """One servo's drive train; see ``kernel.bridge``, :func:`falling` and :func:`is_raised`."""
    return Train(
        volts,
        conductance,
        params[TORQUE_CONSTANT, i],
        params[BACK_EMF, i],
        params[CURRENT_CAP, i],
        params[TORQUE_DROOP, i],
        params[COULOMB, i],
        params[VISCOUS, i],
        params[LOAD_MOTOR, i],
        params[LOAD_EXTERNAL, i],
        params[STRIBECK, i],
        params[STRIBECK_VELOCITY, i],
        params[STRIBECK_EXPONENT, i],
        params[LOAD_MOTOR_STRIBECK, i],
        params[LOAD_EXTERNAL_STRIBECK, i],
        params[QUADRATIC_MOTOR, i],
        params[QUADRATIC_EXTERNAL, i],
        slow,
        raised,
        params[GEAR_STIFFNESS, i],
        params[GEAR_DAMPING, i],
        0.5 * params[BACKLASH, i],
        params[BREAKAWAY, i],
    )


@inlined
def friction_level(t: Train, velocity: float, motor: float, external: float) -> float:
    """Largest friction torque [N m] at a velocity [rad/s], motor and external torque [N m]."""
    level = t.coulomb + t.viscous * abs(velocity)
    level += abs(t.load_motor * motor - t.load_external * external)
    if t.slow:
        slow = t.stribeck
        slow += abs(t.load_motor_stribeck * motor - t.load_external_stribeck * external)
        back = t.quadratic_motor * motor * motor
        ahead = t.quadratic_external * external * external
        more = ahead if abs(motor) > abs(external) else back
        slow += more if motor * external < 0.0 else 0.0
        ratio = abs(velocity) / t.stribeck_velocity
        if t.raised:
            ratio **= t.stribeck_exponent
        level += decay(ratio) * slow
    return float(level)


@inlined
def friction(t: Train, level: float, bent: float, stop: float, push: float, dt: float) -> float:
    """Friction of a rotor [N m] in a step of ``dt``, of which ``level`` is the largest there is.

    ``stop`` is the torque that would stop the rotor within the step [N m], ``push`` the speed that
    a torque makes in it [rad/(s N m)], ``bent`` how far friction has given way until now [rad].
    Spring and damper are implicit: they are those of the step's end.
    """
    give = push * level * (dt + LETS_GO_S)
    spring = level * bent + t.breakaway * stop
    held = stop - spring / max(t.breakaway + give, LEAST)
    return float(min(level, max(-level, held)))


@inlined
def bend(t: Train, bent: float, moved: float) -> float:
    """How far friction has given way [rad] after a rotor has moved on [rad]."""
    return float(min(t.breakaway, max(-t.breakaway, bent + moved)))


@inlined
def motor_current(t: Train, speed: float) -> float:
    """Current of a motor at a rotor's velocity [A]."""
    current = t.conductance * (t.volts - t.back_emf * speed)
    return float(min(t.current_cap, max(-t.current_cap, current)))


@inlined
def motor_torque(t: Train, current: float) -> float:
    """Torque of a motor at a current, before friction [N m]."""
    torque = t.torque_constant * current
    if t.torque_droop == 0.0:
        return float(torque)
    return float(torque / (1.0 + t.torque_droop * abs(current)))


@inlined
def gear_torque(t: Train, twist: float, twist_rate: float) -> float:
    """Torque of the rotor on the output shaft [N m] at a twist of the gear [rad, rad/s]."""
    torque = t.stiffness * twist + t.damping * twist_rate
    if t.half_backlash > 0.0:  # a flank pushes, and is never pulled at
        play = t.stiffness * t.half_backlash
        torque = max(0.0, torque - play) if twist > 0.0 else min(0.0, torque + play)
        if abs(twist) < t.half_backlash:
            torque = 0.0
    return float(torque)
