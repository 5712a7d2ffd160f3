"""One instant of a hidden servo, and the parts that act on it.

A rollout goes through the stages below once a firmware tick. What is not in the base model is a
*part*: it has a stage, and changes the instant. Everything at the output shaft, in SI.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

#: the firmware's control period [s]: control interrupt of 1 ms, as published for AX-12; that of a
#: rig may be another one
TICK_S = 1e-3


class Stage(enum.Enum):
    """When in a tick a part acts."""

    GOAL = "goal"  #: after the goal was taken from the register
    DUTY = "duty"  #: after the law, before the clip to the duty limit
    LIMIT = "limit"  #: after the clip
    SUPPLY = "supply"  #: after the supply's voltage, before the motor
    FRICTION = "friction"  #: after the base friction level
    LOAD = "load"  #: torques on the output shaft


class Instant:
    """What a part may read and change; see the stages."""

    __slots__ = (
        "current_a",
        "duty",
        "duty_limit",
        "error_rad",
        "external_torque_nm",
        "friction_nm",
        "gain_per_rad",
        "goal_rad",
        "load_nm",
        "motor_torque_nm",
        "motor_velocity_rad_s",
        "position_rad",
        "rail_v",
        "resistance_ohm",
        "sensed_rad",
        "skip_control",
        "t_s",
        "tick_s",
        "velocity_rad_s",
    )

    t_s: float
    tick_s: float  #: the firmware's period
    position_rad: float  #: output shaft
    velocity_rad_s: float
    motor_velocity_rad_s: float  #: rotor, referred to the output
    goal_rad: float
    sensed_rad: float
    error_rad: float
    gain_per_rad: float
    duty: float
    duty_limit: float
    rail_v: float
    resistance_ohm: float
    current_a: float
    friction_nm: float
    load_nm: float
    motor_torque_nm: float
    external_torque_nm: float
    skip_control: bool

    def __init__(self) -> None:
        for name in self.__slots__:
            setattr(self, name, 0.0)
        self.skip_control = False
        self.tick_s = TICK_S


Act = Callable[[Instant], None]


class Part(Protocol):
    """Physics beyond the base model; made anew for every rollout."""

    @property
    def stage(self) -> Stage:
        """When it acts."""

    def start(self, warm_s: float) -> Act:
        """A fresh one, after the servo worked hard for ``warm_s`` [s]."""


class GateKind(enum.Enum):
    """What a gate looks at."""

    ALWAYS = "always"
    TIME = "time"  #: seconds of the recording
    ANGLE = "angle"  #: rad of the output shaft


@dataclass(frozen=True, slots=True)
class Gate:
    """Where an effect is there: from ``low`` to ``high`` (s or rad)."""

    kind: GateKind = GateKind.ALWAYS
    low: float = 0.0
    high: float = 0.0

    def open(self, now: Instant) -> bool:
        """Whether the effect is there now."""
        if self.kind is GateKind.ALWAYS:
            return True
        where = now.t_s if self.kind is GateKind.TIME else now.position_rad
        return self.low <= where < self.high


OPEN = Gate()


@dataclass(frozen=True, slots=True)
class Gated:
    """A part that acts only where its gate is open."""

    part: Part
    gate: Gate

    @property
    def stage(self) -> Stage:
        """That of the part."""
        return self.part.stage

    def start(self, warm_s: float) -> Act:
        """A fresh one."""
        act, gate = self.part.start(warm_s), self.gate

        def gated(now: Instant) -> None:
            if gate.open(now):
                act(now)

        return gated
