"""The strangers as effects with sizes: as :mod:`bench.blind.effects`, but in no catalogue."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from . import strangers
from .changes import Quantity, Setting, Truth
from .effects import Effect
from .specimen import Hung, Specimen


def _cogging(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    teeth = 8 + 2 * round(8 * how.choice)
    truth = {"torque_nm": Quantity(p, "N m", 0.0), "teeth": Quantity(teeth, "", math.nan)}
    return s.plus(strangers.Cogging(p, teeth, 2.0 * how.choice)), truth


def _hung(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    if p == 0.0:
        return s, {"mass_kg": Quantity(0.0, "kg", 0.0)}
    length = 0.04 + 0.04 * how.choice
    at = 0.9 * max(s.payload_at_m, 1.5 * abs(s.arm.com_m[2]))
    hung = Hung(p, length, at, 0.04 * p * length**2 * 12.0)
    truth = {"mass_kg": Quantity(p, "kg", 0.0), "length_m": Quantity(length, "m", math.nan)}
    return s.but(hung=hung), truth


def _detent(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    at = how.sign * (0.15 + 0.4 * how.choice)
    truth = {"torque_nm": Quantity(p, "N m", 0.0), "at_rad": Quantity(at, "rad", math.nan)}
    return s.plus(strangers.Detent(p, at, 0.12)), truth


def _bumper(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    start = 0.2 + 0.3 * how.choice
    truth = {
        "stiffness_nm_rad": Quantity(p, "N m/rad", 0.0),
        "from_rad": Quantity(start, "rad", math.nan),
    }
    return s.plus(strangers.Bumper(p, start)), truth


def _dry_spot(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    at = how.sign * (0.1 + 0.5 * how.choice)
    truth = {"torque_nm": Quantity(p, "N m", 0.0), "at_rad": Quantity(at, "rad", math.nan)}
    return s.plus(strangers.DrySpot(p, at, 0.12)), truth


def _switching(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    period = 0.9 + 0.8 * how.choice
    truth = {"depth": Quantity(p, "", 0.0), "period_s": Quantity(period, "s", math.nan)}
    return s.plus(strangers.GainSwitching(p, period)), truth


def _ripple(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    per_rad = 3.0 + 4.0 * how.choice
    return s.plus(strangers.Ripple(p, per_rad, 1.0)), {"share": Quantity(p, "", 0.0)}


def _sleep(s: Specimen, p: float, how: Setting) -> tuple[Specimen, Truth]:
    every = 0.37 + 0.3 * how.choice
    truth = {"asleep_s": Quantity(p, "s", 0.0), "every_s": Quantity(every, "s", math.nan)}
    return s.plus(strangers.Sleep(p, every)), truth


#: effects that no catalogue has
STRANGERS: Mapping[str, Effect] = MappingProxyType(
    {
        stranger.name: stranger
        for stranger in (
            Effect("cogging", _cogging, 0.02, 2.0),
            Effect("hung_pendulum", _hung, 0.02, 0.4),
            Effect("magnetic_detent", _detent, 0.03, 2.0, signed=True),
            Effect("one_sided_spring", _bumper, 0.05, 5.0),
            Effect("dry_spot", _dry_spot, 0.05, 3.0, signed=True),
            Effect("gain_switching", _switching, 0.1, 0.9),
            Effect("supply_ripple", _ripple, 0.1, 0.6),
            Effect("firmware_sleep", _sleep, 0.05, 0.3),
        )
    }
)
