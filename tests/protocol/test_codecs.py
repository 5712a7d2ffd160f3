"""Writing packets: what is refused, and that what is written is read as what was meant."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from busemu.protocol import (
    BROADCAST_ID,
    Framer,
    Instruction,
    InstructionPacket,
    StatusPacket,
    crc16,
    encode_fast_status,
    fast_status_slices,
    split_fast_status,
    v1,
    v2,
)

BYTE = st.integers(0, 0xFF)
# Any bytes, and bytes that make headers and stuffing likely.
DATA = st.one_of(
    st.binary(max_size=60),
    st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x01, 0x02]), max_size=60).map(bytes),
)
INSTRUCTIONS_1 = st.builds(InstructionPacket, st.integers(0, BROADCAST_ID), BYTE, DATA)
STATUSES_1 = st.builds(StatusPacket, st.integers(0, 0xFD), BYTE, DATA)
INSTRUCTIONS_2 = st.builds(
    InstructionPacket,
    st.one_of(st.integers(0, 0xFC), st.just(BROADCAST_ID)),
    BYTE.filter(lambda number: number != Instruction.STATUS),
    DATA,
)
STATUSES_2 = st.builds(StatusPacket, st.integers(0, 0xFC), BYTE, DATA)
BLOCKS = st.lists(st.tuples(st.integers(0, 0xFC), BYTE, DATA), min_size=1, max_size=8)


@given(INSTRUCTIONS_1)
def test_a_protocol_1_instruction_is_read_as_meant(packet: InstructionPacket):
    assert Framer(1.0).feed(v1.encode_instruction(packet)) == [packet]


@given(STATUSES_1)
def test_a_protocol_1_status_is_read_as_meant(packet: StatusPacket):
    assert Framer(1.0, role="host").feed(v1.encode_status(packet)) == [packet]


@given(INSTRUCTIONS_2, st.sampled_from(["device", "host"]))
def test_a_protocol_2_instruction_is_read_as_meant(packet: InstructionPacket, role):
    assert Framer(2.0, role=role).feed(v2.encode_instruction(packet)) == [packet]


@given(STATUSES_2, st.sampled_from(["device", "host"]))
def test_a_protocol_2_status_is_read_as_meant(packet: StatusPacket, role):
    assert Framer(2.0, role=role).feed(v2.encode_status(packet)) == [packet]


@given(BLOCKS)
def test_a_fast_status_is_read_as_meant(blocks: list[tuple[int, int, bytes]]):
    (packet,) = Framer(2.0, role="host").feed(encode_fast_status(blocks))
    assert isinstance(packet, StatusPacket)
    assert packet.servo_id == BROADCAST_ID
    assert split_fast_status(packet, [len(data) for _, _, data in blocks]) == blocks


@given(BLOCKS)
def test_each_crc_of_a_fast_status_covers_all_before_it(blocks: list[tuple[int, int, bytes]]):
    slices = fast_status_slices(blocks)
    assert b"".join(slices) == encode_fast_status(blocks)
    for so_far in itertools.accumulate(slices):
        assert crc16(so_far[:-2]) == int.from_bytes(so_far[-2:], "little")


@pytest.mark.parametrize(
    ("encode", "packet", "message"),
    [
        (v1.encode_instruction, InstructionPacket(255, 1), "ID 255 is not in 0..254"),
        (v1.encode_instruction, InstructionPacket(-1, 1), "ID -1"),
        (v1.encode_instruction, InstructionPacket(1, 256), "instruction 256 is not one byte"),
        (v1.encode_instruction, InstructionPacket(1, 3, bytes(249)), "249 parameters, at most 248"),
        (v1.encode_status, StatusPacket(254, 0), "ID 254 is not in 0..253"),
        (v1.encode_status, StatusPacket(1, 256), "error 256 is not one byte"),
        (v1.encode_status, StatusPacket(1, 0, bytes(249)), "249 parameters"),
        (v2.encode_instruction, InstructionPacket(253, 1), "ID 253 is not in 0..252 or broadcast"),
        (v2.encode_instruction, InstructionPacket(255, 1), "ID 255"),
        (v2.encode_instruction, InstructionPacket(-1, 1), "ID -1"),
        (v2.encode_instruction, InstructionPacket(1, 0x55), "0x55 is not an instruction"),
        (v2.encode_instruction, InstructionPacket(1, 256), "0x100 is not an instruction"),
        (v2.encode_instruction, InstructionPacket(1, 3, bytes(1022)), "length 1025"),
        (v2.encode_instruction, InstructionPacket(1, 3, b"\xff\xff\xfd" * 300), "length 1203"),
        (v2.encode_status, StatusPacket(253, 0), "ID 253"),
        (v2.encode_status, StatusPacket(BROADCAST_ID, 0), "ID 254"),
        (v2.encode_status, StatusPacket(1, -1), "error -1"),
        (v2.encode_status, StatusPacket(1, 0, bytes(1021)), "length 1025"),
        (encode_fast_status, [], "at least one block"),
        (encode_fast_status, [(253, 0, b"")], "ID 253"),
        (encode_fast_status, [(1, 0, b""), (2, 256, b"")], "error 256"),
        (encode_fast_status, [(1, 0, bytes(1020))], "length 1025"),
    ],
)
def test_what_does_not_fit_is_refused(encode, packet, message: str):
    with pytest.raises(ValueError, match=message):
        encode(packet)


def test_the_longest_packets_are_written_and_read():
    longest1 = InstructionPacket(1, 3, bytes(248))
    assert Framer(1.0).feed(v1.encode_instruction(longest1)) == [longest1]
    longest2 = InstructionPacket(1, 3, bytes(1021))
    assert Framer(2.0).feed(v2.encode_instruction(longest2)) == [longest2]
    fast = [(1, 0, bytes(1019))]
    (packet,) = Framer(2.0).feed(encode_fast_status(fast))
    assert split_fast_status(packet, [1019]) == fast


@pytest.mark.parametrize("count", [252, 253, 254, 255, 256, 508, 509, 510, 764, 765, 766, 1020])
def test_a_length_of_two_bytes_is_read_as_written(count: int):
    packet = InstructionPacket(1, 3, bytes(count))
    wire = v2.encode_instruction(packet)
    assert int.from_bytes(wire[5:7], "little") == count + 3 == len(wire) - 7
    framer = Framer(2.0)
    assert [found for byte in wire for found in framer.feed(bytes((byte,)))] == [packet]


def test_blocks_that_do_not_add_up_are_refused():
    (packet,) = Framer(2.0).feed(encode_fast_status([(1, 0, b"\1\2"), (2, 0, b"\3\4")]))
    with pytest.raises(ValueError, match="are not blocks of"):
        split_fast_status(packet, [2, 3])
    with pytest.raises(ValueError, match="not from ID 7"):
        split_fast_status(StatusPacket(7, 0, b"\1\2"), [2])
