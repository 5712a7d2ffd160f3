"""The sync read that a USB2AX adapter carries out itself (Protocol 1.0, instruction 0x84).

The adapter keeps the packet to itself and reads the servos one by one. It then hands up one status
packet from its own ID with the data of all, in the order asked, and FF in place of what it did not
get in time. Source: the adapter's firmware, Xevel/usb2ax, `AX.c` and `USB2AX.c`. The packet takes
here as long to reach the adapter as it would on the wire (assumed), and shows in a trace.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from .group import GroupRead, superpose
from .protocol import (
    BROADCAST_ID,
    ErrorBit1,
    Instruction,
    InstructionPacket,
    StatusPacket,
    checksum,
    v1,
)
from .servo import Servo
from .timing import Profile
from .trace import WireEventKind

#: The adapter's own ID. Source: its firmware.
ADAPTER_ID = 0xFD
#: So many bytes of each servo at most, and a packet of so many parameters. Source: its firmware.
MAX_DATA, MAX_PARAMETERS = 6, 32
#: Bytes of a status packet besides its data.
STATUS_BYTES = 6


class Line(Protocol):
    """What the adapter asks of the bus behind it; instants are those of the bus's clock [s]."""

    profile: Profile
    baud_rate: int

    def addressed(self, servo_id: int, now_s: float) -> list[Servo]: ...  # noqa: D102
    def schedule(self, at_s: float, event: Callable[[float], object]) -> None: ...  # noqa: D102
    def tell(  # noqa: D102
        self, kind: WireEventKind, start_s: float, end_s: float, data: bytes
    ) -> None: ...
    def hand_up(self, data: bytes, at_s: float) -> None: ...  # noqa: D102


def asked(packet: InstructionPacket) -> GroupRead | None:
    """What a packet asks of such an adapter; ``None`` where it is nothing for it."""
    parameters = packet.parameters
    if (
        packet.instruction != Instruction.USB2AX_SYNC_READ
        or packet.servo_id not in (ADAPTER_ID, BROADCAST_ID)
        or len(parameters) > MAX_PARAMETERS
    ):
        return None
    address, size = parameters[:2] if len(parameters) > 1 else (0, 0)
    items = tuple((servo_id, address, size) for servo_id in parameters[2:])
    return GroupRead(packet.instruction, items)


def answered(read: GroupRead, status: StatusPacket) -> list[tuple[int, bytes]]:
    """Servo IDs and data that the adapter hands up; no data of servos that it did not hear.

    Empty where the status packet is no answer to ``read``. The adapter puts FF in place of what is
    missing; so a register whose bytes are all FF cannot be told from a servo that is silent.
    """
    data, size = status.parameters, read.items[0][2] if read.items else 0
    if status.servo_id != ADAPTER_ID:
        return []
    if status.error and not data:
        data = b"\xff" * size * len(read.items)
    if len(data) != size * len(read.items):
        return []
    parts = (data[at : at + size] for at in range(0, len(data), size or 1))
    return [
        (item[0], b"" if part == b"\xff" * size else part)
        for item, part in zip(read.items, parts, strict=True)
    ]


def answers(packet: InstructionPacket, profile: Profile) -> bool:
    """Whether the adapter takes the packet for itself."""
    return profile.usb2ax_timeout_s > 0.0 and asked(packet) is not None


class SyncRead:
    """One sync read of the adapter: begins when it is called, goes on by the bus's events."""

    def __init__(self, line: Line, parameters: bytes) -> None:
        """``parameters``: address, bytes of each, IDs."""
        self._line = line
        self._address = parameters[0] if parameters else 0
        self._size = parameters[1] if len(parameters) > 1 else 0
        self._ids = parameters[2:]
        self._data = bytearray()
        self._asked = 0

    def __call__(self, now_s: float) -> None:
        """Ask the next servo, or hand up what there is."""
        line = self._line
        if not 0 < self._size <= MAX_DATA:
            self._hand_up(now_s, ErrorBit1.RANGE)
            return
        if self._asked == len(self._ids):
            self._hand_up(now_s, ErrorBit1(0))
            return
        servo_id = self._ids[self._asked]
        self._asked += 1
        request = InstructionPacket(servo_id, Instruction.READ, bytes((self._address, self._size)))
        if servo_id > BROADCAST_ID:
            self._take(b"")
            line.schedule(now_s + line.profile.usb2ax_timeout_s, self)
            return
        data = v1.encode_instruction(request)
        end_s = now_s + len(data) * line.profile.byte_s(line.baud_rate)
        line.tell(WireEventKind.INSTRUCTION, now_s, end_s, data)

        def latch(at_s: float) -> None:
            line.schedule(self._collect(self._replies(request, at_s), end_s), self)

        line.schedule(end_s + line.profile.turnaround_s, latch)

    def _replies(
        self, request: InstructionPacket, now_s: float
    ) -> list[tuple[float, StatusPacket]]:
        """The servos' return delays [s] and replies; silence is an empty list."""
        replies = []
        for servo in self._line.addressed(request.servo_id, now_s):
            delay_s = servo.return_delay_s
            status = servo.execute(request.servo_id, request.instruction, request.parameters, now_s)
            if status is not None:
                replies.append((delay_s, status))
        return replies

    def _collect(self, replies: Sequence[tuple[float, StatusPacket]], asked_s: float) -> float:
        """Take the data out of what the line carries; returns when the adapter goes on [s]."""
        line = self._line
        byte_s = line.profile.byte_s(line.baud_rate)
        limit_s = asked_s + line.profile.usb2ax_timeout_s
        runs = [
            (asked_s + line.profile.reply_s(delay_s), v1.encode_status(status))
            for delay_s, status in replies
        ]
        whole, over_s = b"", limit_s
        for start_s, data, collided in superpose(runs, byte_s):
            end_s = start_s + len(data) * byte_s
            kind = WireEventKind.COLLISION if collided else WireEventKind.STATUS
            line.tell(kind, start_s, end_s, data)
            sound = checksum(data[2:-1]) == data[-1]
            if sound and len(data) == STATUS_BYTES + self._size and end_s <= limit_s:
                whole, over_s = data, end_s
        self._take(whole)
        return over_s

    def _take(self, frame: bytes) -> None:
        self._data += frame[5:-1] if frame else b"\xff" * self._size

    def _hand_up(self, now_s: float, error: ErrorBit1) -> None:
        status = StatusPacket(ADAPTER_ID, int(error), bytes(self._data))
        self._line.hand_up(v1.encode_status(status), now_s)
