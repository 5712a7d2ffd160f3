"""Named test motions of one joint, and plans of experiments on rigs and robots.

A motion is the goal of one joint over time. All angles are in rad at the joint, times in s from the
start of the recording. Nothing here reads, writes or draws anything.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion(ABC):
    """A goal over time: ``center_rad`` and what is added to it, at most ``amplitude_rad``."""

    name: ClassVar[str] = ""
    description: ClassVar[str] = ""

    amplitude_rad: float = 1.0
    center_rad: float = 0.0
    duration_s: float = 6.0

    def goal_rad(self, t_s: ArrayLike) -> Floats:
        """Goal [rad] at times [s] of any shape; before 0 and after the end it stands still."""
        t = np.clip(np.asarray(t_s, dtype=np.float64), 0.0, self.duration_s)
        return self.center_rad + self.amplitude_rad * self.shape(t)

    @abstractmethod
    def shape(self, t_s: Floats) -> Floats:
        """The motion from -1 to 1, at times [s] within the duration."""

    @property
    def torque_off_s(self) -> float | None:
        """When the torque is switched off [s], if it is."""
        return None


@dataclass(frozen=True, slots=True)
class SinSin(Motion):
    """Two tones of unlike amplitude, the second swelling."""

    name: ClassVar[str] = "sin_sin"
    description: ClassVar[str] = "a slow sine with a faster one that swells on it; many speeds"

    base_hz: float = 0.16

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        w = 2.0 * math.pi * self.base_hz
        return (np.sin(w * t_s) + 0.32 * np.sin(5.0 * w * t_s) * np.sin(2.0 * w * t_s)) / 1.14


@dataclass(frozen=True, slots=True)
class Chirp(Motion):
    """A sine whose frequency rises linearly."""

    name: ClassVar[str] = "chirp"
    description: ClassVar[str] = "a sine that gets faster: inertia, delay, speed limits, resonance"

    from_hz: float = 0.2
    to_hz: float = 2.0

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        rate = (self.to_hz - self.from_hz) / max(self.duration_s, 1e-9)
        return np.sin(2.0 * math.pi * (self.from_hz * t_s + 0.5 * rate * t_s**2))


@dataclass(frozen=True, slots=True)
class SlowRamp(Motion):
    """From one end to the other and back at one slow speed."""

    name: ClassVar[str] = "slow_ramp"
    description: ClassVar[str] = "up and down at one low speed: gravity, friction, both directions"

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        half = 0.5 * self.duration_s
        return 1.0 - 2.0 * np.abs(t_s - half) / half


@dataclass(frozen=True, slots=True)
class Steps(Motion):
    """Steps of different heights, up and down."""

    name: ClassVar[str] = "steps"
    description: ClassVar[str] = "steps of several heights: overshoot, torque and speed limits"

    levels: tuple[float, ...] = (0.0, 0.3, -0.3, 1.0, 0.0, -1.0, -0.6, 0.0)

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        each_s = self.duration_s / len(self.levels)
        index = np.minimum((t_s / each_s).astype(np.int64), len(self.levels) - 1)
        levels: Floats = np.asarray(self.levels, dtype=np.float64)
        return levels[index]


@dataclass(frozen=True, slots=True)
class Hold(Motion):
    """A smooth way to one place, and staying there."""

    name: ClassVar[str] = "hold"
    description: ClassVar[str] = "to one place and stay: static load, creep, heat, overload"

    move_s: float = 1.0

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        return _smooth(t_s / self.move_s)


@dataclass(frozen=True, slots=True)
class Dither(Motion):
    """A small triangle around several places: many reversals under different loads."""

    name: ClassVar[str] = "dither"
    description: ClassVar[str] = "small triangle around several places: play, margin, stiction"

    places: tuple[float, ...] = (-0.9, 0.0, 0.9)
    triangle: float = 0.1  #: height of the triangle as a share of the amplitude
    triangle_hz: float = 1.0

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        each_s = self.duration_s / len(self.places)
        index = np.minimum((t_s / each_s).astype(np.int64), len(self.places) - 1)
        places = np.asarray((self.places[0], *self.places), dtype=np.float64)
        way = _smooth((t_s - index * each_s) / (0.25 * each_s))
        middle: Floats = places[index] + (places[index + 1] - places[index]) * way
        tooth: Floats = 2.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * self.triangle_hz * t_s))
        return (1.0 - self.triangle) * middle + self.triangle * tooth


@dataclass(frozen=True, slots=True)
class LiftAndDrop(Motion):
    """Lifted smoothly, then the torque goes off and it falls."""

    name: ClassVar[str] = "lift_and_drop"
    description: ClassVar[str] = "lifted, then torque off: friction and inertia without the drive"

    lift_s: float = 2.0

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        return _smooth(t_s / self.lift_s)

    @property
    def torque_off_s(self) -> float | None:
        """When the torque is switched off [s]."""
        return self.lift_s


@dataclass(frozen=True, slots=True)
class SineFast(Motion):
    """One fast sine."""

    name: ClassVar[str] = "sine_fast"
    description: ClassVar[str] = "one fast sine: back-EMF, supply, inertia, delay"

    hz: float = 1.2

    def shape(self, t_s: Floats) -> Floats:
        """See :meth:`Motion.shape`."""
        return np.sin(2.0 * math.pi * self.hz * t_s)


#: every motion by its name
MOTIONS: Mapping[str, type[Motion]] = MappingProxyType(
    {
        kind.name: kind
        for kind in (SinSin, Chirp, SlowRamp, Steps, Hold, Dither, LiftAndDrop, SineFast)
    }
)


def motion(name: str, **arguments: Any) -> Motion:
    """Make a motion by its name.

    Raises ``ValueError`` for an unknown name or argument, with those there are.
    """
    kind = MOTIONS.get(name)
    if kind is None:
        raise ValueError(f"no motion named {name!r}: use one of {', '.join(MOTIONS)}")
    known = [f.name for f in dataclasses.fields(kind)]
    if unknown := sorted(set(arguments) - set(known)):
        raise ValueError(f"{name} has no {', '.join(unknown)}: it has {', '.join(known)}")
    listed: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v for k, v in arguments.items()
    }
    return kind(**listed)


@dataclass(frozen=True, slots=True)
class ExperimentPlan:
    """One experiment on one joint: what is commanded, and what the operator sets before.

    ``joint`` names the joint that moves where a rig has several; the others stay. ``registers``:
    raw values written before the start (gains); those not named stay as the robot's file has them.
    ``payload_kg`` ``None`` leaves the weight that is on the rig. ``warm_start_s``: for how long the
    servo worked hard just before.
    """

    motion: Motion
    registers: Mapping[str, int] = field(default_factory=dict)
    payload_kg: float | None = None
    payload_at_m: float | None = None
    warm_start_s: float = 0.0
    joint: str = ""

    def document(self) -> dict[str, Any]:
        """The plan as a document of plain values; :meth:`of` reads it."""
        arguments = {
            f.name: list(value) if isinstance(value, tuple) else value
            for f in dataclasses.fields(self.motion)
            for value in (getattr(self.motion, f.name),)
        }
        document: dict[str, Any] = {"motion": self.motion.name, "arguments": arguments}
        document["registers"] = dict(self.registers)
        for key in ("payload_kg", "payload_at_m"):
            if getattr(self, key) is not None:
                document[key] = getattr(self, key)
        document["warm_start_s"] = self.warm_start_s
        if self.joint:
            document["joint"] = self.joint
        return document

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> ExperimentPlan:
        """The plan in a document. Raises ``ValueError`` for an unknown motion or key."""
        known = {"motion", "arguments", *(f.name for f in dataclasses.fields(cls))}
        if unknown := sorted(set(document) - known):
            raise ValueError(f"a plan has no {', '.join(unknown)}: it has {', '.join(known)}")
        if "motion" not in document:
            raise ValueError(f"a plan needs its motion: one of {', '.join(MOTIONS)}")
        rest = {k: v for k, v in document.items() if k not in ("motion", "arguments")}
        return cls(motion(document["motion"], **document.get("arguments", {})), **rest)


@dataclass(frozen=True, slots=True)
class WalkPlan:
    """One walk of a whole robot: how it is steered, and the weight on its trunk."""

    seconds: float = 5.0
    v_left: float = 1.0
    v_right: float = 1.0
    payload_kg: float = 0.0
    seed: int = 0  #: of the pattern generator's first state

    def document(self) -> dict[str, Any]:
        """The plan as a document of plain values."""
        return dataclasses.asdict(self)


@dataclass(frozen=True, slots=True)
class StandPlan:
    """What a whole robot does on its feet, which stay where they are, and the weight on its trunk.

    ``programme``: one of :data:`STANDING`.
    """

    programme: str
    payload_kg: float = 0.0

    def document(self) -> dict[str, Any]:
        """The plan as a document of plain values."""
        return dataclasses.asdict(self)


#: what a standing robot can do: sink and rise on all feet, go to and fro and sideways on all feet,
#: or stand on three of them and stretch the middle leg of those
STANDING = ("squat", "sway", "stretch")


def _smooth(share: Floats) -> Floats:
    """0 to 1 by a cubic with level ends, held outside."""
    x = np.clip(share, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
