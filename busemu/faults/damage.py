"""What a fault does to the bytes of a packet."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from .fault import Fault, Kind


class Chance(Protocol):
    """A generator of random numbers that was seeded outside, such as ``random.Random``."""

    def random(self) -> float: ...  # noqa: D102
    def randrange(self, start: int, stop: int) -> int: ...  # noqa: D102
    def randbytes(self, n: int) -> bytes: ...  # noqa: D102


@dataclass(slots=True)
class Packet:
    """A packet on its way, and what has become of it so far."""

    data: bytearray
    noise: bytes = b""  #: before it
    shift_s: float = 0.0  #: so much later it begins
    hold_s: float = 0.0  #: so much later the host has it
    pauses: list[tuple[int, float]] = field(default_factory=list)  #: at byte, of [s]

    def on_wire(self) -> bytes:
        """What is on the wire."""
        return self.noise + bytes(self.data)

    def runs(self, start_s: float, byte_s: float) -> list[tuple[float, bytes]]:
        """Unbroken runs of bytes, each with its start [s]."""
        data, found = self.on_wire(), []
        start_s += self.shift_s
        at = 0
        for index, pause_s in sorted(self.pauses):
            cut = len(self.noise) + index
            if at < cut < len(data):
                found.append((start_s, data[at:cut]))
                start_s += (cut - at) * byte_s + pause_s
                at = cut
        if data[at:]:
            found.append((start_s, data[at:]))
        return found


def damage(packet: Packet, fault: Fault, chance: Chance, start: int, end: int) -> str:
    """Let ``fault`` strike; the part of the packet meant is ``start`` to ``end``.

    Returns what was done, in words.
    """
    data = packet.data
    end = min(end, len(data))
    words = ""
    if fault.kind is Kind.DROP:
        del data[start:]
    elif fault.kind is Kind.CORRUPT:
        places = [
            divmod(chance.randrange(8 * start, 8 * end), 8)
            for _ in range(fault.bits)
            if start < end
        ]
        for index, bit in places:
            data[index] ^= 1 << bit
        words = ", ".join(f"bit {bit} of byte {index}" for index, bit in places[:4])
        words += " ..." if len(places) > 4 else ""
    elif fault.kind is Kind.TRUNCATE:
        size = fault.size
        if size is None:
            size = chance.randrange(1, end - start) if end - start > 1 else 0
        lost = len(data) - min(len(data), start + size)
        del data[start + size :]
        words = f"the last {lost} bytes are missing"
    elif fault.kind is Kind.SPLIT:
        if end - start > 1:
            index = chance.randrange(start + 1, end)
            packet.pauses.append((index, fault.gap_s))
            words = f"a pause of {fault.gap_s * 1e3:g} ms before byte {index}"
    elif fault.kind is Kind.DUPLICATE:
        data += bytes(data)
    elif fault.kind is Kind.NOISE:
        packet.noise += chance.randbytes(fault.size or 0)
        words = f"{fault.size} bytes before it: {packet.noise[:8].hex(' ').upper()}"
    elif fault.kind is Kind.DELAY:
        packet.shift_s += fault.delay_s
        words = f"{fault.delay_s * 1e3:g} ms late on the wire"
    elif fault.kind is Kind.LATENCY:
        packet.hold_s += fault.delay_s
        words = f"{fault.delay_s * 1e3:g} ms late at the host"
    return words
