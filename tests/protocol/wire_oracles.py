"""The official SDK as an oracle: its packet handlers on a port that is only memory."""

from __future__ import annotations

from typing import Any

from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler

SDK1 = Protocol1PacketHandler()
SDK2 = Protocol2PacketHandler()


class MemoryPort:
    """What the SDK needs of a port; keeps what is written and gives what it was given to read."""

    def __init__(self, reply: bytes = b"") -> None:
        self.is_using = False
        self.written = b""
        self.unread = reply

    def clearPort(self) -> None:  # noqa: N802 - the SDK's names
        pass

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.written += bytes(packet)
        return len(packet)

    def readPort(self, length: int) -> list[int]:  # noqa: N802
        head, self.unread = self.unread[:length], self.unread[length:]
        return list(head)

    def setPacketTimeout(self, _length: int) -> None:  # noqa: N802
        pass

    def setPacketTimeoutMillis(self, _milliseconds: float) -> None:  # noqa: N802
        pass

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return not self.unread

    def getBaudRate(self) -> int:  # noqa: N802
        return 1_000_000


def sent(method: Any, *arguments: Any) -> bytes:
    """Return what an SDK method puts on the wire."""
    port = MemoryPort()
    method(port, *arguments)
    return port.written


def sdk_stuffed(packet: bytes) -> bytes:
    """Return the packet as the SDK stuffs it and checks it, with a CRC in the last two bytes."""
    stuffed = SDK2.addStuffing(list(packet))
    size = int.from_bytes(bytes(stuffed[5:7]), "little") + 7
    crc = SDK2.updateCRC(0, stuffed, size - 2)
    return bytes(stuffed[: size - 2]) + crc.to_bytes(2, "little")
