"""Good packets in words; any bytes at all are explained, and every byte is part of something."""

import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

sys.path.append(str(Path(__file__).parents[1] / "protocol"))
from wire_vectors import load

from busemu.protocol import InstructionPacket, StatusPacket, v1, v2
from busemu.tables import load_table
from busemu.trace import WireEventKind
from busemu.traffic.explain import Explainer, Tables, brief, long

MODEL = {1.0: "AX-12A", 2.0: "XM430-W350"}
KIND = {"instruction": WireEventKind.INSTRUCTION, "status": WireEventKind.STATUS}
#: What must be in the summary of some of the manual's packets, by what they mean.
SAYS = {
    "is servo 1 there?": "ping servo 1",
    "servo 1 reports overload and overheating": "overheating and overload error",
    "servo 0 refuses: range error, its memory is locked": "range error",
    "every servo: do what is registered": "action all servos",
    "register goal_position 500, address 30, in servo 1": "goal_position = 500 (-0.06136 rad)",
    "goal_position: servo 1 to 150, servo 2 to 170": "servo 2 goal_position = 170",
    "servo 1: all but the ID back to the values of the factory": "all but the ID",
    "servo 1: forget the turns": "turns of the present position",
    "servo 1: store the control table": "store the control table",
    "4 bytes from address 132, present_position, of servos 3, 7 and 4": "position of 3, 7, 4",
    "USB2AX: 2 bytes from address 36 of servos 1 and 2": "present_position of 1, 2",
    "servo 1: alert, no error": "alert (see hardware_error_status)",
    "servo 1: data length error": "data length error",
}


def tables(protocol):
    return Tables(default=load_table(MODEL[protocol]))


def one(data, protocol=None, kind=None, explainer=None):
    (explanation,) = (explainer or Explainer(protocol)).explain(data, kind)
    return explanation


def whole(explanations):
    return b"".join(each.data for each in explanations)


@pytest.mark.parametrize("vector", load(), ids=str)
@pytest.mark.parametrize("named", [False, True])
def test_a_packet_of_the_manual_is_good_and_its_fields_are_its_bytes(vector, named):
    explainer = Explainer(None, tables(vector.protocol) if named else None)
    found = one(vector.wire, kind=KIND[vector.entry["kind"]], explainer=explainer)
    assert found.faults == ()
    assert found.protocol == vector.protocol
    assert found.kind == vector.entry["kind"]
    assert found.servo_id == vector.entry["id"]
    assert found.error == vector.entry.get("error")
    assert found.instruction == vector.entry.get("instruction")
    assert b"".join(field.data for field in found.fields) == vector.wire


@pytest.mark.parametrize("vector", [v for v in load() if v.entry["means"] in SAYS], ids=str)
def test_a_packet_of_the_manual_says_what_the_manual_says(vector):
    explainer = Explainer(None, tables(vector.protocol))
    found = one(vector.wire, kind=KIND[vector.entry["kind"]], explainer=explainer)
    assert SAYS[vector.entry["means"]] in found.summary


def test_a_misprint_of_the_manual_is_found():
    (vector,) = [v for v in load() if "misprint" in v.entry]
    found = one(bytes.fromhex(vector.entry["misprint"]))
    assert found.faults[0].startswith("CRC is 92 F5, these bytes give 9E F5")


def test_an_answer_is_read_in_the_light_of_the_question():
    explainer = Explainer(None, tables(2.0))
    explainer.explain(bytes.fromhex("FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"))
    found = one(bytes.fromhex("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"), explainer=explainer)
    assert found.summary == "servo 1: present_position = 166 (-2.887 rad)"
    (value,) = found.values
    assert (value.servo_id, value.address, value.raw) == (1, 132, 166)


def test_the_blocks_of_a_fast_answer_are_told_apart():
    explainer = Explainer(None, tables(2.0))
    by_means = {vector.entry["means"]: vector.wire for vector in load()}
    explainer.explain(by_means["4 bytes from address 132, present_position, of servos 3, 7 and 4"])
    wire = by_means["servo 3 is at 166, servo 7 at 2079, servo 4 at 1023"]
    found = one(wire, explainer=explainer)
    assert not found.faults
    assert [value.raw for value in found.values] == [166, 2079, 1023]
    assert [value.servo_id for value in found.values] == [3, 7, 4]


def test_a_protocol_1_answer_is_known_by_the_question_before_it():
    explainer = Explainer(None, tables(1.0))
    reboot_or_range_error = v1.encode_status(StatusPacket(1, 8))
    assert one(reboot_or_range_error).kind == "instruction"
    assert "from a servo" in one(reboot_or_range_error).notes[0]
    explainer.explain(v1.encode_instruction(InstructionPacket(1, 3, b"\x1e\xff\xff")))
    assert one(reboot_or_range_error, explainer=explainer).summary == "servo 1: range error"


def test_a_question_that_is_asked_again_is_no_answer():
    explainer = Explainer(1.0, tables(1.0))
    ping = v1.encode_instruction(InstructionPacket(1, 1))
    assert [one(ping, explainer=explainer).kind for _ in range(3)] == ["instruction"] * 3


@pytest.mark.parametrize(
    ("address", "data", "note"),
    [
        (132, b"\1\0\0\0", "present_position is read-only"),
        (65, b"\2", "led takes 0 to 1, not 2"),
        (116, b"\0\2\0\0", ""),
    ],
)
def test_a_write_that_a_servo_will_refuse_is_noted_and_is_no_bad_packet(address, data, note):
    wire = v2.encode_instruction(InstructionPacket(1, 3, address.to_bytes(2, "little") + data))
    found = one(wire, explainer=Explainer(None, tables(2.0)))
    assert not found.bad
    assert [text.split(": ")[1] for text in found.notes] == ([note] if note else [])


def test_a_part_of_a_register_and_bytes_of_none_are_called_so():
    read = v2.encode_instruction(InstructionPacket(1, 2, b"\x84\x00\x02\x00"))
    assert "a part of present_position" in one(read, explainer=Explainer(2.0, tables(2.0))).summary
    nowhere = v2.encode_instruction(InstructionPacket(1, 2, b"\x00\x80\x02\x00"))
    assert "no register" in one(nowhere, explainer=Explainer(2.0, tables(2.0))).summary


@pytest.mark.parametrize(
    ("parameters", "pieces"),
    [
        (b"\x74\x00\xff\xff\xfd\x00", [b"\x74\x00", b"\xff\xff\xfd\xfd\x00"]),
        (b"\x41\x00\xff\xff\xfd", [b"\x41\x00", b"\xff", b"\xff\xfd\xfd"]),
        (b"\xff\xff\xfd\xfd", [b"\xff\xff", b"\xfd\xfd\xfd"]),
    ],
)
def test_a_stuffing_byte_is_shown_where_it_is_and_is_no_data(parameters, pieces):
    wire = v2.encode_instruction(InstructionPacket(1, 3, parameters))
    found = one(wire, explainer=Explainer(None, tables(2.0)))
    assert not found.faults
    assert [field.data for field in found.fields[5:-1]] == pieces
    assert [("stuffing" in field.words) for field in found.fields[5:-1]][-1]
    assert b"".join(value.data for value in found.values) == parameters[2:]


def test_packets_of_both_protocols_in_one_stream_tell_themselves_apart():
    wires = [vector.wire for vector in load()]
    found = Explainer().explain(b"".join(wires))
    assert [each.data for each in found] == wires
    assert not any(each.bad for each in found)


bytes_like_packets = st.lists(
    st.one_of(
        st.binary(max_size=12),
        st.sampled_from([vector.wire for vector in load()]),
        st.sampled_from(
            [b"\xff\xff", b"\xff\xff\xfd\x00", b"\xff\xff\xfd\xfd", b"\xff\xff\xfd\x01"]
        ),
        st.builds(
            lambda wire, at, byte: wire[: at % len(wire)] + byte + wire[at % len(wire) + 1 :],
            st.sampled_from([vector.wire for vector in load()]),
            st.integers(0, 99),
            st.binary(max_size=1),
        ),
        st.builds(lambda body: v2._encode(1, body), st.binary(min_size=1, max_size=12)),
        st.builds(lambda body: v2._encode(254, body), st.binary(min_size=1, max_size=12)),
        st.builds(
            lambda number, body: v1.encode_instruction(InstructionPacket(1, number, body)),
            st.integers(0, 255),
            st.binary(max_size=8),
        ),
    ),
    max_size=6,
).map(b"".join)


@settings(max_examples=400, deadline=None)
@given(
    portions=st.lists(bytes_like_packets, max_size=3),
    protocol=st.sampled_from([None, 1.0, 2.0]),
    kind=st.sampled_from([None, *WireEventKind]),
    named=st.booleans(),
)
def test_any_bytes_are_explained_and_none_is_lost(portions, protocol, kind, named):
    explainer = Explainer(protocol, tables(2.0 if protocol == 2.0 else 1.0) if named else None)
    for data in portions:
        found = explainer.explain(data, kind)
        assert whole(found) == data
        for each in found:
            assert b"".join(field.data for field in each.fields) == each.data
            assert each.kind in ("instruction", "status", "noise", "fragment")
            assert each.bad or each.kind in ("instruction", "status")
            assert list(brief(each))
            assert list(long(each))
