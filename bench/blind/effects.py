"""The catalogue's drive, sensing and load effects, as they are hidden on a one-joint rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from . import changes
from .changes import Setting, Truth
from .instant import GateKind
from .specimen import Specimen

Apply = Callable[[Specimen, float, Setting], tuple[Specimen, Truth]]

POSITION, DUTY = "present_position", "duty"


@dataclass(frozen=True, slots=True)
class Effect:
    """An effect that can be hidden: sizes, and what it does to a specimen."""

    name: str
    apply: Apply
    typical: float  #: a size to start from
    most: float  #: no size beyond it is plausible
    channel: str = POSITION  #: where its trace is measured
    signed: bool = False
    allowance: float = 0.0  #: bound of the nuisance of the same kind (its own unit); 0: none is
    gates: tuple[GateKind, ...] = ()  #: how it can be rare
    pins: tuple[str, ...] = ()  #: nuisances of the same kind, which it takes the place of
    rivals: tuple[str, ...] = ()  #: what may give nearly the same trace


_TIME = (GateKind.TIME,)

#: the effects by the catalogue's names
EFFECTS: Mapping[str, Effect] = MappingProxyType(
    {
        effect.name: effect
        for effect in (
            Effect(
                "backlash",
                changes.backlash,
                0.01,
                0.10,
                gates=(GateKind.ANGLE,),
                rivals=("dead_zone", "joint_compliance"),
            ),
            Effect(
                "joint_compliance",
                changes.joint_compliance,
                0.05,
                1.0,
                rivals=("backlash", "dead_zone"),
            ),
            Effect(
                "rotor_inertia",
                changes.rotor_inertia,
                1e-3,
                0.05,
                rivals=("transport_delay", "link_mass"),
            ),
            Effect(
                "viscous_friction",
                changes.viscous,
                5e-3,
                0.5,
                pins=("viscous_factor",),
                allowance=0.3,
                gates=_TIME,
                rivals=("supply_voltage", "transport_delay"),
            ),
            Effect(
                "coulomb_friction",
                changes.coulomb,
                0.02,
                1.0,
                pins=("coulomb_factor",),
                allowance=0.3,
                gates=_TIME,
                rivals=("dead_zone", "load_friction"),
            ),
            Effect(
                "stribeck_friction",
                changes.stribeck,
                0.02,
                1.0,
                gates=_TIME,
                rivals=("coulomb_friction", "dead_zone"),
            ),
            Effect(
                "load_friction",
                changes.load_friction,
                0.05,
                0.8,
                rivals=("coulomb_friction", "directional_load_friction"),
            ),
            Effect(
                "directional_load_friction",
                changes.directional,
                0.1,
                0.9,
                rivals=("load_friction", "coulomb_friction"),
            ),
            Effect(
                "cable_drag",
                changes.cable,
                0.02,
                1.0,
                signed=True,
                rivals=("link_mass", "com_offset"),
            ),
            Effect(
                "dead_zone",
                changes.dead_zone,
                0.01,
                0.15,
                rivals=("backlash", "coulomb_friction", "punch"),
            ),
            Effect("punch", changes.punch, 0.02, 0.3, rivals=("dead_zone", "coulomb_friction")),
            Effect(
                "gain_error",
                changes.gain,
                0.1,
                0.8,
                signed=True,
                allowance=0.1,
                rivals=("supply_voltage", "link_mass"),
            ),
            Effect("integral_action", changes.integral, 0.5, 60.0, rivals=("gain_error",)),
            Effect(
                "velocity_limit",
                changes.velocity_limit,
                0.4,
                8.0,
                rivals=("transport_delay", "supply_voltage"),
            ),
            Effect(
                "torque_limit",
                changes.torque_limit,
                0.5,
                0.97,
                gates=_TIME,
                rivals=("voltage_sag", "supply_voltage"),
            ),
            Effect(
                "transport_delay", changes.delay, 0.01, 0.15, rivals=("read_skew", "velocity_limit")
            ),
            Effect(
                "supply_voltage",
                changes.supply,
                0.1,
                0.5,
                signed=True,
                pins=("supply_factor",),
                allowance=0.03,
                rivals=("gain_error", "velocity_limit"),
            ),
            Effect(
                "voltage_sag",
                changes.sag,
                0.5,
                20.0,
                gates=_TIME,
                rivals=("torque_limit", "supply_voltage", "thermal_derating"),
            ),
            Effect(
                "thermal_derating",
                changes.thermal,
                40.0,
                400.0,
                rivals=("voltage_sag", "torque_limit", "supply_voltage"),
            ),
            Effect("overload_shutdown", changes.overload, 0.5, 0.97, rivals=("torque_limit",)),
            Effect(
                "zero_offset",
                changes.zero,
                0.05,
                0.5,
                signed=True,
                pins=("zero_rad",),
                allowance=math.radians(1.0),
                rivals=("com_offset", "cable_drag"),
            ),
            Effect(
                "encoder_nonlinearity",
                changes.encoder,
                0.02,
                0.3,
                rivals=("cable_drag", "zero_offset"),
            ),
            Effect("read_skew", changes.read_skew, 0.01, 0.15, rivals=("transport_delay",)),
            Effect("load_refresh", changes.load_refresh, 0.1, 2.0, channel=DUTY),
            Effect("lost_samples", changes.lost, 0.01, 0.2),
            Effect(
                "link_mass",
                changes.link_mass,
                0.2,
                0.9,
                signed=True,
                pins=("link_mass_factor",),
                allowance=0.05,
                rivals=("payload", "com_offset", "gain_error"),
            ),
            Effect(
                "payload",
                changes.payload,
                0.02,
                0.5,
                pins=("payload_factor",),
                allowance=0.05,
                rivals=("link_mass",),
            ),
            Effect(
                "com_offset",
                changes.com,
                0.01,
                0.08,
                signed=True,
                pins=("com_x_m",),
                allowance=0.003,
                rivals=("zero_offset", "cable_drag"),
            ),
        )
    }
)
