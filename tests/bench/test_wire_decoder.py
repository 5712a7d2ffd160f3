"""Bytes to accesses: against what the robot's own client noted, and packet by packet."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import astuple
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.recording import Recorder
from bench.running import Session, Steering, walk_in
from bench.wire_decoder import PAUSE_S, PIPELINE_S, WireDecoder
from busemu.assemble import assemble
from busemu.bus import Bus
from busemu.clock import VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.protocol import (
    BROADCAST_ID,
    Instruction,
    InstructionPacket,
    StatusPacket,
    encode_fast_status,
    v1,
    v2,
)
from busemu.tables import load_robot, load_table
from busemu.timing import load_profile
from hal.access import Access
from hal.bus_client import BusClient

NAMES = ("phantomx", "marvin")
NONE = math.nan


# -- against the client ---------------------------------------------------------------------------


class HeardPort:
    """A port in virtual time that lets a decoder hear what the SDK sends and gets."""

    def __init__(self, port: SdkPort, decoder: WireDecoder) -> None:
        self._port = port
        self._decoder = decoder
        self.is_using = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def writePort(self, packet: Any) -> int:  # noqa: N802
        written = self._port.writePort(packet)
        self._decoder.sent(bytes(packet), self._port.clock.now_s())
        return written

    def readPort(self, length: int) -> bytes:  # noqa: N802
        data = self._port.readPort(length)
        if data:
            self._decoder.received(data, self._port.clock.now_s())
        return data


class Heard:
    """A robot's own client on a bus, and a decoder beside it."""

    def __init__(self, name: str, mute: Iterable[int] = ()) -> None:
        self.robot = load_robot(name)
        clock = VirtualClock()
        bus = assemble(self.robot, ideal(self.robot), load_profile(self.robot.timing))
        if mute:
            left = [servo for servo in bus.servos if servo.servo_id not in mute]
            bus = Bus(left, bus.plant, bus.profile, protocol=bus.protocol, baud_rate=1_000_000)
        self.noted, self.decoded = Recorder(), Recorder()
        protocol, tables = self.robot.protocol, self.robot.tables
        self.decoder = WireDecoder(protocol, tables, self.decoded)
        port = HeardPort(SdkPort(bus, clock), self.decoder)
        self.client = BusClient(port, tables, protocol, clock, self.noted)
        self.session = Session(self.robot, self.client, self.noted, clock, "emulator", bus)

    def assert_same(self) -> None:
        self.decoder.finish()
        noted, decoded = (rows.table().to_pydict() for rows in (self.noted, self.decoded))
        assert str(noted) == str(decoded)  # as text, in which nan is nan
        assert len(self.noted) == self.decoder.counts.rows > 0


@pytest.mark.parametrize("name", NAMES)
def test_walk_is_decoded_as_the_client_noted_it(name: str) -> None:
    heard = Heard(name)
    walk_in(heard.session, Steering(seconds=0.5))
    heard.assert_same()
    assert heard.decoder.counts.lost == heard.decoder.counts.damaged == 0
    assert heard.decoder.counts.noise_bytes == 0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("mute", [{1}, {7, 12}, {18}, set(range(1, 18))])
def test_lost_replies_are_those_the_client_missed(name: str, mute: set[int]) -> None:
    heard = Heard(name, mute)
    for _ in range(3):
        heard.client.sync_write("goal_position", {i: 500 + i for i in range(1, 19)})
        heard.client.read_all("present_position", range(1, 19))
    heard.assert_same()
    silenced = len(mute) if name == "phantomx" else 19 - min(mute)
    assert heard.decoder.counts.lost == 3 * silenced


# -- packet by packet -----------------------------------------------------------------------------


class Bench:
    """A decoder of one protocol, fed packets; servos 1 and 2 have a table, servo 9 has none."""

    def __init__(self, protocol: float) -> None:
        self.protocol = protocol
        self.now_s = 0.0
        self.rows: list[Access] = []
        self.table = load_table("AX-12A" if protocol == 1.0 else "XL-320")
        self.decoder = WireDecoder(protocol, dict.fromkeys((1, 2), self.table), self.rows.append)

    def place(self, name: str) -> bytes:
        return self.number(self.table[name].address)

    def number(self, value: int) -> bytes:
        return value.to_bytes(int(self.protocol), "little")

    def packet(self, servo_id: int, instruction: int, *parts: bytes) -> bytes:
        encode = v1.encode_instruction if self.protocol == 1.0 else v2.encode_instruction
        return encode(InstructionPacket(servo_id, instruction, b"".join(parts)))

    def send(self, servo_id: int, instruction: int, *parts: bytes, after_s: float = 0.01) -> float:
        self.now_s += after_s
        self.decoder.sent(self.packet(servo_id, instruction, *parts), self.now_s)
        return self.now_s

    def answer(self, servo_id: int, data: bytes = b"", error: int = 0) -> float:
        encode = v1.encode_status if self.protocol == 1.0 else v2.encode_status
        return self.hear(encode(StatusPacket(servo_id, error, data)))

    def hear(self, data: bytes) -> float:
        self.now_s += 0.001
        self.decoder.received(data, self.now_s)
        return self.now_s

    def seen(self) -> list[tuple[Any, ...]]:
        """Rows since asked last: servo ID, operation, register, raw value (None: none came)."""
        rows = [
            (r.servo_id, r.op, r.register, None if math.isnan(r.raw) else r.raw) for r in self.rows
        ]
        for row in self.rows:
            has_reply = row.op == "read" and not math.isnan(row.raw)
            assert has_reply is not math.isnan(row.t_reply_s)
        self.rows.clear()
        return rows


BOTH = pytest.mark.parametrize("protocol", [1.0, 2.0])


@BOTH
def test_times_are_those_of_the_last_bytes(protocol: float) -> None:
    bench = Bench(protocol)
    packet = bench.packet(1, Instruction.READ, bench.place("present_position"), bench.number(2))
    bench.decoder.sent(packet[:5], 1.0)
    bench.decoder.sent(packet[5:], 1.0005)
    encode = v1.encode_status if protocol == 1.0 else v2.encode_status
    reply = encode(StatusPacket(1, 0, b"\x00\x02"))
    bench.decoder.received(reply[:-1], 1.001)
    assert bench.rows == []
    bench.decoder.received(reply[-1:], 1.002)
    assert bench.rows == [Access(1.0005, 1.002, 1, "read", "present_position", 512.0)]


@BOTH
def test_write_counts_when_sent_whatever_the_servo_says(protocol: float) -> None:
    bench = Bench(protocol)
    sent_s = bench.send(1, Instruction.WRITE, bench.place("goal_position"), b"\x34\x01")
    assert [(r.t_s, math.isnan(r.t_reply_s)) for r in bench.rows] == [(sent_s, True)]
    assert bench.seen() == [(1, "write", "goal_position", 0x134)]
    bench.answer(1, error=8)
    bench.decoder.finish()
    assert bench.seen() == []


@BOTH
def test_write_over_several_registers_is_a_row_each(protocol: float) -> None:
    bench = Bench(protocol)
    bench.send(2, Instruction.WRITE, bench.place("goal_position"), b"\x00\x02\x64\x00")
    assert bench.seen() == [(2, "write", "goal_position", 512), (2, "write", "moving_speed", 100)]


@BOTH
def test_broadcast_write_is_a_row_for_each_servo_of_the_robot(protocol: float) -> None:
    bench = Bench(protocol)
    bench.send(BROADCAST_ID, Instruction.WRITE, bench.place("torque_enable"), b"\x01")
    assert bench.seen() == [(1, "write", "torque_enable", 1), (2, "write", "torque_enable", 1)]


@BOTH
def test_registered_write_counts_when_the_action_comes(protocol: float) -> None:
    bench = Bench(protocol)
    bench.send(1, Instruction.REG_WRITE, bench.place("goal_position"), b"\x01\x00")
    bench.send(1, Instruction.REG_WRITE, bench.place("goal_position"), b"\x02\x00")
    bench.send(2, Instruction.REG_WRITE, bench.place("goal_position"), b"\x03\x00")
    assert bench.seen() == []
    action_s = bench.send(BROADCAST_ID, Instruction.ACTION)
    assert {r.t_s for r in bench.rows} == {action_s}
    assert bench.seen() == [(1, "write", "goal_position", 2), (2, "write", "goal_position", 3)]
    bench.send(BROADCAST_ID, Instruction.ACTION)
    assert bench.seen() == []


@BOTH
def test_action_of_one_servo_leaves_the_others_registered(protocol: float) -> None:
    bench = Bench(protocol)
    for servo_id in (1, 2):
        bench.send(servo_id, Instruction.REG_WRITE, bench.place("torque_enable"), b"\x01")
    bench.send(2, Instruction.ACTION)
    assert bench.seen() == [(2, "write", "torque_enable", 1)]
    bench.send(1, Instruction.FACTORY_RESET, b"\x02" if protocol == 2.0 else b"")
    bench.send(1, Instruction.ACTION)
    assert bench.seen() == []


@BOTH
def test_sync_write_is_a_row_for_each_servo(protocol: float) -> None:
    bench = Bench(protocol)
    body = b"\x01\x0a\x00\x02\x0b\x00"
    place, size = bench.place("goal_position"), bench.number(2)
    bench.send(BROADCAST_ID, Instruction.SYNC_WRITE, place, size, body)
    assert bench.seen() == [(1, "write", "goal_position", 10), (2, "write", "goal_position", 11)]


def test_bulk_write_is_a_row_for_each_register() -> None:
    bench = Bench(2.0)
    goal = b"\x01" + bench.place("goal_position") + b"\x02\x00\x0a\x00"
    torque = b"\x02" + bench.place("torque_enable") + b"\x01\x00\x01"
    bench.send(BROADCAST_ID, Instruction.BULK_WRITE, goal, torque)
    assert bench.seen() == [(1, "write", "goal_position", 10), (2, "write", "torque_enable", 1)]


@BOTH
def test_read_of_many_registers_is_a_row_each(protocol: float) -> None:
    bench = Bench(protocol)
    names = ["present_position", "present_speed", "present_load"]
    bench.send(1, Instruction.READ, bench.place(names[0]), bench.number(6))
    bench.answer(1, b"\x01\x00\x02\x00\x03\x00")
    assert bench.seen() == [
        (1, "read", name, value) for name, value in zip(names, (1, 2, 3), strict=True)
    ]


def sync_read(bench: Bench, ids: bytes, instruction: int = Instruction.SYNC_READ) -> float:
    place, size = bench.place("present_position"), bench.number(2)
    return bench.send(BROADCAST_ID, instruction, place, size, ids)


def position(servo_id: int, raw: int | None) -> tuple[Any, ...]:
    return (servo_id, "read", "present_position", raw)


def test_sync_read_has_a_reply_time_for_each_servo() -> None:
    bench = Bench(2.0)
    sent_s = sync_read(bench, b"\x01\x02")
    replies_s = [bench.answer(i, bytes([i, 0])) for i in (1, 2)]
    assert [(r.t_s, r.t_reply_s) for r in bench.rows] == [(sent_s, s) for s in replies_s]
    assert bench.seen() == [position(1, 1), position(2, 2)]


def test_mute_servo_and_those_after_it_are_lost_in_their_order() -> None:
    bench = Bench(2.0)
    sync_read(bench, b"\x02\x01\x02")
    bench.answer(2, b"\x07\x00")
    bench.send(1, Instruction.PING)
    assert bench.seen() == [position(2, 7), position(1, None), position(2, None)]
    assert bench.decoder.counts.lost == 2


def test_servo_passed_over_in_a_sync_read_is_lost() -> None:
    bench = Bench(2.0)
    sync_read(bench, b"\x01\x02")
    bench.answer(2, b"\x07\x00")
    assert bench.seen() == [position(1, None), position(2, 7)]


def test_bulk_read_of_protocol_2_reads_what_each_was_asked() -> None:
    bench = Bench(2.0)
    one = b"\x01" + bench.place("present_voltage") + b"\x01\x00"
    two = b"\x02" + bench.place("present_position") + b"\x02\x00"
    bench.send(BROADCAST_ID, Instruction.BULK_READ, one, two)
    bench.answer(1, b"\x4a")
    bench.answer(2, b"\x00\x02")
    assert bench.seen() == [(1, "read", "present_voltage", 74), position(2, 512)]


def test_bulk_read_of_protocol_1_reads_what_each_was_asked() -> None:
    bench = Bench(1.0)
    voltage, place = bench.place("present_voltage"), bench.place("present_position")
    rows = (b"\x00", b"\x01\x01" + voltage, b"\x02\x02" + place)
    bench.send(BROADCAST_ID, Instruction.BULK_READ, *rows)
    bench.answer(1, b"\x4a")
    bench.answer(2, b"\x00\x02")
    assert bench.seen() == [(1, "read", "present_voltage", 74), position(2, 512)]


def test_fast_sync_read_comes_in_one_packet() -> None:
    bench = Bench(2.0)
    sync_read(bench, b"\x01\x02", Instruction.FAST_SYNC_READ)
    bench.hear(encode_fast_status([(1, 0, b"\x05\x00"), (2, 0x80, b"\x06\x00")]))
    assert bench.seen() == [position(1, 5), position(2, 6)]


def test_fast_bulk_read_comes_in_one_packet() -> None:
    bench = Bench(2.0)
    one = b"\x01" + bench.place("present_voltage") + b"\x01\x00"
    two = b"\x02" + bench.place("present_position") + b"\x02\x00"
    bench.send(BROADCAST_ID, Instruction.FAST_BULK_READ, one, two)
    bench.hear(encode_fast_status([(1, 0, b"\x4a"), (2, 0, b"\x00\x02")]))
    assert bench.seen() == [(1, "read", "present_voltage", 74), position(2, 512)]


ADAPTER = 0xFD


def usb2ax_read(ids: bytes) -> Bench:
    bench = Bench(1.0)
    place = bench.place("present_position")
    bench.send(ADAPTER, Instruction.USB2AX_SYNC_READ, place, b"\x02", ids)
    return bench


def test_sync_read_of_a_usb2ax_is_a_row_for_each_servo() -> None:
    bench = usb2ax_read(b"\x02\x01")
    reply_s = bench.answer(ADAPTER, b"\x07\x00\x00\x02")
    assert [row.t_reply_s for row in bench.rows] == [reply_s, reply_s]
    assert bench.seen() == [position(2, 7), position(1, 512)]


def test_servo_that_a_usb2ax_did_not_hear_is_lost_and_no_other() -> None:
    bench = usb2ax_read(b"\x01\x02\x01")
    bench.answer(ADAPTER, b"\x07\x00\xff\xff\x08\x00")
    assert bench.seen() == [position(1, 7), position(2, None), position(1, 8)]
    assert bench.decoder.counts.lost == 1


@pytest.mark.parametrize(
    "answer", [(ADAPTER, b"", 8), (ADAPTER, b"\x07\x00", 0), (1, b"\x07\x00", 0)]
)
def test_sync_read_that_a_usb2ax_does_not_answer_is_lost(answer: tuple[int, bytes, int]) -> None:
    bench = usb2ax_read(b"\x01\x02")
    bench.answer(*answer)
    bench.send(1, Instruction.PING)
    assert bench.seen() == [position(1, None), position(2, None)]


def read(bench: Bench, servo_id: int = 1, after_s: float = 0.01) -> float:
    place = bench.place("present_position")
    return bench.send(servo_id, Instruction.READ, place, bench.number(2), after_s=after_s)


@BOTH
def test_alert_with_data_is_an_answer_and_a_refusal_is_none(protocol: float) -> None:
    bench = Bench(protocol)
    read(bench)
    bench.answer(1, b"\x01\x02", error=0x80 if protocol == 2.0 else 0x04)
    assert bench.seen() == [position(1, 0x201)]
    read(bench)
    bench.answer(1, error=0x07 if protocol == 2.0 else 0x08)
    assert bench.seen() == [position(1, None)]


@BOTH
def test_damaged_status_is_no_answer(protocol: float) -> None:
    bench = Bench(protocol)
    read(bench)
    encode = v1.encode_status if protocol == 1.0 else v2.encode_status
    status = bytearray(encode(StatusPacket(1, 0, b"\x01\x02")))
    status[-1] ^= 1
    bench.hear(bytes(status))
    read(bench, 2)
    assert bench.seen() == [position(1, None)]
    assert bench.decoder.counts.damaged == 1
    bench.answer(2, b"\x03\x00")
    assert bench.seen() == [position(2, 3)]


@BOTH
def test_late_reply_does_not_answer_the_repeated_question_twice(protocol: float) -> None:
    bench = Bench(protocol)
    read(bench)
    asked_s = read(bench)
    bench.answer(1, b"\x01\x00")
    assert [r.t_s for r in bench.rows][1] == asked_s
    assert bench.seen() == [position(1, None), position(1, 1)]
    bench.answer(1, b"\x02\x00")
    bench.decoder.finish()
    assert bench.seen() == []


@BOTH
def test_questions_asked_in_one_breath_are_all_answered(protocol: float) -> None:
    bench = Bench(protocol)
    for servo_id in (1, 2):
        read(bench, servo_id, after_s=PIPELINE_S / 4)
    bench.answer(1, b"\x01\x00")
    bench.answer(2, b"\x02\x00")
    assert bench.seen() == [position(1, 1), position(2, 2)]


@BOTH
def test_rows_come_in_the_order_of_the_instructions_in_one_breath(protocol: float) -> None:
    bench = Bench(protocol)
    read(bench, after_s=PIPELINE_S / 8)
    bench.send(1, Instruction.WRITE, bench.place("torque_enable"), b"\x01", after_s=0.0)
    read(bench, 2, after_s=0.0)
    bench.answer(2, b"\x09\x00")
    written = (1, "write", "torque_enable", 1)
    assert bench.seen() == [position(1, None), written, position(2, 9)]


@BOTH
def test_status_of_a_write_or_ping_does_not_answer_a_read(protocol: float) -> None:
    bench = Bench(protocol)
    bench.send(1, Instruction.WRITE, bench.place("torque_enable"), b"\x01")
    read(bench, after_s=PIPELINE_S / 4)
    bench.answer(1)
    bench.answer(1, b"\x09\x00")
    assert bench.seen() == [(1, "write", "torque_enable", 1), position(1, 9)]


@BOTH
def test_instruction_that_the_adapter_hears_itself_say_is_no_answer(protocol: float) -> None:
    bench = Bench(protocol)
    read(bench)
    place, size = bench.place("present_position"), bench.number(2)
    bench.hear(bench.packet(1, Instruction.READ, place, size))
    assert bench.seen() == []
    bench.answer(1, b"\x09\x00")
    assert bench.seen() == [position(1, 9)]


@BOTH
def test_bytes_that_are_no_register_are_kept_under_a_namespace(protocol: float) -> None:
    bench = Bench(protocol)
    bench.send(
        1, Instruction.READ, bench.number(bench.table["goal_position"].address + 1), bench.number(3)
    )
    bench.answer(1, b"\x02\x64\x00")
    byte = bench.table["goal_position"].address + 1
    assert bench.seen() == [
        (0, "read", f"wire/servo_1/byte_{byte}", 2),
        (1, "read", "moving_speed", 100),
    ]
    speed = bench.table["moving_speed"].address
    bench.send(1, Instruction.WRITE, bench.place("moving_speed"), b"\x07")
    assert bench.seen() == [(0, "write", f"wire/servo_1/byte_{speed}", 7)]
    bench.send(9, Instruction.WRITE, bench.number(4), b"\x05\x06")
    assert bench.seen() == [
        (0, "write", "wire/servo_9/byte_4", 5),
        (0, "write", "wire/servo_9/byte_5", 6),
    ]


@BOTH
def test_recording_of_all_kinds_of_rows_is_accepted(protocol: float) -> None:
    bench = Bench(protocol)
    read(bench, 9)
    bench.send(9, Instruction.WRITE, bench.number(4), b"\x05\x06")
    read(bench)
    bench.answer(1, b"\x09\x00")
    read(bench)
    bench.decoder.finish()
    recorder = Recorder()
    for row in bench.rows:
        recorder(row)
    robot = "phantomx" if protocol == 1.0 else "marvin"
    assert len(recorder.recording({"name": "all", "robot": robot, "source": "real"})) == 6


@BOTH
def test_sender_that_vanished_mid_packet_does_not_harm_the_next(protocol: float) -> None:
    bench = Bench(protocol)
    bench.decoder.sent(bench.packet(1, Instruction.WRITE, bench.number(30), b"\x00" * 40)[:20], 0.0)
    bench.now_s = 2 * PAUSE_S
    bench.send(1, Instruction.WRITE, bench.place("torque_enable"), b"\x01")
    assert bench.seen() == [(1, "write", "torque_enable", 1)]
    assert bench.decoder.counts.noise_bytes == 20


@BOTH
def test_instructions_without_registers_are_no_rows(protocol: float) -> None:
    bench = Bench(protocol)
    bench.send(1, Instruction.PING)
    bench.answer(1, b"\x5e\x01\x1d" if protocol == 2.0 else b"")
    bench.send(1, Instruction.REBOOT)
    bench.send(1, Instruction.READ, b"\x01")
    bench.send(1, Instruction.ACTION)
    bench.send(BROADCAST_ID, Instruction.SYNC_WRITE, b"\x01\x02\x03\x04")
    bench.decoder.finish()
    assert bench.seen() == []
    assert bench.decoder.counts.instructions == 5


# -- properties -----------------------------------------------------------------------------------


def conversation(protocol: float) -> list[tuple[bool, bytes]]:
    """Everything above in one trace: whether the host sent it, and the bytes."""
    bench = Bench(protocol)
    heard: list[tuple[bool, bytes]] = []
    bench.decoder.sent = lambda data, t_s: heard.append((True, data))  # type: ignore[method-assign]
    bench.decoder.received = lambda data, t_s: heard.append((False, data))  # type: ignore[method-assign]
    read(bench)
    bench.answer(1, b"\xff\xff")
    bench.send(1, Instruction.REG_WRITE, bench.place("goal_position"), b"\xff\x01")
    bench.answer(1)
    bench.send(BROADCAST_ID, Instruction.ACTION)
    bench.send(9, Instruction.WRITE, bench.number(4), b"\xff\xff\xfd\x00")
    bench.hear(b"\x00\xff")
    if protocol == 2.0:
        sync_read(bench, b"\x01\x02\x01")
        bench.answer(1, b"\x01\x02")
        bench.answer(2, b"\x01\x03")
    read(bench, 2)
    return heard


@BOTH
@given(data=st.data())
def test_how_bytes_are_cut_does_not_change_the_rows(protocol: float, data: st.DataObject) -> None:
    rows: list[list[Access]] = [[], []]
    trace = conversation(protocol)
    for cut, found in zip((False, True), rows, strict=True):
        decoder = WireDecoder(protocol, {1: load_table("AX-12A")}, found.append)
        for number, (from_host, portion) in enumerate(trace):
            take = decoder.sent if from_host else decoder.received
            size = data.draw(st.integers(1, len(portion))) if cut else len(portion)
            for at in range(0, len(portion), size):
                take(portion[at : at + size], 0.01 * number)
        decoder.finish()
    whole, cut_up = ([str(astuple(row)) for row in found] for found in rows)
    assert whole == cut_up
    assert whole


@BOTH
@given(
    portions=st.lists(
        st.tuples(st.booleans(), st.binary(max_size=40), st.floats(0.0, 0.2)), max_size=20
    )
)
def test_any_bytes_are_decoded_without_an_error(
    protocol: float, portions: list[tuple[bool, bytes, float]]
) -> None:
    bench = Bench(protocol)
    for from_host, data, after_s in portions:
        bench.now_s += after_s
        take = bench.decoder.sent if from_host else bench.decoder.received
        take(data, bench.now_s)
    bench.decoder.finish()


@BOTH
@given(
    packets=st.lists(
        st.tuples(
            st.booleans(),
            st.sampled_from([1, 2, 9, BROADCAST_ID]),
            st.sampled_from([i for i in Instruction if i != Instruction.STATUS]),
            st.binary(max_size=12),
        ),
        max_size=12,
    )
)
def test_any_packets_are_decoded_without_an_error(
    protocol: float, packets: list[tuple[bool, int, int, bytes]]
) -> None:
    bench = Bench(protocol)
    for answered, servo_id, instruction, parameters in packets:
        bench.send(servo_id, instruction, parameters)
        if answered and servo_id != BROADCAST_ID:
            bench.answer(servo_id, parameters)
    bench.decoder.finish()
