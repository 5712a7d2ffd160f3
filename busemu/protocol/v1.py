"""Protocol 1.0 packets, to and from bytes.

Source: e-manual dxl/protocol1. Both kinds of packet have one shape::

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | parameters ... | CHECKSUM

LENGTH counts from the byte after it to the checksum: parameters + 2.
"""

from __future__ import annotations

from functools import lru_cache

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


def parse_instruction(frame: bytes) -> InstructionPacket | BadPacket:
    """Return what a whole frame says, read as an instruction packet."""
    expected = ~sum(frame[2:-1]) & 0xFF
    if expected != frame[-1]:
        return _bad(frame, expected)
    return InstructionPacket(frame[2], frame[4], frame[5:-1])


def parse_status(frame: bytes) -> StatusPacket | BadPacket:
    """Return what a whole frame says, read as a status packet."""
    expected = ~sum(frame[2:-1]) & 0xFF
    if expected != frame[-1]:
        return _bad(frame, expected)
    return StatusPacket(frame[2], frame[4], frame[5:-1])


def _bad(frame: bytes, expected: int) -> BadPacket:
    return BadPacket(frame[2], frame[4], "checksum", expected, frame[-1], frame)


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
    body = bytes((servo_id, length, value)) + parameters
    return b"%b%b%c" % (HEADER, body, checksum(body))
