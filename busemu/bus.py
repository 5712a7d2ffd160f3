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

import math
from collections.abc import Callable, Sequence
from functools import partial

from . import usb2ax
from .agenda import Agenda, Event
from .faults import Faults
from .group import GroupRead, group_read, group_writes, superpose
from .hearing import Hearing
from .plant import Plant
from .protocol import (
    BROADCAST_ID,
    BadPacket,
    Instruction,
    InstructionPacket,
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
        self.faults: Faults | None = None  #: set by the first fault that is asked for
        self.baud_rate = baud_rate
        self.plant_s = start_s  #: the instant up to which the plant has been advanced
        self._start_s = start_s
        self.hearing = Hearing(self, protocol, start_s)
        self._frame = v1.status_frame if protocol == 1.0 else v2.status_frame
        self.agenda = Agenda()
        self.uplink = Uplink(profile)
        self._out_free_s = start_s  #: when the adapter can begin with the next packet
        self._last_byte_s = start_s  #: end of the last byte that a servo's receiver has seen
        self._out_start_s = start_s  #: when the host's last unbroken run begins on the wire
        self._reply_s = (start_s, start_s)  #: when the last reply begins and ends on the wire
        for index, servo in enumerate(self.servos):
            turn_s = start_s + HOUSEKEEPING_S * index / len(self.servos)
            self.agenda.every(turn_s, HOUSEKEEPING_S, servo.tick)

    # -- the caller's three calls --------------------------------------------------------------

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes that the program handed to the driver at ``now_s``."""
        byte_s = self.profile.byte_s(self.baud_rate)
        start_s = max(now_s, self._out_free_s) + self.profile.out_s()
        if now_s > self._out_free_s:
            self._out_start_s = start_s
        self._out_free_s = start_s + len(data) * byte_s
        if start_s - self._last_byte_s > INTERBYTE_TIMEOUT_S[self.protocol]:
            self.hearing.gap(byte_s)
        self._last_byte_s = self._out_free_s
        if self.profile.echo:
            self.uplink.carry(data, start_s, byte_s)
        if start_s < self._reply_s[1] and self._reply_s[0] < self._out_free_s:
            self.counts.errors += 1
            self.tell(WireEventKind.COLLISION, start_s, self._out_free_s, data)
            return
        self.hearing.hear(data, start_s, byte_s, self.faults)

    def next_deadline_s(self) -> float:
        """When something happens next: an event on the bus, or bytes for the host [s]."""
        event_s = self.agenda.next_s()
        ready_s = self.uplink.next_deadline_s()
        return event_s if ready_s is None else min(event_s, ready_s)

    def next_reply_s(self) -> float | None:
        """When the host has the next bytes, as far as that is known already [s]."""
        return self.uplink.next_deadline_s()

    @property
    def line_free_s(self) -> float:
        """When the last byte that the host has sent so far is over on the wire [s]."""
        return self._out_free_s

    def poll(self, now_s: float) -> bytes:
        """Let everything happen that is due by ``now_s``; the bytes the host has by then."""
        while (due := self.agenda.take(now_s)) is not None:
            at_s, event = due
            self.advance_plant(at_s)
            event(at_s)
        return self.deliver(now_s)

    def deliver(self, now_s: float) -> bytes:
        """Only the bytes the host has by ``now_s`` of what has already happened.

        For a caller in a hurry: nothing else is done first, as :meth:`poll` would.
        """
        return self.uplink.poll(now_s)

    def advance_plant(self, to_s: float) -> None:
        """Simulate the joints up to ``to_s``; an instant in the past changes nothing."""
        if to_s > self.plant_s:
            self.plant.advance(to_s - self._start_s)
            self.plant_s = to_s

    def every(self, period_s: float, event: Event) -> None:
        """Call ``event`` with the instant [s], at once and then every ``period_s`` of bus time."""
        self.agenda.every(self.plant_s, period_s, event)

    # -- packets -------------------------------------------------------------------------------

    def take(self, packet: InstructionPacket | StatusPacket | BadPacket, end_s: float) -> None:
        """A packet, good or bad, whose last bit was over at ``end_s``."""
        latch_s = end_s if self.profile.instant else end_s + self.profile.turnaround_s
        if isinstance(packet, BadPacket):
            self.counts.errors += 1
            self.schedule(latch_s, partial(self._refuse, packet, end_s))
        elif isinstance(packet, InstructionPacket):
            self.counts.transactions += 1
            if self.protocol == 1.0 and usb2ax.answers(packet, self.profile):
                self.schedule(end_s, usb2ax.SyncRead(self, packet.parameters))
                return
            self.schedule(latch_s, partial(self._execute, packet, end_s))

    def _hears(self, servo: Servo, now_s: float) -> bool:
        """Whether a servo can read the host's bytes: awake, and at its baud rate."""
        return servo.listens(now_s) and (
            self.baud_rate == servo.baud_rate
            or abs(self.baud_rate / servo.baud_rate - 1.0) <= BAUD_TOLERANCE
        )

    def _listening(self, now_s: float) -> list[Servo]:
        return [servo for servo in self.servos if self._hears(servo, now_s)]

    def addressed(self, servo_id: int, now_s: float) -> list[Servo]:
        """The servos of one ID, of those that hear: one, none, or several by mistake."""
        return [s for s in self.servos if s.servo_id == servo_id and self._hears(s, now_s)]

    def _refuse(self, packet: BadPacket, end_s: float, now_s: float) -> None:
        if self.faults is not None:
            self.faults.begin(None)
        self._answer(
            [
                (servo.return_delay_s, servo.status(Refusal.CHECKSUM))
                for servo in self.addressed(packet.servo_id, now_s)
                if servo.answers(Instruction.WRITE)
            ],
            end_s,
        )

    def _execute(self, packet: InstructionPacket, end_s: float, now_s: float) -> None:
        if self.faults is not None:
            self.faults.begin(packet)
        if packet.servo_id != BROADCAST_ID:
            self._single(packet, end_s, now_s)
            return
        writes = group_writes(packet, self.protocol)
        reads = group_read(packet, self.protocol)
        if writes is not None:
            wanted = {servo_id: (address, data) for servo_id, address, data in writes}
            for servo in self._listening(now_s):
                write = wanted.get(servo.servo_id)
                if write is not None and servo.write(*write) is not None:
                    self.counts.errors += 1
        elif reads is not None and reads.fast:
            self._fast(reads, end_s, now_s)
        elif reads is not None:
            done = 0
            if self.profile.instant and self.faults is None:
                done = self._chain_at_once(reads, end_s, now_s)
            self._chain(reads, done, end_s, now_s)
        elif packet.instruction != Instruction.PING:
            for servo in self._listening(now_s):
                servo.execute(BROADCAST_ID, packet.instruction, packet.parameters, now_s)
        elif self.protocol == 2.0:
            ids = sorted({servo.servo_id for servo in self._listening(now_s)})
            self._introduce(ids, end_s, end_s, now_s)

    def _introduce(self, ids: list[int], asked_s: float, before_s: float, now_s: float) -> None:
        """The next reply to a broadcast ping: in the slot of its ID, and after the one before."""
        if not ids:
            return
        slot_s = max(before_s, asked_s + ids[0] * self.profile.ping_slot_s)
        if now_s < slot_s:
            self.schedule(slot_s, partial(self._introduce, ids, asked_s, before_s))
            return
        replies = [
            (servo.return_delay_s, servo.status(None, servo.identity()))
            for servo in self.addressed(ids[0], now_s)
        ]
        end_s = self._answer(replies, slot_s)
        self.schedule(max(now_s, end_s), partial(self._introduce, ids[1:], asked_s, end_s))

    def _single(self, packet: InstructionPacket, end_s: float, now_s: float) -> None:
        addressed = self.addressed(packet.servo_id, now_s)
        if not addressed:
            self.counts.errors += 1
        replies: list[tuple[float, StatusPacket]] = []
        for servo in addressed:
            delay_s = servo.return_delay_s
            status = servo.execute(packet.servo_id, packet.instruction, packet.parameters, now_s)
            if status is not None:
                replies.append((delay_s, status))
        self._answer(replies, end_s)

    def _chain(self, reads: GroupRead, index: int, before_s: float, now_s: float) -> None:
        """The turn of one servo of a sync or bulk read; a mute one silences all after it."""
        if index == len(reads.items):
            return
        servo_id, address, length = reads.items[index]
        replies: list[tuple[float, StatusPacket]] = []
        for servo in self.addressed(servo_id, now_s):
            if servo.supports(reads.instruction) and servo.answers(Instruction.READ):
                refusal, data = servo.read(address, length)
                replies.append((servo.return_delay_s, servo.status(refusal, data)))
        if not replies:
            self.counts.errors += 1
            return
        end_s = self._answer(replies, before_s, chained=index > 0)
        if self.faults is not None and self.faults.silent:
            self.counts.errors += 1
            return
        turn_s = end_s if self.profile.instant else end_s + self.profile.turnaround_s
        self.schedule(turn_s, partial(self._chain, reads, index + 1, end_s))

    def _chain_at_once(self, reads: GroupRead, at_s: float, now_s: float) -> int:
        """The turns up to the first odd one, where none takes time, as one run; how many."""
        by_id: dict[int, list[Servo]] = {}
        for servo in self.servos:
            by_id.setdefault(servo.servo_id, []).append(servo)
        frames: list[bytes] = []
        for servo_id, address, length in reads.items:
            found = by_id.get(servo_id, ())
            if len(found) != 1 or not self._hears(found[0], now_s):
                break
            servo = found[0]
            if not servo.supports(reads.instruction) or not servo.answers(Instruction.READ):
                break
            refusal, data = servo.read(address, length)
            error = servo.error(refusal)
            self.counts.errors += bool(error & 0x7F)
            frames.append(self._frame(servo_id, error, data))
        if frames:
            self.counts.replies += len(frames)
            for frame in frames:
                self.tell(WireEventKind.STATUS, at_s, at_s, frame)
            self._reply_s, self._last_byte_s = (at_s, at_s), max(self._last_byte_s, at_s)
            self.uplink.carry(b"".join(frames), at_s, 0.0)
        return len(frames)

    def _fast(self, reads: GroupRead, asked_s: float, now_s: float) -> None:
        """A fast read: one packet that the servos send in turn, each its own block, without a gap.

        As there is no gap, each looks at its registers when the instruction has come (assumed). A
        mute servo silences those after it, so the packet breaks off. A refused read sends zeros.
        One that asks for more than a packet holds is nobody's (assumed).
        """
        byte_s = self.profile.byte_s(self.baud_rate)
        blocks: list[tuple[int, int, bytes]] = []
        delay_s = 0.0
        if reads.fast_length > v2.MAX_LENGTH:
            self.counts.errors += 1
            return
        for servo_id, address, length in reads.items:
            servo = next(iter(self.addressed(servo_id, now_s)), None)
            able = servo is not None and servo.supports(reads.instruction)
            if servo is None or not able or not servo.answers(Instruction.READ):
                self.counts.errors += 1
                break
            refusal, data = servo.read(address, length)
            error = servo.status(refusal).error
            delay_s = delay_s if blocks else servo.return_delay_s
            blocks.append((servo_id, error, data if refusal is None else bytes(length)))
            self.counts.replies += 1
            self.counts.errors += bool(error & 0x7F)
        if blocks:
            mute = [(0, 0, bytes(item[2])) for item in reads.items[len(blocks) :]]
            slices = v2.fast_status_slices([*blocks, *mute])[: len(blocks)]
            start_s = asked_s + self.profile.reply_s(delay_s)
            runs = [(start_s, b"".join(slices))]
            if self.faults is not None:
                ids = [servo_id for servo_id, _, _ in blocks]
                runs = self.faults.reply(ids, slices, start_s, byte_s)
            for start_s, data in runs:
                self._carry(start_s, data, byte_s, collided=False)

    def _answer(
        self,
        replies: Sequence[tuple[float, StatusPacket]],
        after_s: float,
        *,
        chained: bool = False,
    ) -> float:
        """Put the replies to one instruction on the wire; returns when the last byte ends [s].

        Each is a return delay [s] and a status packet. Several come from servos with one ID.
        """
        byte_s = self.profile.byte_s(self.baud_rate)
        runs = []
        for delay_s, status in replies:
            self.counts.replies += 1
            self.counts.errors += bool(status.error & 0x7F)
            start_s = after_s + self.profile.reply_s(delay_s, chained=chained)
            run = (start_s, self._frame(status.servo_id, status.error, status.parameters))
            if self.faults is None:
                runs.append(run)
            else:
                runs += self.faults.reply([status.servo_id], [run[1]], start_s, byte_s)
        end_s = after_s
        for start_s, data, collided in superpose(runs, byte_s):
            end_s = start_s + len(data) * byte_s
            self._carry(start_s, data, byte_s, collided)
        return end_s

    def _carry(self, start_s: float, data: bytes, byte_s: float, collided: bool) -> None:
        """Bring a reply to the host, as far as the line and the adapter are free for it."""
        if self.faults is not None and self.faults.late_s <= start_s > self.plant_s:
            self.schedule(start_s, lambda _: self._carry(start_s, data, byte_s, collided))
            return
        end_s = start_s + len(data) * byte_s
        free_s = start_s
        if self._reply_s[0] < end_s:
            free_s = self._reply_s[1]
        if self._out_start_s <= start_s:
            free_s = max(free_s, self._out_free_s)  # an adapter that sends does not listen
        lost = max(0, math.ceil((free_s - start_s) / byte_s - 1e-6)) if byte_s else 0
        collided = collided or lost > 0
        self.counts.errors += collided
        kind = WireEventKind.COLLISION if collided else WireEventKind.STATUS
        self.tell(kind, start_s, end_s, data)
        self._reply_s = max(self._reply_s, (start_s, end_s))
        self._last_byte_s = max(self._last_byte_s, end_s)
        if data[lost:]:
            self.uplink.carry(data[lost:], start_s + lost * byte_s, byte_s)

    # -- the rest ------------------------------------------------------------------------------

    def schedule(self, at_s: float, event: Event) -> None:
        """Have ``event`` called with the instant ``at_s`` [s], once the plant is there."""
        self.agenda.put(at_s, event)

    def hand_up(self, data: bytes, at_s: float) -> None:
        """Give the host bytes that the adapter made itself at ``at_s``; it was busy until then."""
        self.counts.replies += 1
        self._out_free_s = max(self._out_free_s, at_s)
        self.uplink.carry(data, at_s, 0.0)

    def tell(self, kind: WireEventKind, start_s: float, end_s: float, data: bytes) -> None:
        """Say that the wire carries bytes from ``start_s`` to ``end_s``."""
        if self.on_wire is not None:
            self.on_wire(WireEvent(kind, start_s, end_s, data))
