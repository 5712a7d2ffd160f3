"""Whatever comes down the line, the bus lives, stays small, and answers the next ping."""

from __future__ import annotations

import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from virtual_bus import AX, OK, XL, Bench

from busemu.protocol import InstructionPacket, v1, v2

BOTH = pytest.mark.parametrize("model", [AX, XL])

INSTRUCTIONS = (1, 2, 3, 4, 5, 8, 0x10, 0x20, 0x82, 0x83, 0x84, 0x8A, 0x92, 0x93, 0x9A)
#: Well-formed packets of any content, so that hostile bytes get past the checksum. None resets or
#: renames: parameters stay at addresses above the EEPROM's ID, baud rate and status return level.
packets = st.builds(
    lambda servo_id, instruction, parameters: (servo_id, instruction, parameters),
    st.sampled_from([1, 2, 3, 9, 254]),
    st.sampled_from(INSTRUCTIONS),
    st.binary(max_size=60).map(lambda b: b"\x19\x00" + b),
)
pieces = st.lists(st.one_of(st.binary(max_size=80), packets), max_size=12)


def encoded(model: str, piece: bytes | tuple[int, int, bytes]) -> bytes:
    if isinstance(piece, bytes):
        return piece
    encode = v1.encode_instruction if model == AX else v2.encode_instruction
    return encode(InstructionPacket(*piece))


def assert_lives(bench: Bench) -> None:
    """It answers a ping of some servo at some baud rate, and holds next to nothing."""
    bench.sleep(3.0)
    bus = bench.bus
    assert len(bus.agenda) <= 2 * len(bus.servos) + 2
    assert bus.hearing.held <= 1031
    assert bus.next_reply_s() is None
    servo = bus.servos[0]
    bench.port.setBaudRate(servo.baud_rate)
    bench.bus.receive(b"\x00", bench.now_s())
    bench.sleep(0.2)
    if servo.servo_id < 253 and [s.servo_id for s in bus.servos].count(servo.servo_id) == 1:
        status = bench.instruct(1, servo_id=servo.servo_id)
        assert status is not None


@BOTH
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(stream=pieces, gaps=st.lists(st.floats(0.0, 0.2), min_size=12, max_size=12))
def test_any_bytes_are_survived(
    model: str, stream: list[bytes | tuple[int, int, bytes]], gaps: list[float]
) -> None:
    bench = Bench(model)
    for piece, gap_s in zip(stream, gaps, strict=False):
        bench.send(encoded(model, piece), then_s=gap_s)
    assert_lives(bench)


@BOTH
@settings(max_examples=100, deadline=None)
@given(stream=pieces, cuts=st.lists(st.integers(1, 40), min_size=1))
def test_how_the_bytes_are_cut_into_writes_changes_nothing(
    model: str, stream: list[bytes | tuple[int, int, bytes]], cuts: list[int]
) -> None:
    data = b"".join(encoded(model, piece) for piece in stream)
    whole, cut = Bench(model), Bench(model)
    whole.bus.receive(data, 0.0)
    at = index = 0
    while at < len(data):
        step = cuts[index % len(cuts)]
        cut.bus.receive(data[at : at + step], 0.0)
        at, index = at + step, index + 1
    assert whole.sleep(2.0) == cut.sleep(2.0)
    assert [whole.image(i) for i in range(3)] == [cut.image(i) for i in range(3)]


def hostile(model: str, chance: random.Random) -> bytes:
    """A piece of a hostile stream: noise, half packets, false lengths, true packets, broken."""
    kind = chance.randrange(6)
    noise = chance.randbytes(chance.randrange(1, 200))
    if kind == 0:
        return noise
    if kind == 1:
        return bytes(chance.choice(b"\xff\xff\xfd\x00\xfe\x01") for _ in range(len(noise)))
    piece = (chance.choice([1, 2, 3, 9, 254]), chance.choice(INSTRUCTIONS), b"\x19\x00" + noise)
    packet = bytearray(encoded(model, piece))
    if kind == 2:
        return bytes(packet[: chance.randrange(1, len(packet))])
    if kind == 3:
        packet[chance.randrange(len(packet))] = chance.randrange(256)
    if kind == 4:
        packet[5] = chance.randrange(256)
    return bytes(packet)


@BOTH
def test_a_million_hostile_bytes_are_survived(model: str) -> None:
    chance = random.Random(20190524)
    bench = Bench(model, profile="thesis-marvin")
    bench.wire.clear()
    bench.bus.on_wire = None
    total = 0
    worst = 0
    while total < 1_000_000:
        data = b"".join(hostile(model, chance) for _ in range(20))
        total += len(data)
        bench.send(data, then_s=chance.choice([0.0, 1e-4, 2e-3, 0.15]))
        # The driver of a real port stops a program that is ahead of the wire; so does this one.
        bench.clock.sleep_until(bench.bus.line_free_s)
        bench.bus.poll(bench.now_s())
        worst = max(worst, len(bench.bus.agenda))
        assert bench.bus.hearing.held <= 1031
    assert worst < 300
    assert_lives(bench)
    assert bench.bus.counts.noise_bytes > 100_000
    assert bench.bus.counts.replies > 1000


@BOTH
def test_hostile_bytes_do_not_hide_the_ping_after_them(model: str) -> None:
    chance = random.Random(1)
    bench = Bench(model)
    for _ in range(300):
        bench.send(chance.randbytes(chance.randrange(1, 60)), then_s=0.2)
        assert bench.ping()[1] == OK
