"""What travels on the bus, and the e-manual's words and numbers for it.

The field names and values are those of the ROBOTIS e-manual, pages dxl/protocol1 and
dxl/protocol2 (sections Instruction, Error, Packet ID). Nothing here knows a wire format.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final

BROADCAST_ID = 0xFE
"""Packet ID that addresses every servo on the bus, in both protocols."""


class Instruction(enum.IntEnum):
    """Instruction byte of an instruction packet; some exist in one protocol only.

    Source: e-manual dxl/protocol1 and dxl/protocol2, tables of instructions. The exception is
    `USB2AX_SYNC_READ`, a Protocol 1.0 instruction the USB2AX adapter carries out itself.
    """

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    USB2AX_SYNC_READ = 0x84
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class ErrorBit1(enum.IntFlag):
    """Bits of the error byte of a Protocol 1.0 status packet (e-manual dxl/protocol1, Error)."""

    INPUT_VOLTAGE = 1 << 0
    ANGLE_LIMIT = 1 << 1
    OVERHEATING = 1 << 2
    RANGE = 1 << 3
    CHECKSUM = 1 << 4
    OVERLOAD = 1 << 5
    INSTRUCTION = 1 << 6


class Error2(enum.IntEnum):
    """Error number in bits 0-6 of a Protocol 2.0 error byte (e-manual dxl/protocol2, Error)."""

    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT_BIT = 0x80
"""Bit 7 of a Protocol 2.0 error byte: `hardware_error_status` of the servo is not 0."""


# One of the next two is made for every packet that goes over a bus. What `frozen=True` does at run
# time takes three times as long as the rest of making one, so here mypy alone holds that they never
# change: `Final`. They may be hashed for the same reason.


@dataclass(slots=True, unsafe_hash=True)
class InstructionPacket:
    """An instruction packet, host to servo; `parameters` are as meant, not as stuffed."""

    servo_id: Final[int]
    instruction: Final[int]
    parameters: Final[bytes] = b""


@dataclass(slots=True, unsafe_hash=True)
class StatusPacket:
    """A status packet, servo to host; `parameters` are as meant, not as stuffed.

    One from `BROADCAST_ID` is the joint reply to a fast sync read or fast bulk read: `error` is
    that of the first block and `parameters` are raw (see `busemu.protocol.v2`).
    """

    servo_id: Final[int]
    error: Final[int]
    parameters: Final[bytes] = b""


@dataclass(frozen=True, slots=True)
class BadPacket:
    """A complete packet whose checksum (1.0) or CRC (2.0) is wrong.

    `instruction` is the byte in that place, so in a Protocol 1.0 status packet it is the error
    byte. `expected` is computed from `data`, the whole packet as it was on the wire; `actual` is
    what the packet carried.
    """

    servo_id: int
    instruction: int
    reason: str
    expected: int
    actual: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that belong to no packet."""

    data: bytes


Packet = InstructionPacket | StatusPacket | BadPacket | Noise
"""Whatever a stream of bytes can turn out to be."""
