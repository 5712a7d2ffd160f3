"""Byte stuffing of Protocol 2.0."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from wire_oracles import sdk_stuffed

from busemu.protocol import InstructionPacket, StatusPacket, stuff, unstuff, v2

# Bodies rich in the bytes that matter.
BODIES = st.lists(st.sampled_from([0xFF, 0xFF, 0xFD, 0x00, 0x55]), min_size=1, max_size=60).map(
    bytes
)


@pytest.mark.parametrize(
    ("meant", "on_the_wire"),
    [
        ("03 FF FF FD", "03 FF FF FD FD"),  # at the very end
        ("FF FF FD 00", "FF FF FD FD 00"),  # from the instruction on
        ("FF FD FF FF FD", "FF FD FF FF FD FD"),
        ("03 FF FF FD FD", "03 FF FF FD FD FD"),
        ("03 FF FF FD FF FF FD", "03 FF FF FD FD FF FF FD FD"),
        ("03 FF FF FF FD", "03 FF FF FF FD FD"),
        ("03 FF FD FF", "03 FF FD FF"),
        ("FD FD", "FD FD"),
    ],
)
def test_an_fd_follows_each_pattern(meant: str, on_the_wire: str):
    assert stuff(bytes.fromhex(meant)) == bytes.fromhex(on_the_wire)
    assert unstuff(bytes.fromhex(on_the_wire)) == bytes.fromhex(meant)


@given(BODIES)
def test_unstuffing_undoes_stuffing(body: bytes):
    assert unstuff(stuff(body)) == body


@given(BODIES)
def test_a_stuffed_body_has_no_pattern_without_its_fd(body: bytes):
    stuffed = stuff(body)
    assert stuffed.count(b"\xff\xff\xfd") == stuffed.count(b"\xff\xff\xfd\xfd")
    assert len(stuffed) - len(body) == body.count(b"\xff\xff\xfd")


@given(BODIES, st.integers(0, 0xFC))
@example(b"\xff\xff\xfd", 1)
def test_an_instruction_packet_is_stuffed_as_the_sdk_stuffs_it(body: bytes, servo_id: int):
    if body[0] == 0x55:
        body = b"\x03" + body
    plain = b"\xff\xff\xfd\x00%c%b%b\0\0" % (
        servo_id,
        (len(body) + 2).to_bytes(2, "little"),
        body,
    )
    packet = InstructionPacket(servo_id, body[0], body[1:])
    assert v2.encode_instruction(packet) == sdk_stuffed(plain)


@given(BODIES, st.integers(0, 0xFC))
def test_a_status_packet_is_stuffed_as_the_sdk_stuffs_it(body: bytes, servo_id: int):
    plain = b"\xff\xff\xfd\x00%c%b\x55%b\0\0" % (
        servo_id,
        (len(body) + 3).to_bytes(2, "little"),
        body,
    )
    packet = StatusPacket(servo_id, body[0], body[1:])
    assert v2.encode_status(packet) == sdk_stuffed(plain)
