"""From bytes on a bus with their times to accesses of registers, whoever sent them.

Sans-IO: :meth:`WireDecoder.sent` takes what the host sent, :meth:`WireDecoder.received` what it
got, both with times of one clock, live from a tap or from a stored trace. How the bytes are cut
into portions does not matter, except that a packet has the time of the portion it ends in.

**What becomes a row.** A *write* as the host sends it, whatever a servo answers: the recording
tells what the program did. ``reg_write`` waits for its ``action``. A broadcast write is one row for
each servo of the robot. A *read*, single or of many servos (sync, bulk and, in Protocol 2.0, their
fast kinds), as its status packet comes, and with NaN if none came, or one without the value.

**Which status belongs to which read.** Servos answer in the order they were asked, so a status
packet answers the first open read of its sender that has its length, and those passed over are
lost. A host that sends again has given up on what it waited for, unless it did so within
``PIPELINE_S``; until then a late reply counts, even if the host had stopped listening. An adapter
that hears itself gives instructions back, which are known and left out.

**Registers.** Bytes are cut into registers by :mod:`bench.wire_registers`, which also says what
becomes of bytes that are none.

**USB2AX.** The sync read that this adapter carries out by itself is a read of many servos, all of
them answered when its one status packet comes. What it did not get it fills with FF, and that is
taken for lost here.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from busemu import usb2ax
from busemu.group import GroupRead, group_read, group_writes
from busemu.protocol import (
    BROADCAST_ID,
    BadPacket,
    Framer,
    Instruction,
    InstructionPacket,
    Noise,
    StatusPacket,
    split_fast_status,
    v2,
)
from busemu.tables import ControlTable
from hal.access import Access

from .wire_registers import WireRegisters

#: A host that sends again so soon [s] has not given up on the reply it waits for. Assumed: every
#: client known waits for many milliseconds at least.
PIPELINE_S = 0.002
#: A pause that ends a packet, in either direction [s]. Source: e-manual, Protocol 1.0; 2.0 allows
#: servos less, but an adapter's own pauses come on top.
PAUSE_S = 0.1

_FORGETS = (Instruction.REBOOT, Instruction.FACTORY_RESET)


@dataclass(slots=True)
class WireCounts:
    """What has passed so far."""

    instructions: int = 0
    statuses: int = 0
    rows: int = 0
    lost: int = 0  #: values asked for that did not come
    damaged: int = 0  #: packets with a wrong checksum or CRC
    noise_bytes: int = 0


@dataclass(slots=True)
class _OpenRead:
    """A read whose answers are still to come: what is left of it, in order of replies."""

    t_s: float
    items: deque[tuple[int, int, int]]  #: servo ID, address, length
    instruction: int = Instruction.READ
    behind: list[Access] = field(default_factory=list)  #: what was written after it


class WireDecoder:
    """Decodes one bus. ``tables`` are the control tables of its servos, by ID.

    ``on_access`` is told of every access when all is known of it, in the order of instructions.
    """

    def __init__(
        self,
        protocol: float,
        tables: Mapping[int, ControlTable],
        on_access: Callable[[Access], object],
    ) -> None:
        self.counts = WireCounts()
        self._protocol = protocol
        self._width = 1 if protocol == 1.0 else 2
        self._tables = tables
        self._on_access = on_access
        self._instructions = Framer(protocol, role="device")
        self._statuses = Framer(protocol, role="host")
        self._sent_s = self._received_s = -math.inf
        self._open: deque[_OpenRead] = deque()
        self._registered: dict[int, tuple[int, bytes]] = {}
        self._echo: InstructionPacket | None = None
        self._layout = WireRegisters(tables)

    def sent(self, data: bytes, t_s: float) -> None:
        """Bytes that had left the host at ``t_s`` [s]."""
        if t_s - self._sent_s > PAUSE_S:
            self._note_noise(self._instructions.abort())
        self._sent_s = t_s
        for packet in self._instructions.feed(data):
            if isinstance(packet, InstructionPacket):
                self.counts.instructions += 1
                self._begin(packet, t_s)
                self._instruction(packet, t_s)
            else:
                self._note_noise(packet)

    def received(self, data: bytes, t_s: float) -> None:
        """Bytes that had reached the host at ``t_s`` [s]."""
        if t_s - self._received_s > PAUSE_S:
            self._note_noise(self._statuses.abort())
        self._received_s = t_s
        for packet in self._statuses.feed(data):
            if isinstance(packet, StatusPacket):
                if not self._is_echo(packet):
                    self.counts.statuses += 1
                    self._status(packet, t_s)
            else:
                self._note_noise(packet)

    def finish(self) -> None:
        """Nothing more will come: what is still open is lost."""
        while self._open:
            self._close()

    def _note_noise(self, packet: object) -> None:
        if isinstance(packet, Noise):
            self.counts.noise_bytes += len(packet.data)
        elif isinstance(packet, BadPacket):
            self.counts.damaged += 1

    # -- instructions --------------------------------------------------------------------------

    def _begin(self, packet: InstructionPacket, t_s: float) -> None:
        """A new instruction: the host waits no longer for what it asked before."""
        while self._open and t_s - self._open[0].t_s >= PIPELINE_S:
            self._close()
        if not self._open:
            self._note_noise(self._statuses.abort())
        self._echo = packet if self._protocol == 1.0 else None

    def _instruction(self, packet: InstructionPacket, t_s: float) -> None:
        writes = group_writes(packet, self._protocol)
        reads = self._reads(packet)
        if writes is not None:
            for servo_id, address, data in writes:
                self._write(servo_id, address, data, t_s)
        elif reads is not None:
            items = deque(item for item in reads.items if 0 < item[2] <= v2.MAX_LENGTH)
            if items:
                self._open.append(_OpenRead(t_s, items, reads.instruction))
        else:
            self._single(packet, t_s)

    def _reads(self, packet: InstructionPacket) -> GroupRead | None:
        """What a read asks, in the order of the replies; ``None`` for any other instruction."""
        parameters, width = packet.parameters, self._width
        kind = packet.instruction
        if kind == Instruction.READ and packet.servo_id != BROADCAST_ID:
            if len(parameters) != 2 * width:
                return None
            address, length = _number(parameters[:width]), _number(parameters[width:])
            return GroupRead(kind, ((packet.servo_id, address, length),))
        if kind == Instruction.USB2AX_SYNC_READ and self._protocol == 1.0:
            return usb2ax.asked(packet)
        return group_read(packet, self._protocol)

    def _single(self, packet: InstructionPacket, t_s: float) -> None:
        kind, parameters = packet.instruction, packet.parameters
        everyone = packet.servo_id == BROADCAST_ID
        if kind in (Instruction.WRITE, Instruction.REG_WRITE):
            address, data = _number(parameters[: self._width]), parameters[self._width :]
            for servo_id in self._tables if everyone else (packet.servo_id,):
                if kind == Instruction.WRITE:
                    self._write(servo_id, address, data, t_s)
                elif data:
                    self._registered[servo_id] = (address, data)
        elif kind == Instruction.ACTION or kind in _FORGETS:
            for servo_id in tuple(self._registered) if everyone else (packet.servo_id,):
                registered = self._registered.pop(servo_id, None)
                if registered is not None and kind == Instruction.ACTION:
                    self._write(servo_id, *registered, t_s)

    def _write(self, servo_id: int, address: int, data: bytes, t_s: float) -> None:
        for row_id, name, first, size in self._layout(servo_id, address, len(data)):
            raw = _number(data[first : first + size])
            access = Access(t_s, math.nan, row_id, "write", name, float(raw))
            if self._open:
                self._open[-1].behind.append(access)
            else:
                self._tell(access)

    # -- status packets ------------------------------------------------------------------------

    def _is_echo(self, packet: StatusPacket) -> bool:
        """Whether it is the last instruction heard again; in Protocol 2.0 the packet says so."""
        echo = self._echo
        self._echo = None
        return echo is not None and (packet.servo_id, packet.error, packet.parameters) == (
            echo.servo_id,
            echo.instruction,
            echo.parameters,
        )

    def _status(self, packet: StatusPacket, t_s: float) -> None:
        for index, read in enumerate(self._open):
            blocks = _answers(read, packet)
            if not blocks:
                continue
            for _ in range(index):
                self._close()
            for servo_id, data in blocks:
                while read.items[0][0] != servo_id:
                    self._lose(read, read.items.popleft())
                item = read.items.popleft()
                if len(data) == item[2]:
                    self._read(read.t_s, t_s, item, data)
                else:
                    self._lose(read, item)
            if not read.items:
                self._close()
            return

    def _read(self, t_s: float, t_reply_s: float, item: tuple[int, int, int], data: bytes) -> None:
        for row_id, name, first, size in self._layout(*item):
            raw = _number(data[first : first + size])
            self._tell(Access(t_s, t_reply_s, row_id, "read", name, float(raw)))

    def _lose(self, read: _OpenRead, item: tuple[int, int, int]) -> None:
        self.counts.lost += 1
        for row_id, name, _, _ in self._layout(*item):
            self._tell(Access(read.t_s, math.nan, row_id, "read", name, math.nan))

    def _close(self) -> None:
        """Be done with the first open read: what has not come is lost."""
        read = self._open.popleft()
        for item in read.items:
            self._lose(read, item)
        for access in read.behind:
            self._tell(access)

    def _tell(self, access: Access) -> None:
        self.counts.rows += 1
        self._on_access(access)


def _answers(read: _OpenRead, packet: StatusPacket) -> list[tuple[int, bytes]]:
    """What a status packet brings of a read: servo IDs and data; empty if it does not answer it.

    A refusal brings no data. A packet with data of another length answers something else.
    """
    asked = GroupRead(read.instruction, tuple(read.items))
    if read.instruction == Instruction.USB2AX_SYNC_READ:
        return usb2ax.answered(asked, packet)
    if packet.servo_id == BROADCAST_ID:
        return _fast_answers(asked, packet) if asked.fast else []
    size = len(packet.parameters)
    for servo_id, _, length in () if asked.fast else asked.items:
        if servo_id == packet.servo_id and (size == length or (packet.error and not size)):
            return [(servo_id, packet.parameters)]
    return []


def _fast_answers(asked: GroupRead, packet: StatusPacket) -> list[tuple[int, bytes]]:
    try:
        blocks = split_fast_status(packet, [length for _, _, length in asked.items])
    except ValueError:
        return []
    if [block[0] for block in blocks] != [item[0] for item in asked.items]:
        return []
    return [(servo_id, data) for servo_id, _, data in blocks]


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")
