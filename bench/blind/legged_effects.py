"""Effects of body, contact, gear and supply as they are hidden in a legged robot."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from busemu.tables import Robot

from .changes import Quantity, Truth
from .drives import Electrics
from .legged import Body, drive_of, said


@dataclass(frozen=True, slots=True)
class Whole:
    """The truth of a legged robot: body and electrics."""

    robot: Robot
    body: Body
    electrics: Electrics

    def body_but(self, **changes: object) -> Whole:
        """The same with its body changed."""
        return dataclasses.replace(self, body=dataclasses.replace(self.body, **changes))  # type: ignore[arg-type]

    def electrics_but(self, **changes: object) -> Whole:
        """The same with its electrics changed."""
        return dataclasses.replace(self, electrics=self.electrics.but(**changes))


@dataclass(frozen=True, slots=True)
class Where:
    """Sign, and the legs that an effect is in."""

    sign: int
    legs: tuple[str, ...]

    def joints(self, *links: str) -> list[str]:
        """Joints of these legs."""
        return [f"{leg}.{link}" for leg in self.legs for link in links]


LINKS = ("coxa", "femur", "tibia")
LOADED = ("femur", "tibia")  #: joints that carry the weight
Apply = Callable[[Whole, float, Where], tuple[Whole, Truth]]


@dataclass(frozen=True, slots=True)
class LeggedEffect:
    """An effect with its sizes; ``scoped``: it may be in one leg alone."""

    name: str
    apply: Apply
    typical: float
    most: float
    least: float = 0.0  #: below it the engine's step would not carry the spring
    scoped: bool = False
    links: tuple[str, ...] = LINKS  #: whose joints it is in, of a leg that has it
    signed: bool = False
    standing: bool = True  #: it can be seen of a leg on a stand
    pins: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()


def _foot_compliance(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    stiffness = 1.0 / p
    tips = {**(w.body.foot_n_m or {}), **dict.fromkeys(at.legs, stiffness)}
    return w.body_but(foot_n_m=tips), {"stiffness_n_m": Quantity(stiffness, "N/m", math.inf)}


def _foot_slip(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    believed = float(said(w.robot.document, "contact", "friction"))
    friction = believed * (1.0 - p)
    return w.body_but(friction=friction), {"friction": Quantity(friction, "", believed)}


def _ground_compliance(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    truth = {"stiffness_n_m": Quantity(1.0 / p, "N/m", math.inf)}
    return w.body_but(ground_n_m=1.0 / p), truth


def _ground_tilt(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    tilt = at.sign * (p + math.radians(1.0))
    truth = {"pitch_rad": Quantity(tilt, "rad", 0.0), "roll_rad": Quantity(0.0, "rad", 0.0)}
    return w.body_but(tilt_x_rad=tilt, tilt_y_rad=0.0), truth


def _payload(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    truth = {"mass_kg": Quantity(p, "kg", 0.0)}
    return w.body_but(payload_kg=w.body.payload_kg + p), truth


def _com(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    off = at.sign * (p + 0.003)
    truth = {"y_m": Quantity(off, "m", 0.0)}
    return w.body_but(com_m=(w.body.com_m[0], off, 0.0)), truth


def _link_mass(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    factor = (1.0 + p + 0.05) ** at.sign  # lighter by the same ratio: never less than nothing
    changed = {**(w.body.link_mass or {}), **dict.fromkeys(at.joints("tibia"), factor)}
    return w.body_but(link_mass=changed), {"factor": Quantity(factor, "", 1.0)}


def _joint_compliance(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    joints = at.joints(*LOADED)
    drive = drive_of(w.robot, w.robot.by_joint[joints[0]].model)
    believed = float(said(drive, "gear_stiffness_nm_rad"))
    stiffness = 1.0 / (1.0 / believed + p)
    soft = {**(w.body.twist_nm_rad or {}), **dict.fromkeys(joints, stiffness)}
    truth = {"stiffness_nm_rad": Quantity(stiffness, "N m/rad", believed)}
    return w.body_but(twist_nm_rad=soft), truth


def _backlash(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    loose = {**(w.body.play_rad or {}), **dict.fromkeys(at.joints(*LOADED), p)}
    return w.body_but(play_rad=loose), {"width_rad": Quantity(p, "rad", 0.0)}


def _supply(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    believed = float(said(w.robot.document, "supply", "voltage_v"))
    volts = believed * (1.0 + at.sign * (p + 0.03))
    return w.electrics_but(supply_v=volts), {"voltage_v": Quantity(volts, "V", believed)}


def _sag(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    believed = float(said(w.robot.document, "supply", "resistance_ohm"))
    truth = {"resistance_ohm": Quantity(believed + p, "ohm", believed)}
    return w.electrics_but(source_ohm=believed + p), truth


def _torque_limit(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    joints = at.joints(*LINKS)
    limits = {**(w.electrics.duty_limit or {}), **dict.fromkeys(joints, 1.0 - p)}
    return w.electrics_but(duty_limit=limits), {"duty_limit": Quantity(1.0 - p, "", 1.0)}


def _gain(w: Whole, p: float, at: Where) -> tuple[Whole, Truth]:
    factor = 1.0 + at.sign * (p + 0.1)
    joints = at.joints(*LINKS)
    gains = {**(w.electrics.gain_factor or {}), **dict.fromkeys(joints, factor)}
    return w.electrics_but(gain_factor=gains), {"factor": Quantity(factor, "", 1.0)}


#: the effects by the catalogue's names
LEGGED: Mapping[str, LeggedEffect] = MappingProxyType(
    {
        effect.name: effect
        for effect in (
            LeggedEffect(
                "foot_compliance",
                _foot_compliance,
                1 / 1500,
                1 / 120,
                least=1 / 8000,
                scoped=True,
                standing=False,
                rivals=("joint_compliance", "ground_compliance", "payload"),
            ),
            LeggedEffect(
                "foot_slip", _foot_slip, 0.4, 0.9, standing=False, rivals=("ground_tilt",)
            ),
            LeggedEffect(
                "ground_compliance",
                _ground_compliance,
                1 / 3000,
                1 / 300,
                least=1 / 20000,
                standing=False,
                rivals=("foot_compliance",),
            ),
            LeggedEffect(
                "ground_tilt",
                _ground_tilt,
                0.03,
                0.25,
                signed=True,
                standing=False,
                pins=("tilt",),
                rivals=("com_offset",),
            ),
            LeggedEffect(
                "payload", _payload, 0.05, 1.0, standing=False, rivals=("foot_compliance",)
            ),
            LeggedEffect(
                "com_offset",
                _com,
                0.01,
                0.04,
                signed=True,
                standing=False,
                pins=("com",),
                rivals=("ground_tilt",),
            ),
            LeggedEffect(
                "link_mass",
                _link_mass,
                0.3,
                2.0,
                scoped=True,
                links=("tibia",),
                signed=True,
                pins=("link_mass",),
                rivals=("payload",),
            ),
            LeggedEffect(
                "joint_compliance",
                _joint_compliance,
                0.2,
                2.0,
                scoped=True,
                links=LOADED,
                rivals=("foot_compliance", "backlash"),
            ),
            LeggedEffect(
                "backlash",
                _backlash,
                0.02,
                0.2,
                scoped=True,
                links=LOADED,
                rivals=("joint_compliance",),
            ),
            LeggedEffect(
                "supply_voltage",
                _supply,
                0.1,
                0.45,
                signed=True,
                pins=("supply",),
                rivals=("voltage_sag", "torque_limit"),
            ),
            LeggedEffect("voltage_sag", _sag, 0.5, 8.0, rivals=("supply_voltage", "torque_limit")),
            LeggedEffect(
                "torque_limit",
                _torque_limit,
                0.6,
                0.97,
                scoped=True,
                rivals=("voltage_sag", "supply_voltage"),
            ),
            LeggedEffect("gain_error", _gain, 0.1, 0.8, signed=True, scoped=True),
        )
    }
)
