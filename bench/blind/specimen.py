"""A hidden specimen: one servo, its arm and its supply, as they truly are."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from .instant import OPEN, TICK_S, Gate, Part
from .servos import Sheet

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body on the shaft.

    The shaft turns about +y and the arm hangs along -z at angle 0; on an upright rig gravity goes
    along the shaft instead, -y, and all else is the same.
    """

    mass_kg: float
    com_m: Vector
    inertia_kg_m2: Vector  #: about the centre of mass, body axes


@dataclass(frozen=True, slots=True)
class Gear:
    """What lies between the rotor and the output shaft. Nothing: rigid."""

    play_rad: float = 0.0  #: whole width
    play_gate: Gate = OPEN  #: the sector of worn teeth
    stiffness_nm_rad: float = 0.0  #: 0 is rigid
    damping_nm_s_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Build:
    """How a servo is built inside, which no data sheet tells: either way is nothing amiss."""

    sprung: bool = False  #: its gear is the spring of the robot file; else it is rigid
    presliding: bool = False  #: friction at rest gives way elastically; else it holds


SIMPLEST = Build()


@dataclass(frozen=True, slots=True)
class Hung:
    """A second pendulum hung on the arm by a loose pin."""

    mass_kg: float
    length_m: float
    at_m: float  #: pin, down the arm
    damping_nm_s_rad: float


@dataclass(frozen=True, slots=True)
class Sensing:
    """How the registers show the truth."""

    zero_rad: float = 0.0  #: shown angle = true angle - zero
    eccentric_x: float = 0.0  #: magnet off the axis, as a share of its radius
    eccentric_y: float = 0.0
    late_s: float = 0.0  #: age of the position that is sent, beyond none
    hold_s: float = 0.0  #: period at which the duty or load register is renewed
    hold_phase_s: float = 0.0
    outlier_rate: float = 0.0
    noise_steps: float = 0.25  #: standard deviation of the measured angle in counts; assumed
    voltage_offset_v: float = 0.0
    voltage_hold_s: float = 0.0  #: period at which the voltage is measured


@dataclass(frozen=True, slots=True)
class Numerics:
    """How the engine counts: part of reality only in that the model's is another one."""

    substeps: int = 1
    integrator: str = "implicitfast"
    solver: str = "Newton"


@dataclass(frozen=True)
class Specimen:
    """The truth of one joint. The base model is this as it is built, with no ``parts``."""

    sheet: Sheet
    arm: Body
    payload_kg: float
    payload_at_m: float
    supply_v: float
    torque_constant_nm_a: float
    back_emf_v_s_rad: float
    resistance_ohm: float
    armature_kg_m2: float
    coulomb_nm: float
    viscous_nm_s_rad: float
    bristle_nm_rad: float = 0.0  #: stiffness of dry friction below breakaway; 0: the engine's own
    tick_s: float = TICK_S  #: at which the firmware takes goals and angles
    tick_phase: float = 0.0  #: of a tick at 0, as a share
    heaviest_kg: float = 0.0  #: payload that is used on the rig
    upright: bool = False  #: the shaft is vertical: gravity does not turn it
    tilt_x_rad: float = 0.0
    tilt_y_rad: float = 0.0
    goal_late_s: float = 0.0
    gain_factor: float = 1.0
    margin_rad: float = 0.0  #: beyond the register's
    punch: float = 0.0  #: beyond the register's
    duty_limit: float = 1.0
    droop_v_s: float = 0.0  #: fall of the battery's voltage
    ambient_c: float = 25.0
    gear: Gear = Gear()
    hung: Hung | None = None
    sensing: Sensing = Sensing()
    numerics: Numerics = Numerics()
    parts: tuple[Part, ...] = ()

    def but(self, **changes: object) -> Specimen:
        """The same with some things changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def sensing_but(self, **changes: object) -> Specimen:
        """The same with its sensing changed."""
        return self.but(sensing=dataclasses.replace(self.sensing, **changes))  # type: ignore[arg-type]

    def gear_but(self, **changes: object) -> Specimen:
        """The same with its gear changed."""
        return self.but(gear=dataclasses.replace(self.gear, **changes))  # type: ignore[arg-type]

    def arm_but(self, **changes: object) -> Specimen:
        """The same with its arm changed."""
        return self.but(arm=dataclasses.replace(self.arm, **changes))  # type: ignore[arg-type]

    def plus(self, *parts: Part) -> Specimen:
        """The same with more parts."""
        return self.but(parts=(*self.parts, *parts))
