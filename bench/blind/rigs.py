"""One-joint rigs as their operators believe them to be, and what is done with them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from bench.motions import ExperimentPlan, Motion, motion

from .servos import SHEETS, Sheet, gain_registers
from .specimen import SIMPLEST, Body, Build, Gear, Specimen

#: at the output shaft, where dry friction at rest breaks away [rad]; assumed
BREAKAWAY_RAD = 0.3e-3


BRIEF = "brief"  #: a programme that no case draws, for proofs that are quick


@dataclass(frozen=True, slots=True)
class Style:
    """How a program samples: what it reads in a loop, and how long the loop takes."""

    name: str
    period_s: float
    reads: tuple[str, ...]  #: roles, in their order
    access_s: float = 0.9e-3  #: from one instruction packet to the next


#: sampling styles: a fast loop over five registers, position alone, and a slow loop
STYLES: Mapping[str, Style] = MappingProxyType(
    {
        style.name: style
        for style in (
            Style("fast", 1 / 190, ("position", "velocity", "duty", "voltage", "temperature")),
            Style("position", 1 / 250, ("position",)),
            Style("slow", 1 / 28, ("position", "duty", "voltage", "temperature"), 2.0e-3),
        )
    }
)


@dataclass(frozen=True, slots=True)
class Run:
    """A group of recordings: one plan, repeated."""

    group: str
    plan: ExperimentPlan
    repeats: int = 2


@dataclass(frozen=True, slots=True)
class Programme:
    """What an operator records on a rig; ``held_out`` are groups that are not for fitting."""

    name: str
    runs: tuple[Run, ...]
    held_out: tuple[str, ...]


@dataclass(frozen=True)
class Rig:
    """A servo that moves an arm, nominally."""

    name: str
    title: str
    sheet: Sheet
    arm: Body
    payload_at_m: float
    payloads_kg: tuple[float, ...]
    upright: bool = False
    reach_rad: float = 1.2  #: motions stay within
    gains: tuple[int, int] = field(default=(0, 0))

    def specimen(self, payload_kg: float | None = None, build: Build = SIMPLEST) -> Specimen:
        """The rig exactly as it is believed to be, built in one way; else the simplest."""
        sheet = self.sheet
        spring = Gear(
            stiffness_nm_rad=sheet.gear_stiffness_nm_rad,
            damping_nm_s_rad=sheet.gear_damping_nm_s_rad,
        )
        return Specimen(
            sheet=sheet,
            arm=self.arm,
            payload_kg=self.payloads_kg[0] if payload_kg is None else payload_kg,
            payload_at_m=self.payload_at_m,
            supply_v=sheet.rated_voltage_v,
            torque_constant_nm_a=sheet.torque_constant_nm_a,
            back_emf_v_s_rad=sheet.back_emf_v_s_rad,
            resistance_ohm=sheet.resistance_ohm,
            armature_kg_m2=sheet.armature_kg_m2,
            coulomb_nm=sheet.coulomb_nm,
            viscous_nm_s_rad=sheet.viscous_nm_s_rad,
            bristle_nm_rad=sheet.coulomb_nm / BREAKAWAY_RAD if build.presliding else 0.0,
            heaviest_kg=max(self.payloads_kg),
            upright=self.upright,
            gear=spring if build.sprung else Gear(),
        ).sensing_but(hold_s=sheet.load_refresh_s)

    def programmes(self) -> tuple[Programme, ...]:
        """The programmes that are recorded on this rig, of which a case draws one."""
        return _programmes(self)

    def by_name(self) -> Mapping[str, Programme]:
        """Those by their names, and the brief one, which is there for the asking."""
        return {programme.name: programme for programme in (*self.programmes(), _brief(self))}


def rod(mass_kg: float, length_m: float, thick_m: float = 0.01) -> Body:
    """A uniform square rod from the shaft down to ``length_m``."""
    along = mass_kg * (length_m**2 + thick_m**2) / 12.0
    return Body(mass_kg, (0.0, 0.0, -0.5 * length_m), (along, along, mass_kg * thick_m**2 / 6.0))


RIGS: Mapping[str, Rig] = MappingProxyType(
    {
        rig.name: rig
        for rig in (
            Rig(
                "xl330-pendulum",
                "A weight on a rod on one XL330",
                SHEETS["XL330-M288"],
                rod(0.030, 0.12),
                0.11,
                (0.12, 0.20),
                reach_rad=1.4,
                gains=(200, 400),
            ),
            Rig(
                "xl330-rod",
                "A heavy bare rod on one XL330",
                SHEETS["XL330-M288"],
                rod(0.160, 0.20),
                0.18,
                (0.0, 0.06),
                gains=(300, 800),
            ),
            Rig(
                "xl330-turntable",
                "An XL330 with a level arm on a vertical shaft",
                SHEETS["XL330-M288"],
                rod(0.050, 0.15),
                0.14,
                (0.10, 0.20),
                upright=True,
                gains=(200, 400),
            ),
            Rig(
                "ax12-arm",
                "An AX-12A lifts a weight",
                SHEETS["AX-12A"],
                rod(0.100, 0.16),
                0.15,
                (0.25, 0.45),
                gains=(32, 64),
            ),
            Rig(
                "ax12-turntable",
                "An AX-12A with a level arm on a vertical shaft",
                SHEETS["AX-12A"],
                rod(0.120, 0.20),
                0.18,
                (0.15, 0.30),
                upright=True,
                gains=(32, 64),
            ),
            Rig(
                "xl320-tibia",
                "A shank on one XL-320",
                SHEETS["XL-320"],
                rod(0.060, 0.12),
                0.11,
                (0.05, 0.11),
                gains=(16, 32),
            ),
            Rig(
                "mx64-pendulum",
                "A weight on a bar on one MX-64",
                SHEETS["MX-64"],
                rod(0.150, 0.25),
                0.24,
                (0.50, 1.00),
                gains=(8, 16),
            ),
            Rig(
                "mx64-bar",
                "A heavy bare bar on one MX-64",
                SHEETS["MX-64"],
                rod(0.900, 0.35, 0.02),
                0.33,
                (0.0, 0.30),
                gains=(8, 32),
            ),
        )
    }
)


def _programmes(rig: Rig) -> tuple[Programme, ...]:
    soft, stiff = (gain_registers(rig.sheet, raw) for raw in rig.gains)
    light, heavy = rig.payloads_kg
    reach = rig.reach_rad
    # fast motions stay within half of the speed that the servo reaches without load
    fast_hz = min(1.2, 0.5 * rig.sheet.no_load_velocity_rad_s / (2.0 * math.pi * 0.5 * reach))
    sin_sin = motion("sin_sin", amplitude_rad=reach)
    ramp = motion("slow_ramp", amplitude_rad=reach, duration_s=6.0)
    dither = motion("dither", amplitude_rad=0.9 * reach)
    lift = motion("lift_and_drop", amplitude_rad=-reach, lift_s=1.5, duration_s=4.0)
    chirp = motion("chirp", amplitude_rad=0.4 * reach, to_hz=2.0 * fast_hz, duration_s=6.0)
    steps = motion("steps", amplitude_rad=0.8 * reach, duration_s=6.0)
    sine = motion("sine_fast", amplitude_rad=0.5 * reach, hz=fast_hz, duration_s=5.0)
    hold = motion("hold", amplitude_rad=reach, duration_s=6.0)
    held = motion(
        "sin_sin", amplitude_rad=0.8 * reach, center_rad=0.15 * reach, base_hz=0.22, duration_s=6.0
    )

    def plan(group: str, what: Motion, gain: Mapping[str, int], kg: float) -> Run:
        return Run(group, ExperimentPlan(what, gain, kg))

    test = plan("sin-sin-held-out", held, stiff, heavy)
    return (
        Programme(
            "gains",
            (
                plan("sin-sin-soft", sin_sin, soft, light),
                plan("sin-sin-stiff", sin_sin, stiff, light),
                plan("steps-heavy", steps, soft, heavy),
                plan("lift-and-drop", lift, stiff, heavy),
                test,
            ),
            (test.group,),
        ),
        Programme(
            "slow",
            (
                plan("ramp-soft", ramp, soft, light),
                plan("dither-stiff", dither, stiff, heavy),
                plan("hold-heavy", hold, soft, heavy),
                plan("sin-sin-stiff", sin_sin, stiff, light),
                test,
            ),
            (test.group,),
        ),
        Programme(
            "fast",
            (
                plan("chirp-stiff", chirp, stiff, light),
                plan("steps-soft", steps, soft, light),
                plan("sine-heavy", sine, stiff, heavy),
                plan("dither-soft", dither, soft, light),
                test,
            ),
            (test.group,),
        ),
    )


def _brief(rig: Rig) -> Programme:
    """Three motions of three seconds: enough for an effect that nobody could miss."""
    soft, stiff = (gain_registers(rig.sheet, raw) for raw in rig.gains)
    light, heavy = rig.payloads_kg
    amplitude_rad, duration_s = 0.8 * rig.reach_rad, 3.0
    waves = [
        motion("sin_sin", amplitude_rad=amplitude_rad, base_hz=hz, duration_s=duration_s)
        for hz in (0.35, 0.45)
    ]
    steps = motion("steps", amplitude_rad=amplitude_rad, duration_s=duration_s)
    return Programme(
        BRIEF,
        (
            Run("sin-sin-brief", ExperimentPlan(waves[0], stiff, light)),
            Run("steps-brief", ExperimentPlan(steps, soft, heavy)),
            Run("sin-sin-held-out", ExperimentPlan(waves[1], stiff, heavy)),
        ),
        ("sin-sin-held-out",),
    )
