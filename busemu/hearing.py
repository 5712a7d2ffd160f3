"""What the servos of a bus make of the host's bytes: packets, each with the instant it ends."""

from __future__ import annotations

from typing import Protocol

from .faults import Faults
from .protocol import BadPacket, Framer, InstructionPacket, Noise, StatusPacket
from .trace import BusCounts, WireEventKind


class Line(Protocol):
    """What is told of the bytes; instants are those of the bus's clock [s]."""

    counts: BusCounts

    def tell(  # noqa: D102
        self, kind: WireEventKind, start_s: float, end_s: float, data: bytes
    ) -> None: ...
    def take(  # noqa: D102
        self, packet: InstructionPacket | StatusPacket | BadPacket, end_s: float
    ) -> None: ...


class Hearing:
    """The receivers of all servos, which hear the same."""

    def __init__(self, line: Line, protocol: float, start_s: float) -> None:
        self._line = line
        self._framer = Framer(protocol)
        self._heard = bytearray()  #: bytes of the host that are no whole packet yet
        self._heard_s = start_s  #: when the first of them began

    @property
    def held(self) -> int:
        """Bytes that may still become a packet."""
        return max(self._framer.pending, len(self._heard))

    def hear(self, data: bytes, start_s: float, byte_s: float, faults: Faults | None) -> None:
        """Bytes that begin at ``start_s``, unless ``faults`` let the servos hear something else.

        Byte by byte, so that each packet ends at its instant; a write that is one packet, as most
        are, in one go.
        """
        whole = self._framer.whole(data)
        if isinstance(whole, InstructionPacket):
            self._heard_s = start_s
            self._understand(whole, data, start_s + len(data) * byte_s, byte_s, faults)
            return
        for index in range(len(data)):
            if not self._heard:
                self._heard_s = start_s + index * byte_s
            self._heard += data[index : index + 1]
            for packet in self._framer.feed(data[index : index + 1]):
                if isinstance(packet, Noise):
                    self._noise(packet, byte_s)
                    continue
                heard = bytes(self._heard)
                self._heard.clear()
                end_s = start_s + (index + 1) * byte_s
                self._understand(packet, heard, end_s, byte_s, faults)

    def gap(self, byte_s: float) -> None:
        """Forget what is held: the pause was longer than a packet may have."""
        self._noise(self._framer.abort(), byte_s)

    def _understand(
        self,
        packet: InstructionPacket | StatusPacket | BadPacket,
        heard: bytes,
        end_s: float,
        byte_s: float,
        faults: Faults | None,
    ) -> None:
        """A packet, good or bad, whose bytes ``heard`` began at ``_heard_s`` and have ended."""
        if faults is not None and isinstance(packet, InstructionPacket):
            struck = faults.instruction(packet, heard, self._heard_s)
            if struck is not heard:
                self.hear(struck, self._heard_s, byte_s, None)
                return
        self._line.tell(WireEventKind.INSTRUCTION, self._heard_s, end_s, heard)
        self._line.take(packet, end_s)

    def _noise(self, noise: Noise | None, byte_s: float) -> None:
        if noise is not None:
            self._line.counts.noise_bytes += len(noise.data)
            end_s = self._heard_s + len(noise.data) * byte_s
            self._line.tell(WireEventKind.NOISE, self._heard_s, end_s, noise.data)
            self._heard_s = end_s
            del self._heard[: len(noise.data)]
