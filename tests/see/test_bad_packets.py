"""Each way to spoil a packet is called by its name."""

import binascii
import sys
from pathlib import Path

import pytest
from dynamixel_sdk import PacketHandler

sys.path.append(str(Path(__file__).parents[1] / "protocol"))
from wire_vectors import load

from busemu.protocol import InstructionPacket, crc16, encode_fast_status, v1, v2
from busemu.trace import WireEventKind
from busemu.traffic.explain import Explainer

GOOD_1 = v1.encode_instruction(InstructionPacket(1, 3, b"\x1e\x00\x02"))
GOOD_2 = v2.encode_instruction(InstructionPacket(1, 3, b"\x1e\x00\xff\x01"))
STUFFED = v2.encode_instruction(InstructionPacket(1, 3, b"\x1e\x00\xff\xff\xfd"))
UNSTUFFED = v2._encode(1, b"\x03\x1e\x00\xff\xff\xfd")  # as the official Python SDK sends it


def little(value):
    return value.to_bytes(2, "little")


def with_crc(content, value=None):
    return content + little(crc16(content) if value is None else value)


def set_byte(data, at, value):
    at %= len(data)
    return data[:at] + bytes((value,)) + data[at + 1 :]


def modbus(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


SUM_1 = sum(GOOD_1[2:-1])
BAD = [
    # the CRC
    (
        GOOD_2[:-2] + GOOD_2[:-3:-1],
        "CRC is 47 56, these bytes give 56 47: its two bytes are swapped",
    ),
    (STUFFED[:-2] + UNSTUFFED[-2:], "it is right without the stuffing"),
    (
        with_crc(STUFFED[:-2], crc16(STUFFED[:7] + UNSTUFFED[7:-2])),
        "it is right without the stuffing",
    ),
    (UNSTUFFED[:-2] + STUFFED[-2:], "it is right for the stuffed packet"),
    (with_crc(GOOD_2[:-2], crc16(GOOD_2[4:-2])), "leaves out the header"),
    (with_crc(GOOD_2[:-2], crc16(GOOD_2[:-2], 0xFFFF)), "begun with FFFF"),
    (with_crc(GOOD_2[:-2], modbus(GOOD_2[:-2])), "Modbus"),
    (with_crc(GOOD_2[:-2], binascii.crc_hqx(GOOD_2[:-2], 0)), "CCITT"),
    (with_crc(GOOD_2[:-2], 0), "never filled in"),
    (set_byte(GOOD_2, 9, GOOD_2[9] ^ 4), "a flipped bit would explain it: byte 9 was 00"),
    (set_byte(GOOD_2, -2, GOOD_2[-2] ^ 16), "a flipped bit 4 in the CRC itself"),
    (set_byte(GOOD_2, 9, GOOD_2[9] ^ 5), "CRC is 56 47, these bytes give 12 47"),
    # the checksum
    (set_byte(GOOD_1, -1, SUM_1 & 0xFF), "it is the sum, not inverted"),
    (set_byte(GOOD_1, -1, -SUM_1 & 0xFF), "two's complement"),
    (set_byte(GOOD_1, -1, ~sum(GOOD_1[:-1]) & 0xFF), "counts the two header bytes"),
    (set_byte(GOOD_1, -1, 0x77), "checksum is 77, these bytes give D6"),
    # the length
    (set_byte(GOOD_2, 5, 9), "length is 9, should be 7 (the CRC is right with that length)"),
    (with_crc(set_byte(GOOD_2[:-2], 5, 4)), "length is 4, should be 7 (the CRC is right as sent)"),
    (
        with_crc(set_byte(STUFFED[:-2], 5, 8)),
        "length is 8, should be 9; it does not count the stuff",
    ),
    (with_crc(set_byte(UNSTUFFED[:-2], 5, 9)), "length is 9, should be 8; it counts stuffing that"),
    (set_byte(GOOD_2, 6, 0xFF)[:-1] + b"\x99", "length is 65287, but 3 to 1024 is possible"),
    (set_byte(GOOD_1, 3, 6), "length is 6, should be 5 (the checksum is right with that length)"),
    (set_byte(set_byte(GOOD_1, 3, 0), -1, 0), "length is 0, but 2 to 250 is possible"),
    # the rest of the form
    (UNSTUFFED, "not stuffed: FF FF FD among the parameters"),
    (with_crc(set_byte(GOOD_2[:-2], 3, 1)), "reserved byte is 01, must be 00"),
    (set_byte(GOOD_2, 3, 1), "reserved byte is 01, must be 00"),
    (v2._encode(0xFD, b"\x01"), "ID is 253, but 0 to 252 or 254 is possible"),
    (GOOD_2[:-1], "cut off: 13 bytes of 14 are there"),
    (GOOD_2[:9], "cut off: 9 bytes of 14 are there"),
    (GOOD_2[:5], "cut off: 5 bytes of at least 10 are there"),
    (GOOD_1[:-2], "cut off: 7 bytes of 9 are there"),
    (GOOD_1[:3], "cut off: 3 bytes of at least 6 are there"),
    # what it says
    (v2._encode(1, b"\x77"), "instruction 77 is unknown in Protocol 2.0"),
    (v1.encode_instruction(InstructionPacket(254, 0x82, b"\x1e\x02\x01")), "it is sync_read in"),
    (v2._encode(1, b"\x02\x84\x00"), "too short for its instruction: it takes 4 parameters"),
    (v2._encode(1, b"\x01\x84"), "too long for its instruction: it takes 0 parameters, 1 is there"),
    (v2._encode(1, b"\x03\x84\x00"), "too short for its instruction"),
    (v2._encode(254, b"\x82\x84\x00\x04\x00"), "too short for its instruction"),
    (v2._encode(254, b"\x83\x74\x00\x02\x00\x01\x02\x03\x04"), "parameters do not divide up"),
    (v2._encode(254, b"\x92\x01\x84\x00\x02\x00\x02"), "parameters do not divide up"),
    (v2._encode(254, b"\x93\x01\x84\x00\x02\x00\x02"), "too short for its instruction"),
    (v2._encode(1, b"\x10\x01DXL!"), "the key is 44 58 4C 21, should be 44 58 4C 22"),
    (v2._encode(1, b"\x55"), "it has no error byte"),
    (v1.encode_instruction(InstructionPacket(1, 2, b"\x1e")), "too short for its instruction"),
]


@pytest.mark.parametrize(("wire", "says"), BAD, ids=[says[:50] for _, says in BAD])
def test_what_is_wrong_is_said(wire, says):
    (found,) = Explainer().explain(wire, WireEventKind.INSTRUCTION)
    assert found.data == wire
    assert any(says in fault for fault in found.faults), found.faults


def test_an_unknown_instruction_is_known_by_its_sender():
    wire = v1.encode_instruction(InstructionPacket(1, 0x77, b""))
    (found,) = Explainer().explain(wire, WireEventKind.INSTRUCTION)
    assert found.faults == ("instruction 77 is unknown in Protocol 1.0",)
    (found,) = Explainer().explain(wire, WireEventKind.STATUS)
    assert "error" in found.summary
    assert not found.faults


@pytest.mark.parametrize(
    ("noise", "says"),
    [
        (b"\x01\x02", "2 bytes before a header"),
        (b"\x00", "nothing but 00"),
        (b"\xff", "nothing but FF"),
        (b"\xfe\xff\xff\xfd\xfd\x00", "the rest of a packet whose beginning is lost"),
    ],
)
def test_noise_before_a_header_is_kept_apart_from_the_packet(noise, says):
    first, second = Explainer(2.0).explain(noise + GOOD_2)
    assert first.kind == "noise"
    assert says in first.faults[0]
    assert (second.data, second.faults) == (GOOD_2, ())


@pytest.mark.parametrize("good", [GOOD_1, GOOD_2], ids=["1.0", "2.0"])
@pytest.mark.parametrize("size", [4, 6, 8])
def test_a_packet_cut_off_does_not_swallow_the_next(good, size):
    first, second = Explainer().explain(good[:size] + good)
    assert "cut off" in first.faults[0]
    assert (second.data, second.faults) == (good, ())


@pytest.mark.parametrize("good", [GOOD_1, GOOD_2], ids=["1.0", "2.0"])
def test_a_wrong_length_does_not_swallow_the_next_packet(good):
    spoilt = set_byte(good, 5 if good is GOOD_2 else 3, 20)
    first, second = Explainer().explain(spoilt + good)
    assert "length is 20, should be" in first.faults[0]
    assert (first.data, second.data) == (spoilt, good)


@pytest.mark.parametrize(
    ("wire", "protocol", "says"),
    [
        (GOOD_2, 1.0, "this is a Protocol 2.0 header"),
        (GOOD_1, 2.0, "a Protocol 1.0 packet is among them"),
    ],
)
def test_the_wrong_protocol_is_named(wire, protocol, says):
    (found,) = Explainer(protocol).explain(wire)
    assert says in found.faults[0]


def fast_question_and_blocks():
    by_means = {vector.entry["means"]: vector for vector in load()}
    question = by_means["4 bytes from address 132, present_position, of servos 3, 7 and 4"]
    return question.wire, by_means["servo 3 is at 166, servo 7 at 2079, servo 4 at 1023"].blocks


def test_a_block_whose_crc_does_not_go_on_from_the_header_is_found():
    question, blocks = fast_question_and_blocks()
    wire = bytearray(encode_fast_status(blocks)[:-2])
    wire[22:24] = little(crc16(bytes(wire[16:22])))  # of the second block by itself
    explainer = Explainer(2.0)
    explainer.explain(question)
    (found,) = explainer.explain(with_crc(bytes(wire)))
    assert "block of servo 7" in found.faults[0]
    assert "it covers its block only" in found.faults[0]


def test_a_block_of_another_servo_than_asked_is_found():
    question, blocks = fast_question_and_blocks()
    explainer = Explainer(2.0)
    explainer.explain(question)
    (found,) = explainer.explain(encode_fast_status([blocks[1], blocks[0], blocks[2]]))
    assert found.faults[0] == "block 1 is of servo 7, due is servo 3"


def test_a_collision_is_bad_whatever_is_left_of_it():
    (found,) = Explainer().explain(GOOD_2, WireEventKind.COLLISION)
    assert found.faults == ("collision: it met other bytes on the wire",)


def test_the_official_python_sdk_sends_what_is_called_not_stuffed():
    class Wire:
        is_using = False
        sent = b""

        def clearPort(self):  # noqa: N802
            pass

        def writePort(self, packet):  # noqa: N802
            self.sent = bytes(packet)
            return len(packet)

    wire = Wire()
    PacketHandler(2.0).writeTxOnly(wire, 1, 30, 3, [0xFF, 0xFF, 0xFD])
    (found,) = Explainer().explain(wire.sent)
    assert "official Python SDK" in found.faults[0]
    assert len(found.faults) == 1
