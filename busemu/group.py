"""Instructions to several servos at once, and replies of several servos at once.

Layouts (e-manual): a sync instruction names one address and length for all IDs; a bulk instruction
names them for each. Addresses and lengths are one byte in Protocol 1.0 and two in 2.0. A packet
whose parameters do not divide up is nobody's: servos cannot answer it and stay silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .protocol import BROADCAST_ID, Instruction, InstructionPacket

#: servo ID, address, data
Write = tuple[int, int, bytes]


@dataclass(frozen=True, slots=True)
class GroupRead:
    """A sync or bulk read: ``items`` are (servo ID, address, length) in the order of replies."""

    instruction: int
    items: tuple[tuple[int, int, int], ...]

    @property
    def fast(self) -> bool:
        """Whether all servos answer in one packet."""
        return self.instruction in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)

    @property
    def fast_length(self) -> int:
        """LENGTH of the packet that answers a fast read: 4 bytes a block, its data, and 1."""
        return 1 + sum(4 + length for _, _, length in self.items)


def group_writes(packet: InstructionPacket, protocol: float) -> list[Write] | None:
    """The writes of a sync or bulk write; ``None`` where the packet is neither."""
    if packet.servo_id != BROADCAST_ID:
        return None
    parameters = packet.parameters
    if packet.instruction == Instruction.SYNC_WRITE:
        width = 1 if protocol == 1.0 else 2
        address, length = _pair(parameters, width)
        body = parameters[2 * width :]
        if length < 1 or len(body) % (length + 1):
            return []
        return [
            (body[at], address, body[at + 1 : at + 1 + length])
            for at in range(0, len(body), length + 1)
        ]
    if packet.instruction == Instruction.BULK_WRITE and protocol == 2.0:
        writes: list[Write] = []
        at = 0
        while at < len(parameters):
            address, length = _pair(parameters[at + 1 :], 2)
            data = parameters[at + 5 : at + 5 + length]
            if length < 1 or len(data) < length:
                return []
            writes.append((parameters[at], address, data))
            at += 5 + length
        return writes
    return None


def group_read(packet: InstructionPacket, protocol: float) -> GroupRead | None:
    """The reads of a sync or bulk read; ``None`` where the packet is neither.

    Protocol 1.0 has only the bulk read (of the MX models): a zero, then length, ID and address of
    each. A bulk read of Protocol 2.0 is ID, address and length of each.
    """
    parameters, instruction = packet.parameters, packet.instruction
    if packet.servo_id != BROADCAST_ID:
        return None
    items: list[tuple[int, int, int]] = []
    if protocol == 1.0:
        if instruction != Instruction.BULK_READ:
            return None
        if parameters[:1] == b"\x00" and len(parameters) % 3 == 1:
            triples = zip(parameters[1::3], parameters[2::3], parameters[3::3], strict=True)
            items = [(servo_id, address, length) for length, servo_id, address in triples]
    elif instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        address, length = _pair(parameters, 2)
        items = [(servo_id, address, length) for servo_id in parameters[4:]]
    elif instruction in (Instruction.BULK_READ, Instruction.FAST_BULK_READ):
        if len(parameters) % 5 == 0:
            items = [
                (parameters[at], *_pair(parameters[at + 1 :], 2))
                for at in range(0, len(parameters), 5)
            ]
    else:
        return None
    return GroupRead(instruction, tuple(items))


def _pair(parameters: bytes, width: int) -> tuple[int, int]:
    """Address and length at the head of ``parameters``; 0 and 0 where they are not all there."""
    if len(parameters) < 2 * width:
        return 0, 0
    return (
        int.from_bytes(parameters[:width], "little"),
        int.from_bytes(parameters[width : 2 * width], "little"),
    )


def superpose(
    runs: Sequence[tuple[float, bytes]], byte_s: float
) -> list[tuple[float, bytes, bool]]:
    """What the line carries when each of ``runs`` (start [s], bytes) is driven onto it.

    Runs that meet become one, in which the zeros of each win (assumed; by whole bytes), and which
    is marked as a collision. Two servos alike to the bit can so still be read.
    """
    if len(runs) == 1:
        return [(*runs[0], False)]
    carried: list[tuple[float, bytes, bool]] = []
    for start_s, data in sorted(runs):
        if carried:
            first_s, before, _ = carried[-1]
            if byte_s:
                offset = round((start_s - first_s) / byte_s)
            else:  # where bytes take no time, only those of one instant meet
                offset = 0 if start_s == first_s else len(before)
            if offset < len(before):
                length = max(len(before), offset + len(data))
                mixed = bytearray(before.ljust(length, b"\xff"))
                for index, value in enumerate(data):
                    mixed[offset + index] &= value
                carried[-1] = (first_s, bytes(mixed), True)
                continue
        carried.append((start_s, data, False))
    return carried
