"""Protocol 2.0 packets, to and from bytes.

Source: e-manual dxl/protocol2. Both kinds of packet have one shape; a status packet has 55 for
its instruction and its error byte before the parameters::

    FF FF FD | 00 | ID | LENGTH low high | INSTRUCTION | parameters ... | CRC low high

LENGTH counts from the instruction to the CRC, stuffing included: stuffed parameters + 3.

The reply to a fast sync read or fast bulk read is one packet from the broadcast ID to which every
servo asked adds its own block. The first servo also sends what comes before it, with the LENGTH of
the whole::

    FF FF FD 00 FE LENGTH 55 | ERROR ID data CRC | ERROR ID data CRC | ...

It is not stuffed. Each CRC covers everything from the header on, earlier CRCs included, so the
last one is also the CRC of the packet. Nobody else answers from the broadcast ID, and that is how
a reader tells: a status packet from FE is left raw.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from struct import Struct

from busemu.protocol.crc import crc16
from busemu.protocol.packets import (
    BROADCAST_ID,
    BadPacket,
    Instruction,
    InstructionPacket,
    StatusPacket,
)
from busemu.protocol.stuffing import STUFFED, stuff, unstuff

HEADER = b"\xff\xff\xfd\x00"
"""The three header bytes and the reserved byte, which is 0 in every packet so far defined."""
BEFORE_BODY = 7
"""Bytes before the instruction: what LENGTH does not count."""
MAX_ID = 0xFC
MIN_LENGTH = 3
MAX_LENGTH = 1024
"""Largest LENGTH taken for one. The e-manual sets no bound; the official SDK drops any status with
more (RXPACKET_MAX_LEN). A false length from a damaged packet can hold up no more than this."""

STATUS = int(Instruction.STATUS)
_HEADER_NUMBER = int.from_bytes(HEADER, "little")
_FD = 0xFD
_NO_IDS = frozenset({0xFD, 0xFF})
_SHORTEST = BEFORE_BODY + MIN_LENGTH
#: By the size of a packet, its fields, read in one call: header, ID, length, instruction, error,
#: parameters, CRC. The shortest packet has no byte where the others have the error.
_SHAPES = {
    _SHORTEST: Struct("<IBHB0s0sH"),
    **{
        size: Struct(f"<IBHBB{size - _SHORTEST - 1}sH")
        for size in range(_SHORTEST + 1, BEFORE_BODY + MAX_LENGTH + 1)
    },
}
#: So many status frames are remembered.
REMEMBERED = 4096


def encode_instruction(packet: InstructionPacket) -> bytes:
    """Return the bytes of an instruction packet, stuffed.

    Raises ValueError when the ID is neither in 0..252 nor broadcast, when the instruction is 0x55,
    which marks a status packet, or when another field does not fit.
    """
    instruction = packet.instruction
    if not 0 <= packet.servo_id <= MAX_ID and packet.servo_id != BROADCAST_ID:
        raise ValueError(f"Protocol 2.0: ID {packet.servo_id} is not in 0..{MAX_ID} or broadcast")
    if not 0 <= instruction <= 0xFF or instruction == STATUS:
        raise ValueError(f"Protocol 2.0: {instruction:#x} is not an instruction from a host")
    return _encode(packet.servo_id, stuff(b"%c%b" % (instruction, packet.parameters)))


def encode_status(packet: StatusPacket) -> bytes:
    """Return the bytes of a status packet, stuffed.

    Raises ValueError when the ID is not in 0..252 (a reply from the broadcast ID is
    `encode_fast_status`), or another field does not fit.
    """
    return status_frame(packet.servo_id, packet.error, packet.parameters)


@lru_cache(REMEMBERED)
def status_frame(servo_id: int, error: int, parameters: bytes) -> bytes:
    """`encode_status` by fields. Replies repeat, so the frames made last are remembered."""
    _check_sender(servo_id, error)
    return _encode(servo_id, stuff(b"%c%c%b" % (STATUS, error, parameters)))


def encode_fast_status(blocks: Sequence[tuple[int, int, bytes]]) -> bytes:
    """Return the whole reply to a fast read; each block is (servo ID, error, data).

    Raises ValueError as `fast_status_slices` does.
    """
    return b"".join(fast_status_slices(blocks))


def fast_status_slices(blocks: Sequence[tuple[int, int, bytes]]) -> list[bytes]:
    """Return the reply to a fast read as the part each servo puts on the wire, in their order.

    Raises ValueError when there is no block, when an ID is not in 0..252, or when the packet would
    be too long.
    """
    if not blocks:
        raise ValueError("Protocol 2.0: a fast status packet has at least one block")
    length = 1 + sum(4 + len(data) for _, _, data in blocks)
    ahead = _before_body(BROADCAST_ID, length) + bytes((STATUS,))
    crc = 0
    slices = []
    for servo_id, error, data in blocks:
        _check_sender(servo_id, error)
        block = ahead + bytes((error, servo_id)) + data
        check = crc16(block, crc)
        tail = check.to_bytes(2, "little")
        crc = crc16(tail, check)
        slices.append(block + tail)
        ahead = b""
    return slices


def split_fast_status(
    packet: StatusPacket, data_lengths: Sequence[int]
) -> list[tuple[int, int, bytes]]:
    """Return the blocks (servo ID, error, data) of a status packet from the broadcast ID.

    `data_lengths` are the numbers of bytes that were asked for, servo by servo. The framer has
    checked the last CRC; the ones between the blocks are not looked at here, because the last one
    covers them. Raises ValueError when the lengths do not add up.
    """
    raw = bytes((packet.error,)) + packet.parameters
    if packet.servo_id != BROADCAST_ID:
        raise ValueError(f"Protocol 2.0: a fast status packet is not from ID {packet.servo_id}")
    if len(raw) + 2 != sum(4 + size for size in data_lengths):
        raise ValueError(f"Protocol 2.0: {len(raw)} bytes are not blocks of {list(data_lengths)}")
    blocks = []
    start = 0
    for size in data_lengths:
        blocks.append((raw[start + 1], raw[start], raw[start + 2 : start + 2 + size]))
        start += 4 + size
    return blocks


def parse(frame: bytes) -> InstructionPacket | StatusPacket | None:
    """Return the packet if `frame` is exactly one sound packet, and else `None`."""
    shape = _SHAPES.get(len(frame))
    if shape is None:
        return None
    header, servo_id, length, instruction, error, parameters, crc = shape.unpack(frame)
    if (
        header != _HEADER_NUMBER
        or servo_id in _NO_IDS
        or length + BEFORE_BODY != len(frame)
        or crc16(frame[:-2]) != crc
    ):
        return None
    stuffed = _FD in parameters and STUFFED in frame  # the first alone is quick, and seldom so
    if instruction != STATUS:
        after = unstuff(frame[BEFORE_BODY:-2])[1:] if stuffed else frame[BEFORE_BODY + 1 : -2]
        return InstructionPacket(servo_id, instruction, after)
    if length == MIN_LENGTH:  # no room for its error
        return None
    if stuffed and servo_id != BROADCAST_ID:
        parameters = unstuff(frame[BEFORE_BODY:-2])[2:]
    return StatusPacket(servo_id, error, parameters)


def refused(frame: bytes) -> BadPacket | None:
    """Return what is wrong with the CRC of a whole frame that is not taken, if that is wrong."""
    expected = crc16(frame[:-2])
    actual = int.from_bytes(frame[-2:], "little")
    if expected == actual:
        return None
    return BadPacket(frame[4], frame[7], "CRC", expected, actual, frame)


def _check_sender(servo_id: int, error: int) -> None:
    if not 0 <= servo_id <= MAX_ID:
        raise ValueError(f"Protocol 2.0: a servo with ID {servo_id}, not in 0..{MAX_ID}, answers")
    if not 0 <= error <= 0xFF:
        raise ValueError(f"Protocol 2.0: error {error} is not one byte")


def _before_body(servo_id: int, length: int) -> bytes:
    if length > MAX_LENGTH:
        raise ValueError(f"Protocol 2.0: length {length} with stuffing, at most {MAX_LENGTH} fits")
    return b"%b%c%c%c" % (HEADER, servo_id, length & 0xFF, length >> 8)


def _encode(servo_id: int, body: bytes) -> bytes:
    packet = _before_body(servo_id, len(body) + 2) + body
    return packet + crc16(packet).to_bytes(2, "little")
