"""Buses to soak: in virtual time in this process, and in wall-clock time behind a real server."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import IO

from busemu.assemble import plants
from busemu.clock import Clock, MonotonicClock
from busemu.control import ControlError, ask
from busemu.plant import DriveCommand, Plant, ServoState
from busemu.tables import Robot
from busemu.timing import load_profile
from hal.bus_client import BusClient, open_port
from hal.bus_errors import PortError

from .testing import BusFaults, VirtualServoBus

#: ``busemu``, which ends when the process that started it does, however that ends.
SERVE = """
import ctypes, signal
ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG; source: prctl(2)
from busemu.cli import main
main()
"""


class MeteredPlant:
    """A plant that keeps the instant it was advanced to [s]."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.now_s = 0.0
        self.command: Callable[[int, DriveCommand], None] = plant.command
        self.sample: Callable[[int], ServoState] = plant.sample
        self.observe = plant.observe

    def advance(self, to_s: float) -> None:
        """Simulate up to ``to_s`` [s]."""
        self._plant.advance(to_s)
        self.now_s = to_s


class Rig(ABC):
    """A bus to soak: how to open its port, let time pass, and look at it from outside."""

    faults: BusFaults
    clock: Clock

    @abstractmethod
    def open(self) -> BusClient:
        """Open the port, anew where it was lost; raises :class:`hal.bus_errors.PortError`."""

    @abstractmethod
    def run(self, until_s: float) -> None:
        """Let time pass up to an instant of :attr:`clock` [s]."""

    @abstractmethod
    def memory_kib(self) -> int:
        """Memory that the bus's process holds."""

    @abstractmethod
    def drift_s(self) -> tuple[float, float]:
        """How far the joints were behind the bus: at most, and at last [s]."""


class VirtualRig(Rig):
    """In this process and in virtual time."""

    def __init__(self, robot: Robot, plant: str) -> None:
        self._plant = MeteredPlant(plants()[plant](robot))
        self._bus = VirtualServoBus(robot, self._plant, load_profile(robot.timing))
        self.clock = self._bus.clock
        self.faults = self._bus.faults
        self._worst_s = 0.0

    def open(self) -> BusClient:
        """Open the port."""
        robot = self._bus.robot
        try:
            self._bus.port.openPort()
        except OSError as error:
            raise PortError(str(error)) from None
        return BusClient(self._bus.port, robot.tables, robot.protocol, self.clock)

    def run(self, until_s: float) -> None:
        """Let virtual time pass."""
        self._bus.run(max(0.0, until_s - self.clock.now_s()))
        self._worst_s = max(self._worst_s, self._behind_s())

    def _behind_s(self) -> float:
        return abs(self.clock.now_s() - self._plant.now_s)

    def memory_kib(self) -> int:
        """Memory of this process."""
        return resident_kib(os.getpid())

    def drift_s(self) -> tuple[float, float]:
        """Bus time less the instant that the plant has reached."""
        self.run(self.clock.now_s())
        return self._worst_s, self._behind_s()


class WallRig(Rig):
    """``busemu serve`` in a process of its own, with a trace."""

    def __init__(self, robot: Robot, plant: str, folder: Path) -> None:
        self._robot = robot
        self._link = folder / "soak"
        self.clock = MonotonicClock()
        self.faults = BusFaults(lambda **asked: ask(str(self._link), asked))
        self._port: object = None
        self._said: IO[bytes] = (folder / "server.txt").open("w+b")
        command = [sys.executable, "-c", SERVE, "serve", "--robot", robot.name]
        trace = ["--trace", str(folder / "soak.trace"), "--trace-size", "8"]
        self.server = subprocess.Popen(
            [*command, "--plant", plant, "--link", str(self._link), *trace],
            stdout=self._said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        while not self._answers():
            if self.server.poll() is not None:
                sys.exit(f"busemu serve has ended: {self.said()}")
            time.sleep(0.05)

    def _answers(self) -> bool:
        try:
            return self.faults.standing() == []
        except ControlError:
            return False

    def said(self) -> str:
        """What the server said."""
        self._said.seek(0)
        return self._said.read().decode(errors="replace")

    def open(self) -> BusClient:
        """Open the link."""
        port = open_port(str(self._link), self._robot.baud_rate)
        return BusClient(port, self._robot.tables, self._robot.protocol, self.clock)

    def run(self, until_s: float) -> None:
        """Sleep."""
        self.clock.sleep_until(until_s)

    def memory_kib(self) -> int:
        """Memory of the server."""
        return resident_kib(self.server.pid)

    def drift_s(self) -> tuple[float, float]:
        """What the server says of itself, every five seconds."""
        told = re.findall(r"physics behind by ([0-9.]+) ms", self.said())
        behind_s = [float(each) / 1e3 for each in told] or [math.nan]
        return max(behind_s), behind_s[-1]

    def close(self) -> None:
        """End the server."""
        self.server.send_signal(signal.SIGINT)
        self.server.wait(30)
        self._said.close()


def resident_kib(process: int) -> int:
    """Memory that a process holds in RAM."""
    pages = int(Path(f"/proc/{process}/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024
