"""What the official SDK and pypot write and read, byte for byte."""

from __future__ import annotations

import itertools
import random

import pypot.dynamixel.protocol.v1 as pypot1
import pypot.dynamixel.protocol.v2 as pypot2
import pytest
from dynamixel_sdk import BROADCAST_ID as EVERYONE
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead
from hypothesis import given
from hypothesis import strategies as st
from wire_oracles import SDK1, SDK2, MemoryPort, sdk_stuffed, sent

from busemu.protocol import (
    Framer,
    Instruction,
    InstructionPacket,
    StatusPacket,
    encode_fast_status,
    stuff,
    v1,
    v2,
)

RANDOM = random.Random(20)


def some_bytes(count: int) -> list[int]:
    # No FF, so that nothing needs stuffing; what does is tested on its own.
    return [RANDOM.randrange(0xFF) for _ in range(count)]


def word(value: int) -> bytes:
    return value.to_bytes(2, "little")


def cases1() -> list[tuple[bytes, InstructionPacket]]:
    cases = []
    for _ in range(20):
        servo_id, address, size = RANDOM.randrange(254), RANDOM.randrange(100), RANDOM.randrange(20)
        data = some_bytes(size)
        ids = RANDOM.sample(range(254), 6)
        writes = list(itertools.chain.from_iterable((i, *some_bytes(3)) for i in ids))
        reads = list(itertools.chain.from_iterable((2, i, address) for i in ids))
        there = bytes((address, size))
        at = bytes((address, *data))
        # The SDK sends no ping, read or action to the broadcast ID in these methods.
        cases += [
            (sent(SDK1.ping, servo_id), InstructionPacket(servo_id, Instruction.PING)),
            (
                sent(SDK1.readTx, servo_id, address, size),
                InstructionPacket(servo_id, Instruction.READ, there),
            ),
            (
                sent(SDK1.writeTxOnly, servo_id, address, size, data),
                InstructionPacket(servo_id, Instruction.WRITE, at),
            ),
            (
                sent(SDK1.regWriteTxOnly, servo_id, address, size, data),
                InstructionPacket(servo_id, Instruction.REG_WRITE, at),
            ),
            (sent(SDK1.action, EVERYONE), InstructionPacket(EVERYONE, Instruction.ACTION)),
            (
                sent(SDK1.factoryReset, servo_id),
                InstructionPacket(servo_id, Instruction.FACTORY_RESET),
            ),
            (
                sent(SDK1.syncWriteTxOnly, address, 3, writes, len(writes)),
                InstructionPacket(
                    EVERYONE, Instruction.SYNC_WRITE, bytes((address, 3)) + bytes(writes)
                ),
            ),
            (
                sent(SDK1.bulkReadTx, reads, len(reads)),
                InstructionPacket(EVERYONE, Instruction.BULK_READ, b"\0" + bytes(reads)),
            ),
        ]
    return cases


def cases2() -> list[tuple[bytes, InstructionPacket]]:
    cases = []
    for _ in range(20):
        servo_id, address, size = RANDOM.randrange(253), RANDOM.randrange(999), RANDOM.randrange(20)
        data = some_bytes(size)
        ids = RANDOM.sample(range(253), 6)
        there = word(address) + word(size)
        writes = list(itertools.chain.from_iterable((i, *some_bytes(3)) for i in ids))
        reads = list(itertools.chain.from_iterable((i, *there) for i in ids))
        bulk = list(itertools.chain.from_iterable((i, *there, *some_bytes(size)) for i in ids))
        at = word(address) + bytes(data)

        def to(number: int, parameters: bytes = b"", servo_id: int = servo_id) -> InstructionPacket:
            return InstructionPacket(servo_id, number, parameters)

        def to_all(number: int, parameters: bytes = b"") -> InstructionPacket:
            return InstructionPacket(EVERYONE, number, parameters)

        cases += [
            (sent(SDK2.ping, servo_id), to(Instruction.PING)),
            (sent(SDK2.broadcastPing), to_all(Instruction.PING)),
            (sent(SDK2.readTx, servo_id, address, size), to(Instruction.READ, there)),
            (sent(SDK2.writeTxOnly, servo_id, address, size, data), to(Instruction.WRITE, at)),
            (
                sent(SDK2.regWriteTxOnly, servo_id, address, size, data),
                to(Instruction.REG_WRITE, at),
            ),
            (sent(SDK2.action, EVERYONE), to_all(Instruction.ACTION)),
            (sent(SDK2.factoryReset, servo_id, 2), to(Instruction.FACTORY_RESET, b"\x02")),
            (sent(SDK2.reboot, servo_id), to(Instruction.REBOOT)),
            (sent(SDK2.clearMultiTurn, servo_id), to(Instruction.CLEAR, b"\x01DXL\x22")),
            (
                sent(SDK2.syncReadTx, address, size, ids, 6, False),
                to_all(Instruction.SYNC_READ, there + bytes(ids)),
            ),
            (
                sent(SDK2.syncReadTx, address, size, ids, 6, True),
                to_all(Instruction.FAST_SYNC_READ, there + bytes(ids)),
            ),
            (
                sent(SDK2.syncWriteTxOnly, address, 3, writes, len(writes)),
                to_all(Instruction.SYNC_WRITE, word(address) + word(3) + bytes(writes)),
            ),
            (
                sent(SDK2.bulkReadTx, reads, len(reads), False),
                to_all(Instruction.BULK_READ, bytes(reads)),
            ),
            (
                sent(SDK2.bulkReadTx, reads, len(reads), True),
                to_all(Instruction.FAST_BULK_READ, bytes(reads)),
            ),
            (
                sent(SDK2.bulkWriteTxOnly, bulk, len(bulk)),
                to_all(Instruction.BULK_WRITE, bytes(bulk)),
            ),
        ]
    return cases


def test_protocol_1_instructions_are_the_bytes_of_the_sdk():
    for wire, packet in cases1():
        assert v1.encode_instruction(packet) == wire
        assert Framer(1.0).feed(wire) == [packet]


def test_protocol_2_instructions_are_the_bytes_of_the_sdk():
    for wire, packet in cases2():
        assert v2.encode_instruction(packet) == wire
        assert Framer(2.0).feed(wire) == [packet]


@given(st.integers(0, 0xFD), st.integers(0, 0x7F), st.binary(max_size=100))
def test_the_sdk_reads_our_protocol_1_status(servo_id: int, error: int, data: bytes):
    reply = v1.encode_status(StatusPacket(servo_id, error, data))
    assert SDK1.rxPacket(MemoryPort(reply)) == (list(reply), COMM_SUCCESS)
    read = SDK1.readRx(MemoryPort(reply), servo_id, len(data))
    assert read == (list(data), COMM_SUCCESS, error)


# The SDK undoes stuffing in place and looks back at bytes it has overwritten: after one pattern, it
# also drops an FD from FF FD FD. So at most one pattern here, and no FD FD after it.
@given(
    st.integers(0, 0xFC),
    st.integers(0, 0xFF),
    st.binary(max_size=50),
    st.sampled_from([b"", b"\xff\xff\xfd", b"\xff\xff\xff\xfd"]),
    st.binary(max_size=50),
)
def test_the_sdk_reads_our_protocol_2_status(
    servo_id: int, error: int, first: bytes, pattern: bytes, second: bytes
):
    data = first.replace(b"\xfd", b"\xfe") + pattern + second.replace(b"\xfd", b"\xfe")
    reply = v2.encode_status(StatusPacket(servo_id, error, data))
    read = SDK2.readRx(MemoryPort(reply), servo_id, len(data))
    assert read == (list(data), COMM_SUCCESS, error)


def test_the_sdk_itself_loses_an_fd_after_a_stuffed_pattern():
    data = b"\xff\xff\xfd\x00\xff\xfd\xfd"
    reply = v2.encode_status(StatusPacket(1, 0, data))
    read, result, _ = SDK2.readRx(MemoryPort(reply), 1, len(data))
    assert result == COMM_SUCCESS
    assert bytes(read[: len(data) - 1]) == b"\xff\xff\xfd\x00\xff\xfd"
    assert bytes(read) != data
    assert Framer(2.0, role="host").feed(reply) == [StatusPacket(1, 0, data)]


def test_the_sdk_reads_our_reply_to_a_fast_sync_read():
    blocks = [(3, 0, b"\xa6\0\0\0"), (7, 0x80, b"\xff\xff\xfd\xfd"), (4, 0, b"\xff\x03\0\0")]
    port = MemoryPort(encode_fast_status(blocks))
    group = GroupSyncRead(port, SDK2, 132, 4)
    for servo_id, _, _ in blocks:
        group.addParam(servo_id)
    assert group.fastSyncRead() == COMM_SUCCESS
    for servo_id, _, data in blocks:
        assert group.getData(servo_id, 132, 4) == int.from_bytes(data, "little")


def test_the_sdk_reads_our_reply_to_a_fast_bulk_read():
    # ID 9, not 4: the SDK would take the first 4 in its list, a data length, for the servo.
    blocks = [(3, 0, b"\xa6\0\0\0"), (7, 0, b"\x1f\x08"), (9, 0, b"\x24")]
    asked = [3, 132, 0, 4, 0, 7, 124, 0, 2, 0, 9, 146, 0, 1, 0]
    data, result = SDK2.fastBulkReadRx(MemoryPort(encode_fast_status(blocks)), asked)
    assert result == COMM_SUCCESS
    assert data == {servo_id: list(data) for servo_id, _, data in blocks}


def test_the_sdk_forgets_the_stuffing_of_what_it_sends():
    """dynamixel-sdk 4.1.0: txPacket drops the result of addStuffing and sends the plain packet.

    The servo gets FF FF FD without its FD, and the CRC is right. Such a packet is read as it is.
    """
    data = [0xFF, 0xFF, 0xFD, 0x00]
    packet = InstructionPacket(1, Instruction.WRITE, word(116) + bytes(data))
    wire = sent(SDK2.writeTxOnly, 1, 116, len(data), data)
    assert wire[7:-2] == bytes((packet.instruction,)) + packet.parameters
    assert wire != v2.encode_instruction(packet) == sdk_stuffed(wire)
    assert Framer(2.0).feed(wire) == [packet]


def test_the_sdk_unstuffed_can_lose_a_byte_at_the_servo():
    """What the SDK does not stuff, the servo still unstuffs: FF FF FD FD arrives as FF FF FD."""
    wire = sent(SDK2.writeTxOnly, 1, 116, 4, [0xFF, 0xFF, 0xFD, 0xFD])
    meant = InstructionPacket(1, Instruction.WRITE, word(116) + b"\xff\xff\xfd")
    assert Framer(2.0).feed(wire) == [meant]
    assert stuff(b"\xff\xff\xfd") == b"\xff\xff\xfd\xfd"


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        (pypot1.DxlPingPacket(3), InstructionPacket(3, 1)),
        (pypot1.DxlResetPacket(3), InstructionPacket(3, 6)),
        (pypot1.DxlReadDataPacket(3, 36, 2), InstructionPacket(3, 2, b"\x24\x02")),
        (pypot1.DxlWriteDataPacket(3, 30, (9, 1)), InstructionPacket(3, 3, b"\x1e\x09\x01")),
        (
            pypot1.DxlSyncReadPacket((1, 2), 36, 2),
            InstructionPacket(254, Instruction.USB2AX_SYNC_READ, b"\x24\x02\x01\x02"),
        ),
        (
            pypot1.DxlSyncWritePacket(30, 1, (1, 7, 2, 8)),
            InstructionPacket(254, Instruction.SYNC_WRITE, b"\x1e\x01\x01\x07\x02\x08"),
        ),
    ],
    ids=lambda case: type(case).__name__,
)
def test_protocol_1_instructions_are_the_bytes_of_pypot(theirs, ours: InstructionPacket):
    assert v1.encode_instruction(ours) == theirs.to_string()


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        (pypot2.DxlPingPacket(3), InstructionPacket(3, 1)),
        (pypot2.DxlResetPacket(3, 1), InstructionPacket(3, 6, b"\x01")),
        (pypot2.DxlReadDataPacket(3, 37, 2), InstructionPacket(3, 2, b"\x25\0\x02\0")),
        (pypot2.DxlWriteDataPacket(3, 30, (9, 1)), InstructionPacket(3, 3, b"\x1e\0\x09\x01")),
        (
            pypot2.DxlSyncReadPacket((1, 2), 37, 2),
            InstructionPacket(254, Instruction.SYNC_READ, b"\x25\0\x02\0\x01\x02"),
        ),
        (
            pypot2.DxlSyncWritePacket(30, 1, (1, 7, 2, 8)),
            InstructionPacket(254, Instruction.SYNC_WRITE, b"\x1e\0\x01\0\x01\x07\x02\x08"),
        ),
    ],
    ids=lambda case: type(case).__name__,
)
def test_protocol_2_instructions_are_the_bytes_of_pypot(theirs, ours: InstructionPacket):
    assert v2.encode_instruction(ours) == theirs.to_string()


@pytest.mark.parametrize(("codec", "theirs"), [(v1, pypot1), (v2, pypot2)], ids=["1.0", "2.0"])
def test_pypot_reads_our_status(codec, theirs):
    reply = codec.encode_status(StatusPacket(9, 0x24, b"\x01\x02\x03"))
    assert theirs.DxlStatusPacket.from_string(reply) == (9, 0x24, (1, 2, 3))
