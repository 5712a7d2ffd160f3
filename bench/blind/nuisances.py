"""What is a little off in every case, nulls included: none of it is an effect."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from .host import Line
from .instant import TICK_S
from .specimen import Numerics, Specimen

DEGREE = math.radians(1.0)
#: how far what moves a joint may be from what is believed, either way: the operator's tolerances
TOLERANCES: Mapping[str, float] = MappingProxyType(
    {
        "link_mass_factor": 0.05,
        "payload_factor": 0.05,
        "com_x_m": 0.003,
        "com_z_m": 0.003,
        "zero_rad": DEGREE,
        "torque_constant_factor": 0.10,
        "coulomb_factor": 0.30,
        "viscous_factor": 0.30,
        "supply_factor": 0.015,
        "tilt_x_rad": DEGREE,
        "tilt_y_rad": DEGREE,
    }
)
#: of the firmware's control loop [s]; assumed about the 1 ms that is published for AX-12
TICKS_S = (0.5e-3, 1.5e-3)
#: between two measurements of the voltage [s]; assumed: one ADC measures other things as well
VOLTAGE_HOLD_S = (1e-3, 16e-3)
DROOP_1_S = 0.001  #: a battery falls by up to so much of the rated voltage in a second


@dataclass(frozen=True, slots=True)
class Nuisances:
    """Draws that hold for a whole case; every factor is 1 and every shift 0 where nothing is."""

    link_mass_factor: float = 1.0
    payload_factor: float = 1.0
    com_x_m: float = 0.0
    com_z_m: float = 0.0
    zero_rad: float = 0.0
    torque_constant_factor: float = 1.0
    coulomb_factor: float = 1.0
    viscous_factor: float = 1.0
    supply_factor: float = 1.0
    droop_v_s: float = 0.0
    tilt_x_rad: float = 0.0
    tilt_y_rad: float = 0.0
    ambient_c: float = 25.0
    voltage_offset_v: float = 0.0
    hold_phase_s: float = 0.0
    voltage_hold_s: float = 0.0
    tick_s: float = TICK_S
    latency_s: float = 0.1e-3
    jitter: float = 0.0
    hiccup_rate: float = 0.0
    lost_rate: float = 0.0
    clock_ppm: float = 0.0
    substeps: int = 1
    integrator: str = "implicitfast"
    solver: str = "Newton"

    def document(self) -> dict[str, float | int | str]:
        """For the key."""
        return dataclasses.asdict(self)

    def line(self) -> Line:
        """The line and the clock of the case."""
        return Line(
            latency_s=self.latency_s,
            jitter=self.jitter,
            hiccup_rate=self.hiccup_rate,
            lost_rate=self.lost_rate,
            clock_ppm=self.clock_ppm,
        )

    def on(self, specimen: Specimen) -> Specimen:
        """A believed specimen as it is with these."""
        f = self.link_mass_factor
        arm = specimen.arm
        x, y, z = arm.com_m
        a, b, c = arm.inertia_kg_m2
        return specimen.arm_but(
            mass_kg=arm.mass_kg * f,
            com_m=(x + self.com_x_m, y, z + self.com_z_m),
            inertia_kg_m2=(a * f, b * f, c * f),
        ).but(
            payload_kg=specimen.payload_kg * self.payload_factor,
            torque_constant_nm_a=specimen.torque_constant_nm_a * self.torque_constant_factor,
            back_emf_v_s_rad=specimen.back_emf_v_s_rad * self.torque_constant_factor,
            coulomb_nm=specimen.coulomb_nm * self.coulomb_factor,
            viscous_nm_s_rad=specimen.viscous_nm_s_rad * self.viscous_factor,
            supply_v=specimen.supply_v * self.supply_factor,
            droop_v_s=self.droop_v_s,
            tilt_x_rad=self.tilt_x_rad,
            tilt_y_rad=self.tilt_y_rad,
            ambient_c=self.ambient_c,
            tick_s=self.tick_s,
            sensing=dataclasses.replace(
                specimen.sensing,
                zero_rad=specimen.sensing.zero_rad + self.zero_rad,
                voltage_offset_v=self.voltage_offset_v,
                hold_phase_s=self.hold_phase_s,
                voltage_hold_s=self.voltage_hold_s,
            ),
            numerics=Numerics(self.substeps, self.integrator, self.solver),
        )


def draw_nuisances(random: np.random.Generator, rated_voltage_v: float) -> Nuisances:
    """Nuisances within their bounds: uniform, so that no bound is ever passed."""
    none = Nuisances()

    def about(name: str) -> float:
        return float(getattr(none, name)) + TOLERANCES[name] * random.uniform(-1.0, 1.0)

    return Nuisances(
        link_mass_factor=about("link_mass_factor"),
        payload_factor=about("payload_factor"),
        com_x_m=about("com_x_m"),
        com_z_m=about("com_z_m"),
        zero_rad=about("zero_rad"),
        torque_constant_factor=about("torque_constant_factor"),
        coulomb_factor=about("coulomb_factor"),
        viscous_factor=about("viscous_factor"),
        supply_factor=about("supply_factor"),
        droop_v_s=rated_voltage_v * DROOP_1_S * random.uniform(0.0, 1.0),
        tilt_x_rad=about("tilt_x_rad"),
        tilt_y_rad=about("tilt_y_rad"),
        ambient_c=random.uniform(20.0, 28.0),
        voltage_offset_v=0.05 * random.uniform(-1.0, 1.0),
        hold_phase_s=0.13 * random.random(),
        voltage_hold_s=random.uniform(*VOLTAGE_HOLD_S),
        tick_s=random.uniform(*TICKS_S),
        latency_s=random.uniform(0.05e-3, 0.3e-3),
        jitter=random.uniform(0.005, 0.03),
        hiccup_rate=random.uniform(0.0, 0.01),
        lost_rate=random.uniform(0.0, 0.005),
        clock_ppm=random.uniform(-60.0, 60.0),
        substeps=int(random.choice([1, 2, 3])),
        integrator=str(random.choice(["Euler", "implicitfast", "implicit"])),
        solver=str(random.choice(["Newton", "CG", "PGS"])),
    )


def bounds(rated_voltage_v: float) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of every nuisance that moves a joint; all between is as likely.

    Left out are those that change nothing but what other registers show, how finely an engine
    counts, and when goals and samples are taken: a tick of the firmware, and less than 0.2 ms.
    """
    none = Nuisances()
    found = {
        name: (getattr(none, name) - most, getattr(none, name) + most)
        for name, most in TOLERANCES.items()
    }
    return found | {"droop_v_s": (0.0, rated_voltage_v * DROOP_1_S)}


@dataclass(frozen=True, slots=True)
class Passing:
    """What differs from one recording of a case to the next: the spread of repeats."""

    friction_factor: float = 1.0
    start_off_rad: float = 0.0
    supply_factor: float = 1.0
    tick_phase: float = 0.0

    def on(self, specimen: Specimen) -> Specimen:
        """A case's specimen as it is in one recording."""
        return specimen.but(
            coulomb_nm=specimen.coulomb_nm * self.friction_factor,
            supply_v=specimen.supply_v * self.supply_factor,
            tick_phase=self.tick_phase,
        )


def draw_passing(random: np.random.Generator, late: float) -> Passing:
    """``late``: 0 for the first recording of a case, 1 for the last; the battery runs down."""
    return Passing(
        friction_factor=1.0 + 0.03 * random.uniform(-1.0, 1.0),
        start_off_rad=0.02 * random.uniform(-1.0, 1.0),
        supply_factor=1.0 - 0.01 * late,
        tick_phase=random.random(),
    )
