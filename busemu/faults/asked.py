"""What an instruction is about: which servos, and which of their registers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..group import group_read, group_writes
from ..protocol import BROADCAST_ID, Instruction, InstructionPacket

_ONE_SERVOS = frozenset({Instruction.READ, Instruction.WRITE, Instruction.REG_WRITE})


@dataclass(frozen=True, slots=True)
class Asked:
    """An instruction, and (address, length) by servo ID; without registers, both are 0."""

    instruction: int = 0
    spans: Mapping[int, tuple[int, int]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The e-manual's word for the instruction."""
        known = self.instruction in set(Instruction)
        return Instruction(self.instruction).name.lower() if known else f"{self.instruction:#x}"


def asked_by(packet: InstructionPacket, protocol: float) -> Asked:
    """What ``packet`` asks for. A broadcast that names no servo has no spans."""
    parameters, number = packet.parameters, packet.instruction
    reads, writes = group_read(packet, protocol), group_writes(packet, protocol)
    spans: dict[int, tuple[int, int]] = {}
    if reads is not None:
        spans = {servo_id: (address, length) for servo_id, address, length in reads.items}
    elif writes is not None:
        spans = {servo_id: (address, len(data)) for servo_id, address, data in writes}
    elif packet.servo_id != BROADCAST_ID:
        width = 1 if protocol == 1.0 else 2
        address, rest = int.from_bytes(parameters[:width], "little"), parameters[width:]
        length = int.from_bytes(rest, "little") if number == Instruction.READ else len(rest)
        about = (address, length) if number in _ONE_SERVOS else (0, 0)
        spans = {packet.servo_id: about}
    return Asked(number, spans)
