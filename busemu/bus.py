"""A half-duplex bus of servos: host bytes in, reply bytes out, each at its modelled time.

Sans-IO. The caller owns the clock and the port, and does three things::

    bus.receive(data, now_s)      # the host's driver got these bytes from the program
    bus.next_deadline_s()         # when something happens next
    bus.poll(now_s) -> bytes      # the bytes that the host has by now

Everything between is a queue of events at modelled instants: a packet ends on the wire, a servo
looks at its registers, a reply is over and the next servo of a sync read has its turn. Before each
event the plant is advanced to exactly its instant.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from functools import partial

from .group import GroupRead, group_read, group_writes
from .plant import Plant
from .protocol import (
    BROADCAST_ID,
    BadPacket,
    Framer,
    Instruction,
    InstructionPacket,
    Noise,
    StatusPacket,
    v1,
    v2,
)
from .servo import Refusal, Servo
from .timing import INTERBYTE_TIMEOUT_S, Profile, Uplink
from .trace import BusCounts, WireEvent, WireEventKind

#: A servo does its housekeeping once in this time [s]; servos take turns. Assumed.
HOUSEKEEPING_S = 0.010
#: Largest difference of baud rates that still lets a frame of ten bits through. Source: UART, half
#: a bit in ten at most, shared by both sides.
BAUD_TOLERANCE = 0.03

Event = Callable[[float], object]


class Bus:
    """Servos of one protocol on one line, behind one host with the times of a profile.

    ``start_s`` is the bus's clock when the plant's time is zero. ``on_wire`` is told of every run
    of bytes on the wire when its time is known.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        plant: Plant,
        profile: Profile,
        *,
        protocol: float,
        baud_rate: int,
        start_s: float = 0.0,
        on_wire: Callable[[WireEvent], None] | None = None,
    ) -> None:
        self.servos = tuple(servos)
        self.plant = plant
        self.profile = profile
        self.protocol = protocol
        self.counts = BusCounts()
        self.on_wire = on_wire
        self.baud_rate = baud_rate
        self.plant_s = start_s  #: the instant up to which the plant has been advanced
        self._start_s = start_s
        self._framer = Framer(protocol)
        self._encode = v1.encode_status if protocol == 1.0 else v2.encode_status
        self._events: list[tuple[float, int, Event]] = []
        self._order = itertools.count()
        self._uplink = Uplink(profile)
        self._out_free_s = start_s  #: when the adapter can begin with the next packet
        self._last_byte_s = start_s  #: end of the last byte that a servo's receiver has seen
        self._reply: tuple[float, float, bytes] | None = None  #: the reply last put on the wire
        for index, servo in enumerate(self.servos):
            self._schedule(
                start_s + HOUSEKEEPING_S * index / len(self.servos),
                partial(self._keep_house, servo),
            )

    # -- the caller's three calls --------------------------------------------------------------

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes that the program handed to the driver at ``now_s``."""
        byte_s = self.profile.byte_s(self.baud_rate)
        start_s = max(now_s, self._out_free_s) + self.profile.out_s()
        self._out_free_s = start_s + len(data) * byte_s
        if start_s - self._last_byte_s > INTERBYTE_TIMEOUT_S[self.protocol]:
            self._noise(self._framer.abort())
        self._last_byte_s = self._out_free_s
        if self._reply is not None and start_s < self._reply[1]:
            self.counts.errors += 1
            self._tell(WireEventKind.COLLISION, start_s, self._out_free_s, data)
            return
        begun_s = start_s
        run = bytearray()
        for index in range(len(data)):
            run += data[index : index + 1]
            for packet in self._framer.feed(data[index : index + 1]):
                end_s = start_s + (index + 1) * byte_s
                if isinstance(packet, Noise):
                    self._noise(packet)
                    continue
                self._tell(WireEventKind.INSTRUCTION, begun_s, end_s, bytes(run))
                begun_s = end_s
                run.clear()
                self._take(packet, end_s)

    def next_deadline_s(self) -> float:
        """When something happens next: an event on the bus, or bytes for the host [s]."""
        event_s = self._events[0][0]
        ready_s = self._uplink.next_deadline_s()
        return event_s if ready_s is None else min(event_s, ready_s)

    def next_reply_s(self) -> float | None:
        """When the host has the next bytes, as far as that is known already [s]."""
        return self._uplink.next_deadline_s()

    @property
    def line_free_s(self) -> float:
        """When the last byte that the host has sent so far is over on the wire [s]."""
        return self._out_free_s

    def poll(self, now_s: float) -> bytes:
        """Let everything happen that is due by ``now_s``; the bytes the host has by then."""
        while self._events[0][0] <= now_s:
            at_s, _, event = heapq.heappop(self._events)
            self.advance_plant(at_s)
            event(at_s)
        return self._uplink.poll(now_s)

    def advance_plant(self, to_s: float) -> None:
        """Simulate the joints up to ``to_s``; an instant in the past changes nothing."""
        if to_s > self.plant_s:
            self.plant.advance(to_s - self._start_s)
            self.plant_s = to_s

    def every(self, period_s: float, event: Event) -> None:
        """Call ``event`` with the instant [s], at once and then every ``period_s`` of bus time."""

        def recur(now_s: float) -> None:
            event(now_s)
            self._schedule(now_s + period_s, recur)

        self._schedule(self.plant_s, recur)

    # -- packets -------------------------------------------------------------------------------

    def _take(self, packet: InstructionPacket | StatusPacket | BadPacket, end_s: float) -> None:
        latch_s = end_s if self.profile.instant else end_s + self.profile.turnaround_s
        if isinstance(packet, BadPacket):
            self.counts.errors += 1
            self._schedule(latch_s, partial(self._refuse, packet, end_s))
        elif isinstance(packet, InstructionPacket):
            self.counts.transactions += 1
            self._schedule(latch_s, partial(self._execute, packet, end_s))

    def _listening(self, now_s: float) -> list[Servo]:
        """Servos that can read the host's bytes: awake, and at its baud rate."""
        return [
            servo
            for servo in self.servos
            if servo.listens(now_s)
            and abs(self.baud_rate / servo.baud_rate - 1.0) <= BAUD_TOLERANCE
        ]

    def _refuse(self, packet: BadPacket, end_s: float, now_s: float) -> None:
        for servo in self._listening(now_s):
            if servo.servo_id == packet.servo_id and servo.answers(Instruction.WRITE):
                self._answer(servo, servo.status(Refusal.CHECKSUM), end_s)

    def _execute(self, packet: InstructionPacket, end_s: float, now_s: float) -> None:
        servos = self._listening(now_s)
        writes = group_writes(packet, self.protocol)
        reads = group_read(packet, self.protocol)
        if writes is not None:
            wanted = {servo_id: (address, data) for servo_id, address, data in writes}
            for servo in servos:
                write = wanted.get(servo.servo_id)
                if write is not None and servo.write(*write) is not None:
                    self.counts.errors += 1
        elif reads is not None:
            self._chain(reads, 0, end_s, now_s)
        elif packet.servo_id != BROADCAST_ID:
            self._single(packet, servos, now_s, end_s)
        elif packet.instruction != Instruction.PING:
            for servo in servos:
                servo.execute(BROADCAST_ID, packet.instruction, packet.parameters, now_s)
        elif self.protocol == 2.0:
            for servo in sorted(servos, key=lambda s: s.servo_id):
                slot_s = end_s + servo.servo_id * self.profile.ping_slot_s
                self._schedule(max(now_s, slot_s), partial(self._answer_ping, servo, slot_s))

    def _answer_ping(self, servo: Servo, slot_s: float, now_s: float) -> None:
        self._answer(servo, servo.status(None, servo.identity()), slot_s)

    def _single(
        self, packet: InstructionPacket, servos: list[Servo], now_s: float, end_s: float
    ) -> None:
        addressed = [servo for servo in servos if servo.servo_id == packet.servo_id]
        if not addressed:
            self.counts.errors += 1
        for servo in addressed:
            delay_s = servo.return_delay_s
            status = servo.execute(packet.servo_id, packet.instruction, packet.parameters, now_s)
            if status is not None:
                self._answer(servo, status, end_s, delay_s=delay_s)

    def _chain(self, reads: GroupRead, index: int, before_s: float, now_s: float) -> None:
        """The turn of one servo of a sync or bulk read; a mute one silences all after it."""
        if index == len(reads.items):
            return
        servo_id, address, length = reads.items[index]
        for servo in self._listening(now_s):
            if servo.servo_id == servo_id and servo.answers(reads.instruction):
                refusal, data = servo.read(address, length)
                end_s = self._answer(
                    servo, servo.status(refusal, data), before_s, chained=index > 0
                )
                turn_s = end_s if self.profile.instant else end_s + self.profile.turnaround_s
                self._schedule(turn_s, partial(self._chain, reads, index + 1, end_s))
                return
        self.counts.errors += 1

    def _answer(
        self,
        servo: Servo,
        status: StatusPacket,
        after_s: float,
        *,
        chained: bool = False,
        delay_s: float | None = None,
    ) -> float:
        """Put a status packet on the wire; returns when its last byte ends [s]."""
        data = self._encode(status)
        byte_s = self.profile.byte_s(self.baud_rate)
        if delay_s is None:
            delay_s = servo.return_delay_s
        start_s = after_s + self.profile.reply_s(delay_s, chained=chained)
        end_s = start_s + len(data) * byte_s
        self.counts.replies += 1
        if status.error & 0x7F:
            self.counts.errors += 1
        kind = WireEventKind.STATUS
        if self._reply is not None and start_s < self._reply[1]:
            # Two servos drive the line at once, as with one ID given twice: nobody can read that.
            kind = WireEventKind.COLLISION
            self.counts.errors += 1
            data = bytes(0 if index % 2 else value for index, value in enumerate(data))
            start_s = self._reply[1]
        self._reply = (start_s, end_s, data)
        self._last_byte_s = max(self._last_byte_s, end_s)
        self._tell(kind, start_s, end_s, data)
        self._uplink.carry(data, start_s, byte_s)
        return end_s

    def _keep_house(self, servo: Servo, now_s: float) -> None:
        self.every(HOUSEKEEPING_S, servo.tick)

    # -- the rest ------------------------------------------------------------------------------

    def _schedule(self, at_s: float, event: Event) -> None:
        heapq.heappush(self._events, (at_s, next(self._order), event))

    def _noise(self, noise: Noise | None) -> None:
        if noise is not None:
            self.counts.noise_bytes += len(noise.data)
            if self.on_wire is not None:
                self._tell(WireEventKind.NOISE, self._last_byte_s, self._last_byte_s, noise.data)

    def _tell(self, kind: WireEventKind, start_s: float, end_s: float, data: bytes) -> None:
        if self.on_wire is not None:
            self.on_wire(WireEvent(kind, start_s, end_s, data))
