"""The rules of the framer: where packets begin and end, and how it recovers."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from test_codecs import BLOCKS, INSTRUCTIONS_1, INSTRUCTIONS_2, STATUSES_2

from busemu.protocol import (
    BadPacket,
    Framer,
    InstructionPacket,
    Noise,
    StatusPacket,
    crc16,
    encode_fast_status,
    v1,
    v2,
)
from busemu.protocol.framer import REMEMBERED

KINDS = [(1.0, "device"), (1.0, "host"), (2.0, "device"), (2.0, "host")]
LONGEST = {1.0: 4 + 250, 2.0: 7 + 1024}
PING1 = InstructionPacket(1, 1)
READ1 = InstructionPacket(2, 2, b"\x24\x02")
PING2 = InstructionPacket(1, 1)
READ2 = InstructionPacket(2, 2, b"\x84\0\4\0")


def wire1(packet: InstructionPacket) -> bytes:
    return v1.encode_instruction(packet)


def wire2(packet: InstructionPacket) -> bytes:
    return v2.encode_instruction(packet)


def damaged(wire: bytes) -> bytes:
    return wire[:-1] + bytes((wire[-1] ^ 1,))


# Streams of packets of both protocols, whole, cut and damaged, between bytes of any kind.
PIECES = st.one_of(
    st.binary(max_size=12),
    st.lists(st.sampled_from([0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x05]), max_size=20).map(bytes),
    INSTRUCTIONS_1.map(wire1),
    INSTRUCTIONS_1.map(wire1).map(damaged),
    INSTRUCTIONS_2.map(wire2),
    INSTRUCTIONS_2.map(wire2).map(damaged),
    STATUSES_2.map(v2.encode_status),
    BLOCKS.map(encode_fast_status),
    st.tuples(INSTRUCTIONS_1.map(wire1), st.integers(1, 8)).map(lambda cut: cut[0][: -cut[1]]),
    st.tuples(INSTRUCTIONS_2.map(wire2), st.integers(1, 8)).map(lambda cut: cut[0][: -cut[1]]),
    st.just(b"\xff\xff\xfd\x00\x01\x03\x00\x55" + b"\xe2\xcf"),
)
STREAMS = st.lists(PIECES, max_size=8).map(b"".join)


def merged(packets: list[object]) -> list[object]:
    """Return the packets with each run of noise in one."""
    result: list[object] = []
    for packet in packets:
        if isinstance(packet, Noise) and result and isinstance(result[-1], Noise):
            result[-1] = Noise(result[-1].data + packet.data)
        else:
            result.append(packet)
    return result


@pytest.mark.parametrize(("protocol", "role"), KINDS)
@given(stream=STREAMS, data=st.data())
def test_the_chunks_of_a_stream_do_not_matter(protocol, role, stream, data):
    whole, cut, single = (Framer(protocol, role=role) for _ in range(3))
    packets = whole.feed(stream)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    edges = [0, *cuts, len(stream)]
    in_parts = [p for a, b in pairwise(edges) for p in cut.feed(stream[a:b])]
    by_byte = [p for byte in stream for p in single.feed(bytes((byte,)))]
    assert merged(in_parts) == merged(packets)
    assert merged(by_byte) == merged(packets)
    assert whole.pending == cut.pending == single.pending
    assert whole.abort() == cut.abort() == single.abort()


@pytest.mark.parametrize(("protocol", "role"), KINDS)
@given(stream=STREAMS)
@example(  # a sound packet within a bad one, which ends after it
    stream=bytes.fromhex("fffffd0000090000000001fbffffe512ffff000c0000000000000000000000f30000")
)
def test_no_bytes_are_an_error_or_lost_and_memory_is_bounded(protocol, role, stream):
    framer = Framer(protocol, role=role)
    noise = bad = 0
    for start in range(0, len(stream), 7):
        for packet in framer.feed(stream[start : start + 7]):
            noise += len(packet.data) if isinstance(packet, Noise) else 0
            bad += len(packet.data) if isinstance(packet, BadPacket) else 0
        assert framer.pending < LONGEST[protocol]
    rest = framer.abort()
    assert framer.pending == 0
    assert noise + bad + (len(rest.data) if rest else 0) <= len(stream)


@pytest.mark.parametrize(("protocol", "role"), KINDS)
@given(stream=STREAMS)
def test_noise_comes_merged_and_never_empty(protocol, role, stream):
    packets = Framer(protocol, role=role).feed(stream)
    assert merged(packets) == packets
    assert Noise(b"") not in packets


@given(st.lists(INSTRUCTIONS_2, max_size=6))
def test_good_packets_and_noise_account_for_every_byte(packets):
    stream = b"".join(b"\x01" + wire2(packet) for packet in packets)
    expected = [part for packet in packets for part in (Noise(b"\x01"), packet)]
    assert Framer(2.0).feed(stream) == expected


@pytest.mark.parametrize(
    ("head", "noise"),
    [
        ("FF", "FF"),
        ("FF FF FF", "FF FF FF"),
        ("FF FF FF FF 00", "FF FF FF FF 00"),
        ("FF FF 01 00", "FF FF 01 00"),  # length 0
        ("FF FF 01 01", "FF FF 01 01"),  # length 1
        ("FF FF 01 FB", "FF FF 01 FB"),  # length 251
        ("FF FF 01", "FF FF 01"),  # the next FF cannot be a length
    ],
)
def test_what_is_no_beginning_of_a_protocol_1_packet(head: str, noise: str):
    stream = bytes.fromhex(head) + wire1(READ1)
    assert Framer(1.0).feed(stream) == [Noise(bytes.fromhex(noise)), READ1]


@pytest.mark.parametrize(
    "head",
    [
        "FF",
        "FF FF",
        "FF FF FD",
        "FF FF FD 00",  # the ID cannot be FF
        "FF FF FD FD",
        "FF FF FD 01 01 03 00",  # reserved byte
        "FF FF FD 00 FD 03 00 01",  # ID 253
        "FF FF FD 00 01 02 00",  # length 2
        "FF FF FD 00 01 01 04",  # length 1025
        "FF FF FD 00 01 00 05",
        "FF FF FD 00 01 03 00 55 E2 CF",  # a status packet with no room for its error
    ],
)
def test_what_is_no_beginning_of_a_protocol_2_packet(head: str):
    stream = bytes.fromhex(head) + wire2(READ2)
    packets = Framer(2.0).feed(stream)
    assert packets == [Noise(bytes.fromhex(head)), READ2]


def test_a_right_checksum_does_not_make_a_packet_of_what_has_no_header():
    sound = wire1(READ1)
    same_sum = b"\xfe\x00" + sound[2:]
    assert sum(same_sum) & 0xFF == sum(sound) & 0xFF
    assert Framer(1.0).whole(sound) == READ1
    assert Framer(1.0).whole(same_sum) is None


@pytest.mark.parametrize("head", ["FF FF FD 01", "FE FF FD 00"])
def test_a_right_crc_does_not_make_a_packet_of_what_has_no_header(head: str):
    content = bytes.fromhex(head) + wire2(READ2)[4:-2]
    assert Framer(2.0).whole(content + crc16(content).to_bytes(2, "little")) is None


def test_the_short_status_above_has_a_right_crc():
    assert crc16(bytes.fromhex("FF FF FD 00 01 03 00 55")) == 0xCFE2


def test_an_id_that_only_protocol_1_has():
    packet = InstructionPacket(0xFD, 1)
    assert Framer(1.0).feed(wire1(packet)) == [packet]


def test_a_long_run_of_ff_is_noise_but_for_its_last_two():
    framer = Framer(1.0)
    (noise,) = framer.feed(b"\xff" * 1000)
    assert len(noise.data) == 998
    assert framer.feed(b"\x01\x02\x01\xfb") == [PING1]


def test_the_role_decides_between_instruction_and_status_in_protocol_1():
    wire = bytes.fromhex("FF FF 01 03 00 20 DB")
    assert Framer(1.0).feed(wire) == [InstructionPacket(1, 0, b"\x20")]
    assert Framer(1.0, role="host").feed(wire) == [StatusPacket(1, 0, b"\x20")]


def test_a_header_inside_a_packet_does_not_end_it():
    # Unstuffed, as some senders do, and in a fast status, as the manual has it.
    body = b"\x03\x74\x00\xff\xff\xfd\x00\x01\x03\x00"
    head = b"\xff\xff\xfd\x00\x01\x0c\x00" + body
    wire = head + crc16(head).to_bytes(2, "little")
    assert Framer(2.0).feed(wire) == [InstructionPacket(1, 3, body[1:])]
    (fast,) = Framer(2.0).feed(encode_fast_status([(1, 0, body)]))
    assert v2.split_fast_status(fast, [len(body)]) == [(1, 0, body)]


def test_a_fast_status_is_left_raw_and_another_status_is_not():
    data = b"\xff\xff\xfd\xfd"
    (fast,) = Framer(2.0, role="host").feed(encode_fast_status([(1, 0, data)]))
    assert fast.parameters == b"\x01" + data
    plain = v2.encode_status(StatusPacket(1, 0, b"\xff\xff\xfd"))
    assert data in plain
    assert Framer(2.0, role="host").feed(plain) == [StatusPacket(1, 0, b"\xff\xff\xfd")]


@pytest.mark.parametrize("lost", range(1, 8))
def test_protocol_1_lost_bytes_do_not_take_the_next_packet_along(lost: int):
    first = wire1(InstructionPacket(254, 0x83, bytes.fromhex("1E 02 01 00 02 02 00 03")))
    framer = Framer(1.0)
    bad, good = framer.feed(first[:-lost] + wire1(READ1))
    assert isinstance(bad, BadPacket)
    assert bad.servo_id == 254
    assert len(bad.data) == len(first)
    assert good == READ1
    assert framer.pending == 0


@pytest.mark.parametrize("lost", range(1, 10))
def test_protocol_2_lost_bytes_do_not_take_the_next_packet_along(lost: int):
    first = wire2(InstructionPacket(254, 0x83, bytes.fromhex("74 00 04 00 01 96 00 00 00 02 AA")))
    framer = Framer(2.0)
    bad, good = framer.feed(first[:-lost] + wire2(READ2))
    assert isinstance(bad, BadPacket)
    assert good == READ2
    assert framer.pending == 0


@pytest.mark.parametrize("lost", range(1, 5))
def test_lost_bytes_of_a_status_do_not_take_the_next_one_along(lost: int):
    first = v1.encode_status(StatusPacket(1, 0, b"\x20\x02"))
    second = StatusPacket(2, 0x24, b"\x21\x02\x07\x08")
    framer = Framer(1.0, role="host")
    bad, good = framer.feed(first[:-lost] + v1.encode_status(second))
    assert isinstance(bad, BadPacket)
    assert good == second


def test_packets_swallowed_whole_by_a_damaged_length_are_found():
    read = wire2(READ2)
    longer = read[:5] + bytes((read[5] + len(wire2(PING2)),)) + read[6:]
    stream = longer + wire2(PING2) + wire2(READ2)
    bad, ping, after = Framer(2.0).feed(stream)
    assert isinstance(bad, BadPacket)
    assert (ping, after) == (PING2, READ2)


def test_one_broken_packet_is_reported_once():
    # The data look like a ping with a wrong checksum, addressed to servo 5.
    inner = b"\xff\xff\x05\x02\x01\x00"
    broken = damaged(wire1(InstructionPacket(1, 3, b"\x1e" + inner)))
    framer = Framer(1.0)
    packets = framer.feed(broken + wire1(READ1))
    assert [type(packet) for packet in packets] == [BadPacket, InstructionPacket]
    assert packets[0].data == broken


def test_a_false_header_in_a_broken_packet_does_not_deafen():
    # FF FF 05 64: a packet of 100 bytes more, if 00 were an instruction.
    broken = damaged(wire1(InstructionPacket(1, 3, b"\x1e\xff\xff\x05\x64\x00\x00")))
    framer = Framer(1.0)
    assert [type(packet) for packet in framer.feed(broken)] == [BadPacket]
    assert framer.pending == 0
    assert framer.feed(wire1(READ1)) == [READ1]


def test_what_a_bad_packet_reported_is_no_noise_as_well():
    # It ends in the beginning of a header, held in case the next packet began there.
    wire = wire1(InstructionPacket(1, 3, b"\x1e\xff"))
    broken = wire[:-1] + b"\xff"
    framer = Framer(1.0)
    (bad,) = framer.feed(broken)
    assert bad.data == broken
    assert framer.pending == 2
    assert framer.abort() is None
    assert framer.pending == 0
    (bad,) = framer.feed(broken)
    assert framer.feed(b"\x07\x00\x00") == [Noise(b"\x07\x00\x00")]


def test_a_bad_packet_tells_what_was_expected():
    wire = bytes.fromhex("FF FF 01 04 02 2B 01 CD")
    assert Framer(1.0).feed(wire) == [BadPacket(1, 2, "checksum", 0xCC, 0xCD, wire)]
    wire = bytes.fromhex("FF FF FD 00 01 03 00 01 19 4F")
    assert Framer(2.0).feed(wire) == [BadPacket(1, 1, "CRC", 0x4E19, 0x4F19, wire)]


def test_abort_drops_the_unfinished_packet():
    framer = Framer(2.0)
    assert framer.abort() is None
    framer.feed(wire2(READ2)[:9])
    assert framer.pending == 9
    assert framer.abort() == Noise(wire2(READ2)[:9])
    assert framer.pending == 0
    assert framer.feed(wire2(PING2)) == [PING2]


@pytest.mark.parametrize(("protocol", "encode"), [(1.0, v1.encode_status), (2.0, v2.encode_status)])
def test_frames_are_remembered_but_not_for_ever(protocol, encode):
    framer = Framer(protocol, role="host")
    frames = [
        encode(StatusPacket(1, 0, number.to_bytes(2, "little"))) for number in range(REMEMBERED + 1)
    ]
    first = framer.whole(frames[0])
    assert framer.whole(frames[0]) is first
    for frame in frames[1:]:
        assert framer.feed(frame) == Framer(protocol, role="host").feed(frame)
    assert framer.whole(frames[0]) == first
    assert framer.whole(frames[0]) is not first


def test_any_buffer_of_bytes_can_be_fed():
    framer = Framer(2.0)
    assert framer.feed(bytearray(wire2(PING2)[:3])) == []
    assert framer.feed(memoryview(wire2(PING2)[3:])) == [PING2]
    (read,) = framer.feed(bytearray(wire2(READ2)))
    assert read == READ2
    assert isinstance(read.parameters, bytes)
    assert framer.feed(b"") == []


@pytest.mark.parametrize(("protocol", "role"), [(3.0, "device"), (1.0, "servo")])
def test_an_unknown_wire_format_is_refused(protocol: float, role: str):
    with pytest.raises(ValueError, match="no wire format"):
        Framer(protocol, role=role)
