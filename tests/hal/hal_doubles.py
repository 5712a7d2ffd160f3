# ruff: noqa: N802 (the SDK names its port's methods)
"""Stand-ins for tests of the robot's own software: a clock, a scripted port, a fake client."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from busemu.tables import ControlTable, load_table, parse_table
from hal.access import BusStatistics, Failure
from hal.bus_errors import PortLostError

BYTE_S = 1e-5  # 8N1 at 1 Mbps


def packet(text: str) -> bytes:
    return bytes.fromhex(text)


class FakeClock:
    def __init__(self) -> None:
        self.t_s = 100.0

    def now_s(self) -> float:
        return self.t_s

    def sleep_until(self, instant_s: float) -> None:
        self.t_s = max(self.t_s, instant_s)


class ScriptedPort:
    """Records what is written, and answers each write with the bytes scripted for it.

    Bytes take their time on the wire; a read with nothing left lets the packet timeout pass.
    """

    def __init__(self, clock: FakeClock, replies: Sequence[object]) -> None:
        self.clock = clock
        self.replies = list(replies)
        self.written: list[bytes] = []
        self.is_open, self.is_using = True, False
        self._waiting: list[object] = []
        self._timeout_s = math.inf

    def clearPort(self) -> None:
        self._waiting.clear()

    def writePort(self, data: Sequence[int]) -> int:
        sent = bytes(data)
        self.written.append(sent)
        self.clock.t_s += len(sent) * BYTE_S
        reply = self.replies.pop(0) if self.replies else b""
        self._waiting = list(reply) if isinstance(reply, bytes) else [reply]
        return len(sent)

    def readPort(self, length: int) -> bytes:
        if self._waiting and isinstance(self._waiting[0], BaseException):
            raise self._waiting.pop(0)
        data = bytes(self._waiting[:length])
        del self._waiting[:length]
        self.clock.t_s += len(data) * BYTE_S
        if not data and length:
            self.clock.t_s = max(self.clock.t_s, self._timeout_s + 1e-6)
        return data

    def setPacketTimeout(self, length: int) -> None:
        self.setPacketTimeoutMillis(0.01 * length + 34.0)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self._timeout_s = self.clock.t_s + msec * 1e-3

    def isPacketTimeout(self) -> bool:
        return self.clock.t_s > self._timeout_s

    def getBaudRate(self) -> int:
        return 1_000_000


def x_table() -> ControlTable:
    """The few registers of an X-series servo that the manual's examples use."""
    rows = [
        {"name": "goal_position", "address": 116, "size": 4, "encoding": "signed"},
        {"name": "present_position", "address": 132, "size": 4, "access": "R"},
    ]
    document = {"model": "X", "model_number": 1030, "protocol": 2.0, "baud_rates": {"3": 1000000}}
    return parse_table({**document, "register": rows}, Path("x.toml"))


class FakeClient:
    """Servos that are where they were told to be, as a client of the given protocol shows them."""

    def __init__(self, ids: Sequence[int], model: str, clock: FakeClock) -> None:
        self.clock = clock
        self.table = load_table(model)
        self.protocol = self.table.protocol
        self.statistics = BusStatistics()
        self.registers = {i: {"present_position": 512, "torque_enable": 0} for i in ids}
        self.calls: list[tuple[str, dict[int, int]]] = []
        self.mute: set[int] = set()
        self.dead_port = False
        self.read_s: list[float] = []  # how long the next reads take; then 19 ms
        self.on_read: list[BaseException | None] = []

    def sync_write(self, register: str, values: Mapping[int, int]) -> None:
        if self.dead_port:
            raise PortLostError("unplugged")
        self.calls.append((register, dict(values)))
        for i, raw in values.items():
            if i in self.mute:
                continue
            self.registers[i][register] = raw
            if register == "goal_position":
                self.registers[i]["present_position"] = raw

    def read_all(self, register: str, ids: Sequence[int]) -> dict[int, int | None]:
        if self.dead_port:
            raise PortLostError("unplugged")
        if register == "present_position" and self.on_read:
            error = self.on_read.pop(0)
            if error is not None:
                raise error
        self.clock.t_s += self.read_s.pop(0) if self.read_s else 0.019
        self.statistics.failures[Failure.NO_REPLY] += len(self.mute & set(ids))
        return {i: None if i in self.mute else self.registers[i][register] for i in ids}

    def read(self, servo_id: int, register: str) -> int:
        return self.registers[servo_id].get(register, 0)
