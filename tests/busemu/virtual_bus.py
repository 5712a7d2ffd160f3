"""Buses in virtual time with the official SDK's packet handlers as their client."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import dynamixel_sdk
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite

from busemu.assemble import assemble
from busemu.clock import VirtualClock
from busemu.plant import DriveCommand, Plant, ServoState, ideal
from busemu.ports.sdk import SdkPort
from busemu.protocol import Framer, InstructionPacket, StatusPacket, v1, v2
from busemu.tables import Robot, load_robot, load_table, parse_robot
from busemu.timing import Profile, load_profile
from busemu.trace import WireEvent

OK, TIMEOUT, CORRUPT = 0, -3001, -3002
AX, XL = "AX-12A", "XL-320"
ROBOT = {AX: "phantomx", XL: "marvin"}
IDEAL = Profile("ideal")
#: Error bits of Protocol 1.0 and error numbers of 2.0 (e-manual).
VOLTAGE_1, ANGLE_1, HEAT_1, RANGE_1, CHECKSUM_1, OVERLOAD_1, INSTRUCTION_1 = (
    1 << i for i in range(7)
)
RESULT_2, INSTRUCTION_2, CRC_2, RANGE_2, LENGTH_2, LIMIT_2, ACCESS_2 = range(1, 8)
ALERT_2 = 0x80


def small_robot(model: str, ids: Sequence[int] = (1, 2, 3), **bus: Any) -> Robot:
    """Servos of one model, one after the other, on a bus of 1 Mbps."""
    document = {
        "format": "busemu-robot/1",
        "bus": {
            "protocol": load_table(model).protocol,
            "baud_rate": 1_000_000,
            "servo_model": model,
            **bus,
        },
        "supply": {"voltage_v": {"value": 7.4}},
        "servo": [{"id": i, "joint": f"j{i}"} for i in ids],
    }
    return parse_robot(document, Path("small.toml"))


class ScriptedPlant:
    """Joints whose state the test writes: angles as functions of time, the rest as numbers."""

    def __init__(self, ids: Sequence[int] = (1, 2, 3)) -> None:
        self.now_s = 0.0
        self.angle: Callable[[int, float], float] = lambda servo_id, now_s: 0.0
        self.velocity_rad_s = 0.0
        self.duty = 0.0
        self.voltage_v = 7.4
        self.temperature_c = 25.0
        self.commands = {i: [(0.0, DriveCommand())] for i in ids}

    @classmethod
    def of_twelve_volts(cls) -> ScriptedPlant:
        plant = cls()
        plant.voltage_v = 12.0
        return plant

    def advance(self, to_s: float) -> None:
        if to_s < self.now_s:
            raise ValueError("back")
        self.now_s = to_s

    def command(self, servo_id: int, command: DriveCommand) -> None:
        self.commands[servo_id].append((self.now_s, command))

    def last(self, servo_id: int = 1) -> DriveCommand:
        return self.commands[servo_id][-1][1]

    def sample(self, servo_id: int) -> ServoState:
        if servo_id not in self.commands:
            raise KeyError(servo_id)
        return ServoState(
            position_rad=self.angle(servo_id, self.now_s),
            velocity_rad_s=self.velocity_rad_s,
            duty=self.duty,
            torque_nm=0.0,
            current_a=0.0,
            voltage_v=self.voltage_v,
            temperature_c=self.temperature_c,
        )

    def observe(self) -> dict[str, float]:
        return {}


class Bench:
    """A bus, its clock, and the SDK on it. Registers go by name."""

    def __init__(
        self,
        robot: Robot | str,
        plant: Plant | None = None,
        profile: Profile | str = IDEAL,
        *,
        start_s: float = 0.0,
    ) -> None:
        if isinstance(robot, str):
            robot = small_robot(robot) if robot in ROBOT else load_robot(robot)
        self.robot = robot
        if isinstance(profile, str):
            profile = load_profile(profile)
        self.wire: list[WireEvent] = []
        self.plant = plant if plant is not None else ideal(self.robot)
        self.clock = VirtualClock(start_s)
        self.bus = assemble(
            self.robot, self.plant, profile, start_s=start_s, on_wire=self.wire.append
        )
        self.port = SdkPort(self.bus, self.clock)
        self.sdk = dynamixel_sdk.PacketHandler(self.robot.protocol)
        self.table = next(iter(self.robot.tables.values()))
        self.two = self.robot.protocol == 2.0

    # -- time -------------------------------------------------------------------------------

    def now_s(self) -> float:
        return self.clock.now_s()

    def sleep(self, seconds: float) -> bytes:
        """Let time pass; what came meanwhile and nobody read."""
        self.clock.sleep_until(self.now_s() + seconds)
        return self.bus.poll(self.now_s())

    def ms(self, act: Callable[[], object]) -> float:
        """How much virtual time ``act`` takes [ms]."""
        before_s = self.now_s()
        act()
        return (self.now_s() - before_s) * 1e3

    # -- instructions -----------------------------------------------------------------------

    def ping(self, servo_id: int = 1) -> tuple[int, int, int]:
        return self.sdk.ping(self.port, servo_id)

    def read(self, name: str, servo_id: int = 1) -> tuple[int, int, int]:
        register = self.table[name]
        data, result, error = self.sdk.readTxRx(
            self.port, servo_id, register.address, register.size
        )
        return int.from_bytes(bytes(data), "little"), result, error

    def get(self, name: str, servo_id: int = 1) -> int:
        """A register that can be read without an error."""
        value, result, error = self.read(name, servo_id)
        assert (result, error) == (OK, 0), (name, result, error)
        return value

    def write(self, name: str, value: int, servo_id: int = 1) -> tuple[int, int]:
        register = self.table[name]
        return self.write_bytes(register.address, self.raw(name, value), servo_id)

    def write_bytes(self, address: int, data: bytes, servo_id: int = 1) -> tuple[int, int]:
        return self.sdk.writeTxRx(self.port, servo_id, address, len(data), list(data))

    def raw(self, name: str, value: int) -> bytes:
        return value.to_bytes(self.table[name].size, "little")

    def set(self, name: str, value: int, servo_id: int = 1) -> None:
        """A write that succeeds."""
        assert self.write(name, value, servo_id) == (OK, 0), name

    def reg_write(self, name: str, value: int, servo_id: int = 1) -> tuple[int, int]:
        data = self.raw(name, value)
        return self.sdk.regWriteTxRx(
            self.port, servo_id, self.table[name].address, len(data), list(data)
        )

    def sync_write(self, address: int, values: dict[int, bytes]) -> int:
        group = GroupSyncWrite(self.port, self.sdk, address, len(next(iter(values.values()))))
        for servo_id, data in values.items():
            group.addParam(servo_id, list(data))
        return group.txPacket()

    def sync_read(self, name: str, ids: Sequence[int]) -> tuple[int, dict[int, int]]:
        """The result, and the values of those that are there."""
        register = self.table[name]
        group = GroupSyncRead(self.port, self.sdk, register.address, register.size)
        for servo_id in ids:
            group.addParam(servo_id)
        result = group.txRxPacket()
        return result, {
            i: group.getData(i, register.address, register.size)
            for i in ids
            if group.isAvailable(i, register.address, register.size)
        }

    def packet(self, instruction: int, parameters: Sequence[int] = (), servo_id: int = 1) -> bytes:
        """Any instruction packet at all."""
        encode = v2.encode_instruction if self.two else v1.encode_instruction
        return encode(InstructionPacket(servo_id, instruction, bytes(parameters)))

    def instruct(
        self, instruction: int, parameters: Sequence[int] = (), servo_id: int = 1
    ) -> StatusPacket | None:
        """The status packet that answers an instruction; ``None`` for silence."""
        answer = self.send(self.packet(instruction, parameters, servo_id))
        packets = Framer(self.robot.protocol, role="host").feed(answer)
        assert len(packets) <= 1
        if not packets:
            assert answer == b""
            return None
        (status,) = packets
        assert isinstance(status, StatusPacket)
        assert status.servo_id == servo_id
        return status

    def send(self, data: bytes, *, then_s: float = 0.05) -> bytes:
        """Raw bytes to the driver; everything that comes back within ``then_s``."""
        self.bus.poll(self.now_s())
        self.bus.receive(data, self.now_s())
        return self.sleep(then_s)

    # -- what the servos are ------------------------------------------------------------------

    def memory(self, name: str, index: int = 0) -> int:
        """A register as the servo holds it, without the bus."""
        return self.bus.servos[index].memory[name]

    def image(self, index: int = 0) -> dict[str, int]:
        """All registers of a servo."""
        return {r.name: self.memory(r.name, index) for r in self.table.registers}


def count_rad(table: Any, count: int) -> float:
    """The angle [rad] that a position register's count stands for, from the datasheet's numbers."""
    return math.radians((count - 512) * 300.0 / 1024.0)
