"""The USB2AX's own sync read, over its profile; pypot is the client that relies on it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pty_server import serving
from virtual_bus import AX, XL, Bench, small_robot

from busemu.protocol import ErrorBit1, Framer, StatusPacket
from busemu.timing import load_profile
from busemu.trace import WireEventKind

SYNC, ADAPTER, BROADCAST = 0x84, 0xFD, 254
GOAL = 30
QUICK = {"return_delay_time": 0}


def adapter_bench(ids=(1, 2, 3), profile="usb2ax") -> Bench:
    bench = Bench(small_robot(AX, ids), profile=profile)
    for servo_id in ids:
        bench.set("goal_position", 500 + servo_id, servo_id)
    bench.wire.clear()
    return bench


def ask(bench: Bench, *parameters: int, to: int = BROADCAST) -> StatusPacket | None:
    answer = bench.send(bench.packet(SYNC, parameters, to))
    packets = Framer(1.0, role="host").feed(answer)
    assert len(packets) <= 1
    if not packets:
        assert answer == b""
        return None
    (status,) = packets
    assert isinstance(status, StatusPacket)
    return status


def goals(*ids: int) -> bytes:
    return b"".join((500 + i).to_bytes(2, "little") for i in ids)


@pytest.mark.parametrize("to", [BROADCAST, ADAPTER])
def test_adapter_answers_with_the_data_of_all_in_the_order_asked(to: int) -> None:
    bench = adapter_bench()
    assert ask(bench, GOAL, 2, 3, 1, 2, to=to) == StatusPacket(ADAPTER, 0, goals(3, 1, 2))


def test_a_servo_that_is_not_there_reads_ff_and_does_not_silence_the_rest() -> None:
    bench = adapter_bench()
    status = ask(bench, GOAL, 2, 1, 9, 255, 3)
    assert status == StatusPacket(ADAPTER, 0, goals(1) + b"\xff" * 4 + goals(3))


def test_a_servo_that_refuses_or_is_too_slow_reads_ff() -> None:
    bench = adapter_bench()
    status = ask(bench, 200, 2, 1)
    assert status == StatusPacket(ADAPTER, 0, b"\xff\xff")
    slow = adapter_bench(profile=replace(load_profile("usb2ax"), usb2ax_timeout_s=0.5e-3))
    assert ask(slow, GOAL, 2, 1) == StatusPacket(ADAPTER, 0, b"\xff\xff")


@pytest.mark.parametrize("size", [0, 7])
def test_more_than_six_bytes_of_each_are_out_of_range(size: int) -> None:
    assert ask(adapter_bench(), GOAL, size, 1) == StatusPacket(ADAPTER, int(ErrorBit1.RANGE), b"")
    assert len(ask(adapter_bench(), GOAL, 6, 1).parameters) == 6


def test_a_packet_of_more_than_thirty_servos_is_nobodys() -> None:
    assert len(ask(adapter_bench(), GOAL, 2, *range(1, 31)).parameters) == 60
    assert ask(adapter_bench(), GOAL, 2, *range(1, 32)) is None


def test_other_adapters_and_servos_do_not_know_it() -> None:
    for profile in ("ideal", "ftdi-1ms", "thesis-phantomx"):
        assert ask(adapter_bench(profile=profile), GOAL, 2, 1, 2) is None
    bench = Bench(XL, profile="usb2ax")
    bench.bus.receive(bench.packet(SYNC, [37, 0, 2, 0, 1], BROADCAST), 0.0)
    assert bench.sleep(0.1) == b""


def test_the_wire_carries_one_read_after_another_and_an_absent_servo_costs_the_timeout() -> None:
    bench = adapter_bench()
    ask(bench, GOAL, 2, 1, 9, 3)
    kinds = [event.kind for event in bench.wire]
    read, status = WireEventKind.INSTRUCTION, WireEventKind.STATUS
    assert kinds == [read, read, status, read, read, status]
    starts = [event.start_s for event in bench.wire]
    assert starts == sorted(starts)
    absent, after = bench.wire[3], bench.wire[4]
    assert after.start_s - absent.end_s == pytest.approx(load_profile("usb2ax").usb2ax_timeout_s)


@pytest.mark.pty
def test_pypot_reads_all_positions_at_once() -> None:
    pypot = pytest.importorskip("pypot.dynamixel")
    with (
        serving("--robot", "phantomx", "--timing", "usb2ax") as server,
        pypot.DxlIO(server.path, baudrate=1_000_000, timeout=1.0, use_sync_read=True) as io,
    ):
        ids = list(range(1, 19))
        positions = io.get_present_position(ids)
        assert len(positions) == len(ids)
        assert io.get_present_position((4,)) == positions[3:4]
        with pytest.raises(Exception, match="77"):
            io.get_present_position((1, 77))
