"""A servo bus as a test sees it: a port for the code under test, and the truth for its assertions.

There are two kinds with one face. :class:`VirtualServoBus` is in process and in virtual time, for
code on dynamixel_sdk. :class:`bench.testing.served.PtyServoBus` is a pseudo-terminal in wall-clock
time, for any program that opens a serial device.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from busemu.assemble import assemble
from busemu.chance import seeded
from busemu.clock import VirtualClock
from busemu.faults import Faults
from busemu.plant import Plant, ServoState
from busemu.ports.port import plug_of
from busemu.ports.sdk import SdkPort
from busemu.tables import Robot, ServoMount
from busemu.timing import Profile
from busemu.trace import BusCounts

from .faulting import BusFaults
from .truth import Truth


class ServoBusError(RuntimeError):
    """A servo bus that cannot be made, or cannot do what a test asks of it: says what to do."""


class ServoBus(ABC):
    """A bus of emulated servos.

    ``robot`` is what is on it. Nothing that is asked here goes over the wire or takes bus time.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    @property
    @abstractmethod
    def port(self) -> Any:
        """A port for the packet handlers of dynamixel_sdk, open at the bus's baud rate."""

    @property
    @abstractmethod
    def path(self) -> str:
        """The serial device; :class:`ServoBusError` where there is none (virtual time)."""

    @abstractmethod
    def now_s(self) -> float:
        """The instant on the bus's clock [s]."""

    @abstractmethod
    def run(self, seconds: float) -> None:
        """Let time pass [s] with nothing sent: joints move on. Stands in for ``time.sleep``."""

    @abstractmethod
    def close(self) -> None:
        """Take the bus away. May be called twice."""

    @abstractmethod
    def ask(self, question: str, **about: Any) -> Mapping[str, Any]:
        """Ask :class:`bench.testing.truth.Truth` one of its questions."""

    def servo(self, servo_id: int) -> ServoView:
        """The servo that has this ID in the robot's file; ``KeyError`` if there is none."""
        if servo_id not in self.robot.by_id:
            known = ", ".join(map(str, self.robot.by_id))
            raise KeyError(f"{self.robot.name} has no servo {servo_id}; its IDs are {known}")
        return ServoView(self, self.robot.by_id[servo_id])

    def position_rad(self, joint: str) -> float:
        """Where a joint really is [rad], in the joint's own frame; ``KeyError`` if unknown."""
        if joint not in self.robot.by_joint:
            known = ", ".join(self.robot.by_joint)
            raise KeyError(f"{self.robot.name} has no joint {joint!r}; its joints are {known}")
        mount = self.robot.by_joint[joint]
        return mount.to_joint(self.servo(mount.servo_id).state.position_rad)

    def observe(self) -> dict[str, float]:
        """What an observer beside the robot sees (``mocap/base_x_m``): plant ``bullet`` only."""
        return dict(self.ask("observe"))

    @property
    def faults(self) -> BusFaults:
        """What shall go wrong on this bus: ``bus.faults.drop(servo=3, count=2)``."""
        return BusFaults(lambda **asked: self.ask("fault", **asked))

    @property
    def counts(self) -> BusCounts:
        """Transactions, replies, errors and bytes of noise so far."""
        return BusCounts(**self.ask("counts"))


@dataclass(frozen=True, slots=True)
class ServoView:
    """One servo of a bus: its registers, and what its shaft really does."""

    bus: ServoBus
    mount: ServoMount

    def register(self, name: str) -> int:
        """A register as a read would bring it now: its decoded (signed) count.

        ``KeyError`` if the model, at its firmware, has no such register.
        """
        registers = self.registers
        if name not in registers:
            raise KeyError(f"{self.mount.model} has no register {name!r}")
        return registers[name]

    @property
    def registers(self) -> dict[str, int]:
        """All registers as a read would bring them now: decoded (signed) counts by name."""
        return dict(self.bus.ask("registers", servo_id=self.mount.servo_id))

    @property
    def state(self) -> ServoState:
        """The output shaft as the plant has it [SI], not rounded to a register's counts."""
        return ServoState(**self.bus.ask("state", servo_id=self.mount.servo_id))


class VirtualServoBus(ServoBus):
    """A bus in this process and in virtual time: no waiting, and every run is the same."""

    def __init__(self, robot: Robot, plant: Plant, profile: Profile) -> None:
        super().__init__(robot)
        self.clock = VirtualClock()
        self.bus = assemble(robot, plant, profile)
        self._port = SdkPort(self.bus, self.clock)
        faults = Faults(self.bus, robot, seeded(0), plug_of(self._port))
        self._truth = Truth(robot, self.bus, faults)

    @property
    def port(self) -> SdkPort:
        """A port for the packet handlers of dynamixel_sdk."""
        return self._port

    @property
    def path(self) -> str:
        """There is no device in virtual time: raises :class:`ServoBusError`."""
        raise ServoBusError(
            "a bus in virtual time has no serial device: ask for servo_bus(..., wall=True), "
            "or run pytest with --busemu-wall"
        )

    def now_s(self) -> float:
        """Virtual time since the bus was made [s]."""
        return self.clock.now_s()

    def run(self, seconds: float) -> None:
        """Let virtual time pass [s]; ``ValueError`` for a negative or infinite time."""
        if not 0.0 <= seconds < math.inf:
            raise ValueError(f"cannot run for {seconds} s")
        self.clock.sleep_until(self.clock.now_s() + seconds)
        self._catch_up()

    def ask(self, question: str, **about: Any) -> Mapping[str, Any]:
        """Ask for the truth at this instant."""
        self._catch_up()
        return self._truth.questions[question](**about)

    def _catch_up(self) -> None:
        self._port.catch_up()
        self.bus.advance_plant(self.clock.now_s())

    def close(self) -> None:
        """Give back what the plant holds (PyBullet's engine)."""
        close = getattr(self.bus.plant, "close", None)
        if close is not None:
            close()
