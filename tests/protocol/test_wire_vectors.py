"""The manual's packets, read and written."""

from __future__ import annotations

import pytest
from wire_vectors import Vector, load

from busemu.protocol import BadPacket, Framer, Instruction, Noise, v2

VECTORS = load()
BY_NAME = pytest.mark.parametrize("vector", VECTORS, ids=str)
# No part of a header of either protocol, and one part of each.
NOISE = [b"\x00\x7f", b"\xff", b"\xff\xff\xff", b"\xff\xff\xfd\xfd\xfd"]


def one_by_one(framer: Framer, data: bytes) -> list[object]:
    return [packet for byte in data for packet in framer.feed(bytes((byte,)))]


def without_noise(packets: list[object]) -> list[object]:
    return [packet for packet in packets if not isinstance(packet, Noise)]


def noise_in(packets: list[object]) -> bytes:
    return b"".join(packet.data for packet in packets if isinstance(packet, Noise))


@BY_NAME
def test_a_vector_is_what_the_encoder_writes(vector: Vector):
    assert vector.encode() == vector.wire


@BY_NAME
def test_a_vector_is_read_whole(vector: Vector):
    framer = vector.framer()
    assert framer.feed(vector.wire) == [vector.packet]
    assert framer.pending == 0


@BY_NAME
def test_a_vector_is_read_byte_by_byte(vector: Vector):
    framer = vector.framer()
    assert one_by_one(framer, vector.wire[:-1]) == []
    assert framer.pending == len(vector.wire) - 1
    assert framer.feed(vector.wire[-1:]) == [vector.packet]
    assert framer.pending == 0


@BY_NAME
@pytest.mark.parametrize("noise", NOISE, ids=lambda noise: noise.hex(" "))
def test_a_vector_is_read_after_noise(vector: Vector, noise: bytes):
    for packets in (
        vector.framer().feed(noise + vector.wire),
        one_by_one(vector.framer(), noise + vector.wire),
    ):
        assert without_noise(packets) == [vector.packet]
        assert noise_in(packets) == noise


@BY_NAME
def test_a_vector_is_read_before_more(vector: Vector):
    framer = vector.framer()
    assert framer.feed(vector.wire + vector.wire + vector.wire[:-1]) == [vector.packet] * 2
    assert framer.pending == len(vector.wire) - 1
    assert framer.abort() == Noise(vector.wire[:-1])
    assert framer.feed(b"\x01" + vector.wire) == [Noise(b"\x01"), vector.packet]


@BY_NAME
def test_a_vector_with_a_wrong_check_is_bad_and_the_next_one_is_read(vector: Vector):
    broken = vector.wire[:-1] + bytes((vector.wire[-1] ^ 0x40,))
    for framer in (vector.framer(), vector.framer()):
        bad, good = framer.feed(broken + vector.wire)
        assert isinstance(bad, BadPacket)
        assert bad.servo_id == vector.packet.servo_id
        assert bad.expected != bad.actual
        assert bad.data == broken
        assert good == vector.packet
        assert framer.pending == 0


@pytest.mark.parametrize("vector", [v for v in VECTORS if "slices" in v.entry], ids=str)
def test_each_servo_sends_its_own_slice_of_a_fast_status(vector: Vector):
    slices = [bytes.fromhex(text) for text in vector.entry["slices"]]
    assert v2.fast_status_slices(vector.blocks) == slices
    sizes = [len(data) for _, _, data in vector.blocks]
    assert v2.split_fast_status(vector.packet, sizes) == vector.blocks


@pytest.mark.parametrize("vector", [v for v in VECTORS if "misprint" in v.entry], ids=str)
def test_a_misprint_of_the_manual_is_a_bad_packet(vector: Vector):
    misprint = bytes.fromhex(vector.entry["misprint"])
    (bad,) = vector.framer().feed(misprint)
    assert isinstance(bad, BadPacket)
    assert bad.actual == int.from_bytes(misprint[-2:], "little")
    assert bad.expected == int.from_bytes(vector.wire[-2:], "little")


def test_every_instruction_has_a_vector():
    shown = {vector.entry.get("instruction") for vector in VECTORS}
    shown |= {vector.wire[7] for vector in VECTORS if vector.protocol == 2.0}
    assert shown >= set(Instruction)
