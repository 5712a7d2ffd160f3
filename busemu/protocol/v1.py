"""Protocol 1.0 packets, to and from bytes.

Source: e-manual dxl/protocol1. Both kinds of packet have one shape::

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | parameters ... | CHECKSUM

LENGTH counts from the byte after it to the checksum: parameters + 2.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from struct import Struct
from typing import TypeVar

from busemu.protocol.crc import checksum
from busemu.protocol.packets import BROADCAST_ID, BadPacket, InstructionPacket, StatusPacket

HEADER = b"\xff\xff"
BEFORE_BODY = 4
"""Bytes before the instruction or error: what LENGTH does not count."""
#: So many status frames are remembered.
REMEMBERED = 4096
MAX_ID = 0xFD
MIN_LENGTH = 2
MAX_LENGTH = 250
"""Largest LENGTH taken for one. The e-manual sets no bound; the official SDK drops any status with
more (RXPACKET_MAX_LEN), and below 255 a lost ID byte cannot make FF a length."""
_NO_ID = 0xFF
_HEADER_NUMBER = int.from_bytes(HEADER, "big")
_SUM_OF_SOUND = 0xFD
"""Low byte of the sum of a whole packet: three times FF, of the header and what is checked."""

P = TypeVar("P", InstructionPacket, StatusPacket)
#: By the size of a packet, its fields: header, ID, length, instruction or error, parameters,
#: checksum. All are read or written in one call.
_SHAPES = {
    size: Struct(f">HBBB{size - BEFORE_BODY - MIN_LENGTH}sB")
    for size in range(BEFORE_BODY + MIN_LENGTH, BEFORE_BODY + MAX_LENGTH + 1)
}


def encode_instruction(packet: InstructionPacket) -> bytes:
    """Return the bytes of an instruction packet.

    Raises ValueError when the ID is above 254, or another field does not fit.
    """
    return _encode(
        packet.servo_id, BROADCAST_ID, "instruction", packet.instruction, packet.parameters
    )


def encode_status(packet: StatusPacket) -> bytes:
    """Return the bytes of a status packet.

    Raises ValueError when the ID is above 253 (nobody answers as broadcast), or another field
    does not fit.
    """
    return status_frame(packet.servo_id, packet.error, packet.parameters)


@lru_cache(REMEMBERED)
def status_frame(servo_id: int, error: int, parameters: bytes) -> bytes:
    """`encode_status` by fields. Replies repeat, so the frames made last are remembered."""
    return _encode(servo_id, MAX_ID, "error", error, parameters)


def _parser(kind: Callable[[int, int, bytes], P]) -> Callable[[bytes], P | None]:
    """A function that returns the packet if bytes are exactly one sound packet, and else `None`."""

    def parse(frame: bytes) -> P | None:
        shape = _SHAPES.get(len(frame))
        if shape is None:
            return None
        header, servo_id, length, value, parameters, _ = shape.unpack(frame)
        if (
            header != _HEADER_NUMBER
            or servo_id == _NO_ID
            or length + BEFORE_BODY != len(frame)
            or sum(frame) & 0xFF != _SUM_OF_SOUND
        ):
            return None
        return kind(servo_id, value, parameters)

    return parse


parse_instruction = _parser(InstructionPacket)
parse_status = _parser(StatusPacket)


def refused(frame: bytes) -> BadPacket:
    """Return what is wrong with a whole frame that neither parser takes."""
    return BadPacket(frame[2], frame[4], "checksum", checksum(frame[2:-1]), frame[-1], frame)


def _encode(servo_id: int, max_id: int, name: str, value: int, parameters: bytes) -> bytes:
    if not 0 <= servo_id <= max_id:
        raise ValueError(f"Protocol 1.0: ID {servo_id} is not in 0..{max_id}")
    if not 0 <= value <= 0xFF:
        raise ValueError(f"Protocol 1.0: {name} {value} is not one byte")
    length = len(parameters) + MIN_LENGTH
    if length > MAX_LENGTH:
        raise ValueError(
            f"Protocol 1.0: {len(parameters)} parameters, "
            f"at most {MAX_LENGTH - MIN_LENGTH} fit a packet"
        )
    check = ~(servo_id + length + value + sum(parameters)) & 0xFF
    shape = _SHAPES[BEFORE_BODY + length]
    return shape.pack(_HEADER_NUMBER, servo_id, length, value, parameters, check)
