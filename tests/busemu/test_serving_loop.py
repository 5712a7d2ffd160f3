"""The serving loop, with ports and buses that the test writes."""

from __future__ import annotations

import os

import pytest

from busemu.serve import SLICE_S, ServerState, Station, serve


class DoneError(Exception):
    pass


class QuietPort:
    path = "quiet"

    def __init__(self) -> None:
        self.ends = os.pipe()
        self.unlocked = 0

    def fileno(self) -> int:
        return self.ends[0]

    def wait(self, timeout_s: float) -> bool:
        return False

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> None:
        assert not data

    def baud_rate(self) -> int:
        return 0

    def unlock(self) -> None:
        self.unlocked += 1

    def close(self) -> None:
        for end in self.ends:
            os.close(end)


class SlowBus:
    """A bus whose joints are a second behind the clock, and stay so."""

    baud_rate, plant_s, line_free_s = 1_000_000, 0.0, 0.0

    def __init__(self) -> None:
        self.slices: list[float] = []

    def receive(self, data: bytes, now_s: float) -> None:
        raise AssertionError

    def next_reply_s(self) -> None:
        return None

    def next_deadline_s(self) -> float:
        return 0.0

    def poll(self, now_s: float) -> bytes:
        return b""

    def deliver(self, now_s: float) -> bytes:
        return b""

    def advance_plant(self, to_s: float) -> None:
        self.slices.append(to_s)


def test_a_server_that_is_behind_for_good_still_tells_of_it_and_serves_every_bus() -> None:
    port, buses = QuietPort(), [SlowBus(), SlowBus()]
    states: list[ServerState] = []

    def tell(state: ServerState) -> None:
        states.append(state)
        raise DoneError

    try:
        with pytest.raises(DoneError):
            serve(*(Station(port, bus) for bus in buses), every_s=0.01, tell=tell)
    finally:
        port.close()
    assert states[0].physics_late_s > SLICE_S
    for bus in buses:
        assert set(bus.slices) == {SLICE_S}


def test_a_server_that_is_behind_for_good_still_unlocks_its_ports_and_answers_requests() -> None:
    port, told = QuietPort(), 0

    def idle(now_s: float) -> None:
        nonlocal told
        told += 1
        if told == 2:
            raise DoneError

    def tell(state: ServerState) -> None:
        raise AssertionError("behind for so long, and nothing that can wait was done")

    try:
        with pytest.raises(DoneError):
            serve(Station(port, SlowBus(), idle=idle), every_s=20.0, tell=tell)
    finally:
        port.close()
    assert port.unlocked == 2
