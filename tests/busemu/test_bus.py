"""The line itself: packets in pieces, gaps, collisions, wrong baud rates, the wire log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from virtual_bus import (
    AX,
    CORRUPT,
    IDEAL,
    OK,
    TIMEOUT,
    XL,
    Bench,
    ScriptedPlant,
    count_rad,
    small_robot,
)

from busemu.clock import VirtualClock
from busemu.group import superpose
from busemu.protocol import Framer, StatusPacket
from busemu.trace import WireEvent, WireEventKind

BOTH = pytest.mark.parametrize("model", [AX, XL])
GAP_S = {AX: 0.100, XL: 0.0015}
PING = 1


def statuses(bench: Bench, data: bytes) -> list[int]:
    """IDs of the status packets in a stream of nothing else."""
    packets = Framer(bench.robot.protocol, role="host").feed(data)
    assert all(isinstance(packet, StatusPacket) for packet in packets)
    return [packet.servo_id for packet in packets]


# -- packets in pieces --------------------------------------------------------------------------


@BOTH
def test_packet_in_pieces_is_read_while_gaps_are_short(model: str) -> None:
    bench = Bench(model)
    for cut in range(1, len(bench.packet(PING))):
        packet = bench.packet(PING)
        assert bench.send(packet[:cut], then_s=0.9 * GAP_S[model]) == b""
        assert statuses(bench, bench.send(packet[cut:], then_s=0.2)) == [1]


@BOTH
def test_packet_byte_by_byte_is_read(model: str) -> None:
    bench = Bench(model)
    *head, last = bench.packet(PING)
    for value in head:
        assert bench.send(bytes([value]), then_s=0.9 * GAP_S[model]) == b""
    assert statuses(bench, bench.send(bytes([last]), then_s=0.2)) == [1]


@BOTH
def test_gap_longer_than_the_interbyte_timeout_ends_a_packet(model: str) -> None:
    bench = Bench(model)
    packet = bench.packet(PING)
    for cut in range(1, len(packet)):
        assert bench.send(packet[:cut], then_s=1.1 * GAP_S[model]) == b""
        assert bench.send(packet[cut:], then_s=0.2) == b""
    assert bench.ping()[1] == OK


@BOTH
def test_several_packets_of_one_write_are_all_carried_out(model: str) -> None:
    bench = Bench(model)
    address = [25] if model == AX else [25, 0]
    for i in (1, 2, 3):
        bench.write("status_return_level", 1, i)
    packets = b"".join(bench.packet(3, [*address, 1], i) for i in (1, 2, 3))
    assert bench.send(packets + bench.packet(PING, servo_id=2)) != b""
    assert [bench.memory("led", i) for i in range(3)] == [1, 1, 1]


@BOTH
def test_noise_before_a_packet_does_not_hide_it(model: str) -> None:
    bench = Bench(model)
    for noise in (b"\x00", b"\xff", b"\xff\xff\xff", b"\xff\xfd\x00\x55", bytes(range(200))):
        bench.sleep(0.2)
        assert statuses(bench, bench.send(noise + bench.packet(PING))) == [1]


# -- two who speak at once ----------------------------------------------------------------------


@BOTH
def test_host_that_talks_into_a_reply_is_not_heard(model: str) -> None:
    bench = Bench(model)
    bench.set("return_delay_time", 0)
    bench.send(bench.packet(PING), then_s=0.00013 if model == XL else 0.00008)
    errors = bench.bus.counts.errors
    assert statuses(bench, bench.send(bench.packet(PING, servo_id=2))) == [1]
    assert bench.bus.counts.errors == errors + 1
    assert bench.wire[-1].kind is WireEventKind.COLLISION


@BOTH
def test_host_that_talks_within_a_return_delay_is_heard(model: str) -> None:
    bench = Bench(model)
    bench.set("return_delay_time", 0, 2)
    bench.bus.receive(bench.packet(PING, servo_id=1), bench.now_s())
    bench.sleep(0.0002)
    data = bench.send(bench.packet(PING, servo_id=2))
    assert statuses(bench, data) == [2, 1]


@BOTH
def test_reply_that_begins_while_the_host_still_sends_is_lost_to_it(model: str) -> None:
    bench = Bench(model)
    bench.set("return_delay_time", 0)
    address = [36] if model == AX else [37, 0]
    length = [2] if model == AX else [2, 0]
    two = bench.packet(PING, servo_id=1) + bench.packet(2, address + length, 2)
    answer = bench.send(two)
    whole = len(Bench(model).send(bench.packet(2, address + length, 2)))
    assert answer.endswith(Bench(model).send(bench.packet(2, address + length, 2)))
    assert len(answer) - whole < len(Bench(model).send(bench.packet(PING)))
    assert any(event.kind is WireEventKind.COLLISION for event in bench.wire)


def with_twins(model: str, apart: Callable[[int], float]) -> tuple[Bench, ScriptedPlant]:
    """Servos 1 and 2, the second renamed to 1; ``apart`` gives each one's angle by plant ID."""
    plant = ScriptedPlant()
    plant.angle = lambda servo_id, now_s: apart(servo_id)
    bench = Bench(model, plant)
    bench.set("id", 1, 2)
    return bench, plant


@BOTH
def test_two_servos_of_one_id_cannot_be_read_when_they_differ(model: str) -> None:
    bench, _ = with_twins(model, lambda i: count_rad(None, 300 * i))
    _, result, _ = bench.read("present_position")
    assert result in (CORRUPT, TIMEOUT)
    assert bench.wire[-1].kind is WireEventKind.COLLISION
    assert bench.get("present_position", 3) == 900


@BOTH
def test_two_servos_of_one_id_that_say_the_same_at_once_are_read(model: str) -> None:
    """Nobody can tell: their bits are the same, so a ping finds one servo."""
    bench, _ = with_twins(model, lambda i: 0.0)
    assert bench.ping()[1] == OK
    assert bench.get("present_position") == 512


@BOTH
def test_two_servos_of_one_id_both_take_a_write(model: str) -> None:
    bench, _ = with_twins(model, lambda i: 0.0)
    bench.write("led", 1)
    assert [bench.memory("led", i) for i in range(3)] == [1, 1, 0]
    bench.sync_write(bench.table["led"].address, {1: b"\x00"})
    bench.sleep(0.01)
    assert [bench.memory("led", i) for i in range(3)] == [0, 0, 0]


@BOTH
def test_two_servos_of_one_id_are_both_read_when_their_return_delays_are_far_apart(
    model: str,
) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    bench.set("return_delay_time", 0, 2)
    bench.set("id", 1, 2)
    assert statuses(bench, bench.send(bench.packet(PING))) == [1, 1]


@pytest.mark.parametrize(
    ("runs", "expected"),
    [
        ([(0.0, b"ab"), (2.0, b"cd")], [(0.0, b"ab", False), (2.0, b"cd", False)]),
        ([(2.0, b"cd"), (0.0, b"ab")], [(0.0, b"ab", False), (2.0, b"cd", False)]),
        ([(0.0, b"\xf0\x0f"), (0.0, b"\x3c\xff")], [(0.0, b"\x30\x0f", True)]),
        ([(0.0, b"\xf0\x0f"), (1.0, b"\x3c\xaa")], [(0.0, b"\xf0\x0c\xaa", True)]),
        ([(0.0, b"\x01\x02\x03"), (1.0, b"\xff")], [(0.0, b"\x01\x02\x03", True)]),
        ([], []),
    ],
)
def test_bytes_of_two_servos_at_once_mix_and_zeros_win(runs: list, expected: list) -> None:
    assert superpose(runs, 1.0) == expected


def test_twins_of_a_sync_read_corrupt_it() -> None:
    bench, _ = with_twins(XL, lambda i: count_rad(None, 300 * i))
    result, _ = bench.sync_read("present_position", [3, 1])
    assert result == CORRUPT


# -- baud rates ---------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("baud_rate", [9600, 57_600, 115_200, 500_000, 2_000_000, 1_050_000])
def test_wrong_baud_rate_meets_silence_and_the_right_one_is_served_again(
    model: str, baud_rate: int
) -> None:
    bench = Bench(model)
    bench.port.setBaudRate(baud_rate)
    assert bench.ping()[1] == TIMEOUT
    assert bench.write("led", 1)[0] == TIMEOUT
    bench.port.setBaudRate(1_000_000)
    assert bench.ping()[1] == OK
    assert bench.get("led") == 0


@BOTH
def test_baud_rate_a_little_off_is_forgiven(model: str) -> None:
    bench = Bench(model)
    for baud_rate in (980_000, 1_020_000):
        bench.port.setBaudRate(baud_rate)
        assert bench.ping()[1] == OK


def test_servos_of_two_baud_rates_share_a_line() -> None:
    bench = Bench(XL)
    bench.set("baud_rate", 1, 2)
    found, _ = bench.sdk.broadcastPing(bench.port)
    assert sorted(found) == [1, 3]
    bench.port.setBaudRate(57_600)
    found, _ = bench.sdk.broadcastPing(bench.port)
    assert sorted(found) == [2]


def test_broadcast_ping_at_9600_baud_finds_all() -> None:
    """A reply takes 15 ms there, longer than the slot of an ID: they take turns nevertheless."""
    bench = Bench(small_robot(XL, [1, 2, 3, 4], baud_rate=9600), profile="thesis-marvin")
    found, result = bench.sdk.broadcastPing(bench.port)
    assert result == OK
    assert sorted(found) == [1, 2, 3, 4]


# -- the wire log -------------------------------------------------------------------------------


@BOTH
def test_wire_log_holds_whole_packets_at_their_times(model: str) -> None:
    bench = Bench(model)
    packet = bench.packet(PING)
    bench.bus.receive(b"\x11\x22" + packet[:3], 0.0)
    bench.bus.receive(packet[3:], 0.0)
    answer = bench.sleep(0.01)
    byte_s = 1e-5
    begun_s, asked_s = 2 * byte_s, (2 + len(packet)) * byte_s
    replied_s = asked_s + 500e-6
    *noises, instruction, status = bench.wire
    noise = replace(noises[0], end_s=noises[-1].end_s, data=b"".join(e.data for e in noises))
    for event, kind, start_s, data in (
        (noise, WireEventKind.NOISE, 0.0, b"\x11\x22"),
        (instruction, WireEventKind.INSTRUCTION, begun_s, packet),
        (status, WireEventKind.STATUS, replied_s, answer),
    ):
        assert event.kind is kind
        assert event.data == data
        assert event.start_s == pytest.approx(start_s, abs=1e-12)
        assert event.end_s == pytest.approx(start_s + len(data) * byte_s, abs=1e-12)


@BOTH
def test_wire_log_parts_noise_from_a_packet_that_begins_like_it(model: str) -> None:
    """Of three FF the last two are the header; that is known only with the third."""
    bench = Bench(model)
    packet = bench.packet(PING)
    bench.send(b"\xff" + packet)
    noise, instruction = bench.wire[:2]
    assert (noise.kind, noise.data) == (WireEventKind.NOISE, b"\xff")
    assert instruction.data == packet
    assert noise.end_s == pytest.approx(1e-5)
    assert instruction.start_s == pytest.approx(1e-5)


@BOTH
def test_counts_tell_transactions_replies_errors_and_noise(model: str) -> None:
    bench = Bench(model)
    bench.ping()
    bench.read("led", 9)
    bench.write("led", 200)
    bench.send(b"\x00\x01\x02")
    counts = bench.bus.counts
    asked = 2 if model == AX else 1  # the SDK's ping of Protocol 1.0 reads the model number too
    assert counts.transactions == asked + 2
    assert counts.replies == asked + 1
    assert counts.errors == 2  # nobody answered 9; 200 was refused
    assert counts.noise_bytes == 3


# -- time ---------------------------------------------------------------------------------------


def test_virtual_time_never_goes_back() -> None:
    clock = VirtualClock(5.0)
    clock.sleep_until(4.0)
    assert clock.now_s() == 5.0
    clock.sleep_until(6.0)
    assert clock.now_s() == 6.0


@BOTH
def test_recurring_event_comes_at_once_and_then_at_its_period(model: str) -> None:
    bench = Bench(model)
    seen: list[float] = []
    bench.bus.every(0.02, seen.append)
    bench.sleep(0.1001)
    assert seen == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08, 0.10])


def script(model: str, profile: str, start_s: float, step_s: float) -> tuple[list[WireEvent], list]:
    """A short programme; what was on the wire, and what the client saw when."""
    bench = Bench(model, profile=profile, start_s=start_s)
    seen: list = []
    for i in (1, 2, 3):
        bench.set("torque_enable", 1, i)
    for round_ in range(20):
        goal = (400 + 10 * round_).to_bytes(2, "little")
        bench.sync_write(30, dict.fromkeys((1, 2, 3), goal))
        for name in ("present_position", "present_load"):
            seen += [bench.read(name, i) for i in (1, 2, 3, 9)]
        if model == XL:
            seen.append(bench.sync_read("present_position", (1, 2, 3)))
        seen.append(bench.now_s() - start_s)
        until_s = bench.now_s() + 0.03
        while bench.now_s() + step_s < until_s:
            bench.sleep(step_s)
        bench.clock.sleep_until(until_s)
    return bench.wire, seen


@BOTH
@pytest.mark.parametrize("profile", ["ideal", "thesis-marvin", "instant"])
def test_two_runs_are_the_same_to_the_bit(model: str, profile: str) -> None:
    assert script(model, profile, 0.0, 1.0) == script(model, profile, 0.0, 1.0)


@BOTH
def test_how_often_the_bus_is_polled_changes_nothing(model: str) -> None:
    assert script(model, "thesis-phantomx", 0.0, 1.0) == script(
        model, "thesis-phantomx", 0.0, 0.0007
    )


@BOTH
def test_bus_that_starts_late_on_its_clock_behaves_the_same(model: str) -> None:
    wire, seen = script(model, "ideal", 0.0, 1.0)
    late_wire, late_seen = script(model, "ideal", 1000.0, 1.0)
    assert [event.data for event in late_wire] == [event.data for event in wire]
    assert [event.start_s - 1000.0 for event in late_wire] == pytest.approx(
        [event.start_s for event in wire], abs=1e-9
    )
    assert [v for v in late_seen if not isinstance(v, float)] == [
        v for v in seen if not isinstance(v, float)
    ]


@BOTH
def test_replies_reach_the_host_in_the_order_of_the_wire(model: str) -> None:
    """Whatever holds them up on the way."""
    profile = replace(IDEAL, latency_timer_s=0.016, chunk_bytes=3)
    bench = Bench(model, profile=profile)
    for i in (3, 1, 2):
        bench.bus.receive(bench.packet(PING, servo_id=i), bench.now_s())
        bench.clock.sleep_until(bench.now_s() + 0.002)
        bench.bus.poll(-1.0)
    assert statuses(bench, bench.sleep(0.1)) == [3, 1, 2]
