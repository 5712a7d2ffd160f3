"""Physics beyond the base model, as parts of a rollout (catalogue effects).

Written from the published models: LuGre-like lubrication lag for Stribeck (Armstrong-Helouvry,
Dupont, Canudas de Wit, *Automatica* 30, 1994), load-dependent and directional gear friction
(Duclusaud et al., arXiv:2410.08650), copper's 0.39 %/K, a capacitor behind a source resistance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from .instant import Act, Instant, Stage

COPPER_PER_K = 0.0039
#: capacitor on a servo's rail; assumed
RAIL_F = 1000e-6
#: lag of the lubricant film behind the speed; published 3 to 50 ms
FILM_S = 0.005
#: heat in the winding of a servo that worked hard: half duty at standstill
HARD_DUTY = 0.5


@dataclass(frozen=True, slots=True)
class Coulomb:
    """More dry friction."""

    torque_nm: float
    stage: ClassVar[Stage] = Stage.FRICTION

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            now.friction_nm += self.torque_nm

        return act


@dataclass(frozen=True, slots=True)
class Viscous:
    """More viscous friction, at the rotor."""

    coefficient_nm_s_rad: float
    stage: ClassVar[Stage] = Stage.LOAD

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            now.load_nm -= self.coefficient_nm_s_rad * now.motor_velocity_rad_s

        return act


@dataclass(frozen=True, slots=True)
class Stribeck:
    """A film of grease that carries once it moves: friction falls with the speed, with a lag."""

    torque_nm: float  #: at standstill, above the Coulomb level
    velocity_rad_s: float
    stage: ClassVar[Stage] = Stage.FRICTION

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        film = 0.0

        def act(now: Instant) -> None:
            nonlocal film
            share = 1.0 - math.exp(-now.tick_s / FILM_S)
            film += share * (abs(now.motor_velocity_rad_s) / self.velocity_rad_s - film)
            now.friction_nm += self.torque_nm * math.exp(-film * film)

        return act


@dataclass(frozen=True, slots=True)
class LoadFriction:
    """Teeth pressed together rub more: friction grows with the torque that is transmitted."""

    coefficient: float
    stage: ClassVar[Stage] = Stage.FRICTION

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            pressed = abs(now.motor_torque_nm - now.external_torque_nm)
            now.friction_nm += self.coefficient * pressed

        return act


@dataclass(frozen=True, slots=True)
class DirectionalFriction:
    """A gear that drives better than it can be driven back, or the other way round."""

    motor_coefficient: float
    external_coefficient: float
    stage: ClassVar[Stage] = Stage.FRICTION

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            motor = self.motor_coefficient * now.motor_torque_nm
            now.friction_nm += abs(motor - self.external_coefficient * now.external_torque_nm)

        return act


@dataclass(frozen=True, slots=True)
class Cable:
    """A cable that pulls to where it was laid."""

    stiffness_nm_rad: float
    rest_rad: float
    stage: ClassVar[Stage] = Stage.LOAD

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            now.load_nm -= self.stiffness_nm_rad * (now.position_rad - self.rest_rad)

        return act


@dataclass(frozen=True, slots=True)
class Integral:
    """An integrator in the firmware, held where the duty is at its limit."""

    gain_per_rad_s: float
    stage: ClassVar[Stage] = Stage.DUTY

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        summed = 0.0

        def act(now: Instant) -> None:
            nonlocal summed
            summed += self.gain_per_rad_s * now.error_rad * now.tick_s
            summed = min(max(summed, -1.0), 1.0)
            now.duty += summed

        return act


@dataclass(frozen=True, slots=True)
class SpeedLimit:
    """A profile generator between the goal register and the law."""

    limit_rad_s: float
    stage: ClassVar[Stage] = Stage.GOAL

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        at: float | None = None

        def act(now: Instant) -> None:
            nonlocal at
            goal, step = now.goal_rad, self.limit_rad_s * now.tick_s
            at = goal if at is None else at + min(max(goal - at, -step), step)
            now.goal_rad = at

        return act


@dataclass(frozen=True, slots=True)
class DutyLimit:
    """The firmware's torque limit, lower than the register says."""

    duty_limit: float
    stage: ClassVar[Stage] = Stage.LIMIT

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""

        def act(now: Instant) -> None:
            now.duty = min(max(now.duty, -self.duty_limit), self.duty_limit)

        return act


@dataclass(frozen=True, slots=True)
class Sag:
    """A supply with a source resistance, and the capacitor on the servo's rail."""

    resistance_ohm: float
    back_emf_v_s_rad: float
    stage: ClassVar[Stage] = Stage.SUPPLY

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        rail: float | None = None

        def act(now: Instant) -> None:
            nonlocal rail
            source_v, share = now.rail_v, now.tick_s / RAIL_F
            if rail is None:
                rail = source_v
            # implicit Euler of C dV/dt = (V0 - V)/Rs - d I,  I = (d V - ke w)/R
            duty, r = now.duty, now.resistance_ohm
            emf_v = self.back_emf_v_s_rad * now.motor_velocity_rad_s
            fed = source_v / self.resistance_ohm + duty * emf_v / r
            rail = (rail + share * fed) / (
                1.0 + share * (1.0 / self.resistance_ohm + duty * duty / r)
            )
            now.rail_v = rail
            now.current_a = (duty * rail - emf_v) / r

        return act


@dataclass(frozen=True, slots=True)
class Heat:
    """A winding that warms up against its case: its resistance rises."""

    heat_resistance_k_w: float
    time_constant_s: float
    rated_voltage_v: float
    stage: ClassVar[Stage] = Stage.SUPPLY

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        rise: float | None = None

        def act(now: Instant) -> None:
            nonlocal rise
            share = 1.0 - math.exp(-now.tick_s / self.time_constant_s)
            if rise is None:
                watts = (HARD_DUTY * self.rated_voltage_v) ** 2 / now.resistance_ohm
                reached = 1.0 - math.exp(-warm_s / self.time_constant_s)
                rise = self.heat_resistance_k_w * watts * reached
            hotter = 1.0 + COPPER_PER_K * rise
            now.resistance_ohm *= hotter
            now.current_a /= hotter
            watts = now.resistance_ohm * now.current_a**2
            rise += share * (self.heat_resistance_k_w * watts - rise)

        return act


@dataclass(frozen=True, slots=True)
class Overload:
    """A firmware that lets go when the duty was too high for too long."""

    duty: float
    overload_s: float
    stage: ClassVar[Stage] = Stage.LIMIT

    def start(self, warm_s: float) -> Act:
        """See :class:`~bench.blind.instant.Part`."""
        since_s = 0.0
        tripped = False

        def act(now: Instant) -> None:
            nonlocal since_s, tripped
            if now.t_s < 0.0:
                return
            since_s = since_s + now.tick_s if abs(now.duty) >= self.duty else 0.0
            tripped = tripped or since_s >= self.overload_s
            if tripped:
                now.duty_limit = 0.0

        return act
