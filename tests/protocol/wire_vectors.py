"""The example packets of tests/vectors, as packets and bytes."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busemu.protocol import Framer, InstructionPacket, StatusPacket, v1, v2

FOLDER = Path(__file__).parents[1] / "vectors"


@dataclass(frozen=True, slots=True)
class Vector:
    protocol: float
    entry: dict[str, Any]

    @property
    def wire(self) -> bytes:
        return bytes.fromhex(self.entry["wire"])

    @property
    def packet(self) -> InstructionPacket | StatusPacket:
        parameters = bytes.fromhex(self.entry["parameters"])
        if self.entry["kind"] == "instruction":
            return InstructionPacket(self.entry["id"], self.entry["instruction"], parameters)
        return StatusPacket(self.entry["id"], self.entry["error"], parameters)

    def framer(self) -> Framer:
        role = "device" if self.entry["kind"] == "instruction" else "host"
        return Framer(self.protocol, role=role)

    def encode(self) -> bytes:
        codec = v1 if self.protocol == 1.0 else v2
        packet = self.packet
        if "blocks" in self.entry:
            return v2.encode_fast_status(self.blocks)
        if isinstance(packet, InstructionPacket):
            return codec.encode_instruction(packet)
        return codec.encode_status(packet)

    @property
    def blocks(self) -> list[tuple[int, int, bytes]]:
        return [
            (block["id"], block["error"], bytes.fromhex(block["data"]))
            for block in self.entry["blocks"]
        ]

    def __str__(self) -> str:
        return f"{self.protocol}: {self.entry['means']}"


def load() -> list[Vector]:
    return [
        Vector(protocol, entry)
        for protocol, name in ((1.0, "protocol1.toml"), (2.0, "protocol2.toml"))
        for entry in tomllib.loads((FOLDER / name).read_text(encoding="utf-8"))["packet"]
    ]
