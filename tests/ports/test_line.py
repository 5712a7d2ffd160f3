"""A bus on a real line, in virtual time: only what servos do takes time in the model."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import pytest

from busemu.assemble import assemble
from busemu.plant import ideal
from busemu.ports.line import ADAPTER_S, UartLine, servo_side
from busemu.protocol import (
    BROADCAST_ID,
    Framer,
    Instruction,
    InstructionPacket,
    StatusPacket,
    v1,
    v2,
)
from busemu.tables import load_robot
from busemu.timing import load_profile
from busemu.trace import WireEvent

BYTE_S = 10e-6
RETURN_DELAY_S = 500e-6
HEXAPODS = pytest.mark.parametrize("name", ["phantomx", "marvin"])


@dataclass
class Sent:
    start_s: float
    data: bytes


class Board:
    """A control board's view of the line: what it sends arrives after its last byte, at once."""

    def __init__(self, name: str, timing: str | None = None) -> None:
        robot = load_robot(name)
        self.protocol = robot.protocol
        self.wire: list[WireEvent] = []
        profile = servo_side(load_profile(timing or robot.timing))
        self.bus = assemble(robot, ideal(robot), profile, on_wire=self.wire.append)
        self.line = UartLine(self.bus)
        self.now_s = 1.0
        self.sent: list[Sent] = []

    def packet(self, servo_id: int, instruction: int, parameters: bytes = b"") -> bytes:
        encode = v1.encode_instruction if self.protocol == 1.0 else v2.encode_instruction
        return encode(InstructionPacket(servo_id, instruction, parameters))

    def ping(self) -> bytes:
        return self.packet(1, Instruction.PING)

    def send(self, data: bytes) -> None:
        self.run(self.now_s)
        self.line.receive(data, self.now_s)

    def run(self, to_s: float) -> list[Sent]:
        """Let time pass up to an instant; what was given to the UART meanwhile, and when."""
        since = len(self.sent)
        while self.line.next_deadline_s() <= to_s:
            self.now_s = max(self.now_s, self.line.next_deadline_s())
            data = self.line.poll(self.now_s)
            if data:
                self.sent.append(Sent(self.now_s, data))
        self.now_s = max(self.now_s, to_s)
        return self.sent[since:]

    def ask(self, data: bytes, within_s: float = 0.05) -> list[Sent]:
        self.send(data)
        return self.run(self.now_s + within_s)


@HEXAPODS
def test_reply_begins_one_return_delay_after_the_packet_has_come(name: str) -> None:
    board = Board(name)
    asked_s = board.now_s
    (reply,) = board.ask(board.ping())
    delay_s = RETURN_DELAY_S + board.bus.profile.interrupt_s()
    assert reply.start_s - asked_s == pytest.approx(delay_s, abs=1e-9)
    (status,) = Framer(board.protocol, role="host").feed(reply.data)
    assert isinstance(status, StatusPacket)


def test_adapter_and_usb_of_the_profile_are_not_charged() -> None:
    """Marvin's adapter alone is 2 ms a read."""
    times_s = []
    for timing in ("ideal", "thesis-marvin"):
        board = Board("marvin", timing)
        asked_s = board.now_s
        times_s.append(board.ask(board.ping())[0].start_s - asked_s)
    assert times_s[0] == pytest.approx(times_s[1], abs=1e-9)


def test_chained_replies_leave_room_for_the_bytes_of_the_one_before() -> None:
    board = Board("marvin")
    parameters = b"\x25\x00\x02\x00" + bytes(range(1, 19))
    replies = board.ask(board.packet(BROADCAST_ID, Instruction.SYNC_READ, parameters))
    assert len(replies) == 18
    lead_s = board.bus.profile.chain_lead_s
    for before, after in pairwise(replies):
        gap_s = after.start_s - before.start_s - len(before.data) * BYTE_S
        assert gap_s == pytest.approx(RETURN_DELAY_S - lead_s, abs=1e-9)


@HEXAPODS
def test_board_that_asks_on_at_once_is_answered_every_time(name: str) -> None:
    """On a pty for a line a reply arrives before its bytes would be over; none is a collision."""
    board = Board(name)
    for _ in range(20):
        (reply,) = board.ask(board.ping(), within_s=0.001)
        assert reply.data
        board.now_s = reply.start_s + 1e-6
    assert board.bus.counts.errors == 0


@HEXAPODS
def test_pause_that_the_adapter_makes_within_a_packet_is_no_end_of_it(name: str) -> None:
    board = Board(name)
    packet = board.ping()
    board.send(packet[:5])
    assert board.run(board.now_s + ADAPTER_S) == []
    done_s = board.now_s
    (reply,) = board.ask(packet[5:])
    assert reply.start_s - done_s >= RETURN_DELAY_S - 1e-9


@HEXAPODS
def test_packet_broken_off_is_forgotten_after_a_real_pause(name: str) -> None:
    board = Board(name)
    board.send(board.ping()[:5])
    board.run(board.now_s + 0.2)
    assert len(board.ask(board.ping())) == 1
    assert board.bus.counts.noise_bytes == 5


@HEXAPODS
def test_whole_packet_does_not_wait_for_the_next_ones_end(name: str) -> None:
    board = Board(name)
    (reply,) = board.ask(board.ping() + board.ping()[:3], within_s=0.002)
    assert reply.data


@HEXAPODS
def test_adapter_that_hears_itself_starts_no_conversation(name: str) -> None:
    board = Board(name)
    (reply,) = board.ask(board.ping())
    assert board.ask(reply.data) == []
    assert len(board.ask(board.ping())) == 1
    assert (board.bus.counts.transactions, board.bus.counts.errors) == (2, 0)


def test_echoes_of_a_chain_and_the_next_instruction_may_come_in_one_piece() -> None:
    board = Board("marvin")
    parameters = b"\x25\x00\x02\x00\x01\x02\x03"
    replies = board.ask(board.packet(BROADCAST_ID, Instruction.SYNC_READ, parameters))
    heard = b"".join(reply.data for reply in replies) + board.ping()
    assert len(board.ask(heard)) == 1
    assert board.bus.counts.transactions == 2


def test_listener_of_the_wire_goes_on_hearing() -> None:
    board = Board("marvin")
    board.ask(board.ping())
    assert [event.kind.value for event in board.wire] == ["instruction", "status"]


def test_uart_at_another_baud_rate_than_the_servos_meets_silence() -> None:
    board = Board("marvin")
    board.line.baud_rate = 57_600
    assert board.ask(board.ping()) == []
    board.line.baud_rate = 1_000_000
    assert len(board.ask(board.ping())) == 1
