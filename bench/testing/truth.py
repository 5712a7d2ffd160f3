"""What is really so on an emulated bus, told without a packet on the wire."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

from busemu.bus import Bus
from busemu.chance import seeded
from busemu.control import carry_out
from busemu.faults import FaultError, Faults, load_scenario
from busemu.tables import Robot


class Truth:
    """Answers questions about the servos of ``bus`` as they are at the instant it has reached.

    Servos go by the ID that the robot's file gives them, also when a program has changed it since.
    Each question is a method that takes and returns what JSON can hold.
    """

    def __init__(self, robot: Robot, bus: Bus, faults: Faults) -> None:
        self._bus = bus
        self._robot = robot
        self._faults = faults
        self._servos = {
            mount.servo_id: servo for mount, servo in zip(robot.servos, bus.servos, strict=True)
        }
        self.questions: Mapping[str, Callable[..., dict[str, Any]]] = MappingProxyType(
            {
                "registers": self.registers,
                "state": self.state,
                "counts": self.counts,
                "observe": self.observe,
                "fault": self.fault,
            }
        )

    def registers(self, servo_id: int) -> dict[str, int]:
        """All registers of a servo as a read would bring them now: decoded (signed) counts.

        A copy of the servo is read, so that the servo's watchdog does not take it for a packet.
        """
        servo = copy(self._servos[servo_id])
        servo.listens(self._bus.plant_s)
        servo.read(0, servo.table.size)
        memory = servo.memory
        return {r.name: memory.count(r.name) for r in servo.table.registers if memory.has(r.name)}

    def state(self, servo_id: int) -> dict[str, float]:
        """The plant's own state of a servo, in SI: fields of :class:`busemu.plant.ServoState`."""
        return asdict(self._bus.plant.sample(servo_id))

    def counts(self) -> dict[str, int]:
        """What the bus has seen so far: fields of :class:`busemu.trace.BusCounts`."""
        return asdict(self._bus.counts)

    def observe(self) -> dict[str, float]:
        """What an observer beside the robot sees: namespaced names to SI values."""
        return dict(self._bus.plant.observe())

    def fault(self, **asked: Any) -> dict[str, Any]:
        """Carry out a request for faults (:mod:`busemu.control`); ``error`` says what was wrong.

        Besides: ``{"do": "seed", "seed": 7}`` for the faults to come, and ``{"do": "scenario",
        "path": "faults.toml"}``.
        """
        try:
            if asked["do"] == "seed":
                self._faults.draw = seeded(asked["seed"])
                return {}
            if asked["do"] == "scenario":
                scenario = load_scenario(asked["path"], self._robot)
                self._faults.draw = seeded(scenario.seed)
                return {"numbers": [self._faults.add(fault) for fault in scenario.faults]}
            return carry_out(asked, self._faults, self._robot)
        except FaultError as error:
            return {"error": str(error)}
