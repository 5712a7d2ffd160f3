"""The bus client against bytes built without it: the manual's packets, and sums done by hand."""

import math
import os

import pytest
from hal_doubles import BYTE_S, FakeClock, ScriptedPort, packet, x_table

from busemu.tables import load_table
from hal.access import Access, Failure
from hal.bus_client import BusClient, open_port
from hal.bus_errors import (
    CorruptReplyError,
    NoReplyError,
    PortError,
    PortLostError,
    ServoError,
    UnsendableError,
)

READ_2B = packet("FF FF 01 04 02 2B 01 CC")  # e-manual, Protocol 1.0, read
IS_32 = packet("FF FF 01 03 00 20 DB")
# e-manual, Protocol 2.0, sync_read of present_position from servos 1 and 2
SYNC_READ = packet("FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA")
FIRST = packet("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0")
SECOND = packet("FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE")


def client1(*replies):
    clock = FakeClock()
    port = ScriptedPort(clock, replies)
    log = []
    ax = load_table("AX-12A")
    return BusClient(port, dict.fromkeys(range(1, 20), ax), 1.0, clock, log.append), port, log


def client2(*replies, table=None):
    clock = FakeClock()
    port = ScriptedPort(clock, replies)
    log = []
    tables = dict.fromkeys((1, 2, 3), table or x_table())
    return BusClient(port, tables, 2.0, clock, log.append), port, log


def crc(data):
    """CRC-16 of Protocol 2.0, bit by bit: polynomial 0x8005, initial 0, MSB first."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1) ^ (0x8005 if value & 0x8000 else 0)
        value &= 0xFFFF
    return value


def status2(servo_id, error, parameters=b""):
    length = len(parameters) + 4
    body = b"\xff\xff\xfd\x00" + bytes((servo_id, length & 0xFF, length >> 8, 0x55, error))
    body += parameters
    return body + crc(body).to_bytes(2, "little")


def test_the_helper_makes_the_manuals_packets():
    assert status2(1, 0, packet("A6 00 00 00")) == FIRST


def test_a_read_sends_the_manuals_packet_and_returns_its_value():
    client, port, log = client1(IS_32)
    assert client.read(1, "present_temperature") == 32
    assert port.written == [READ_2B]
    sent_s = 100.0 + len(READ_2B) * BYTE_S
    assert log[0].t_s == pytest.approx(sent_s, abs=1e-9)
    assert log[0].t_reply_s == pytest.approx(sent_s + len(IS_32) * BYTE_S, abs=1e-9)
    assert (log[0].servo_id, log[0].op, log[0].register) == (1, "read", "present_temperature")
    assert log[0].raw == 32.0


def test_ping_of_both_protocols():
    client, port, _ = client1(packet("FF FF 01 02 00 FC"), packet("FF FF 01 04 00 0C 00 EE"))
    assert client.ping(1) == 12
    assert port.written[0] == packet("FF FF 01 02 01 FB")
    client, port, _ = client2(packet("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"))
    assert client.ping(1) == 1030
    assert port.written == [packet("FF FF FD 00 01 03 00 01 19 4E")]


def test_a_write_sends_the_manuals_packet_and_is_logged_without_a_reply_time():
    client, port, log = client2(packet("FF FF FD 00 01 04 00 55 00 A1 0C"))
    client.write(1, "goal_position", 512)
    assert port.written == [packet("FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89")]
    assert log[0].op == "write"
    assert log[0].raw == 512.0
    assert math.isnan(log[0].t_reply_s)
    assert log[0].t_s == pytest.approx(100.0 + 16 * BYTE_S, abs=1e-9)


def test_a_sync_write_sends_the_manuals_packet_and_logs_a_row_a_servo():
    client, port, log = client2()
    client.sync_write("goal_position", {1: 150, 2: 170})
    expected = "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87"
    assert port.written == [packet(expected)]
    assert [(a.servo_id, a.raw) for a in log] == [(1, 150.0), (2, 170.0)]
    assert log[0].t_s == log[1].t_s
    client.sync_write("goal_position", {2: 170})  # a later one does not keep the first's servos
    assert port.written[1][12] == 2


def test_a_sync_write_of_protocol_1_carries_all_servos():
    client, port, _ = client1()
    client.sync_write("goal_position", {1: 0x0123, 2: 0x0345})
    body = packet("FE 0A 83 1E 02 01 23 01 02 45 03")
    assert port.written == [b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))]


def test_a_sync_read_gives_each_servo_its_own_reply_time():
    client, port, log = client2(FIRST + SECOND)
    assert client.read_all("present_position", (1, 2)) == {1: 0xA6, 2: 0x081F}
    assert port.written == [SYNC_READ]
    sent_s = 100.0 + len(SYNC_READ) * BYTE_S
    assert [a.t_s for a in log] == pytest.approx([sent_s, sent_s], abs=1e-9)
    arrival_s = [sent_s + 15 * BYTE_S, sent_s + 30 * BYTE_S]
    assert [a.t_reply_s for a in log] == pytest.approx(arrival_s, abs=1e-9)
    assert client.statistics.transactions == 1


def test_a_mute_servo_in_a_sync_read_costs_it_and_its_successors_only():
    client, port, log = client2(FIRST)
    assert client.read_all("present_position", (1, 2, 3)) == {1: 0xA6, 2: None, 3: None}
    assert client.statistics.failures == {Failure.NO_REPLY: 2}
    assert [math.isnan(a.raw) for a in log] == [False, True, True]
    assert [math.isnan(a.t_reply_s) for a in log] == [False, True, True]
    assert not port.is_using


def test_a_corrupt_reply_in_a_sync_read_does_not_cost_the_next():
    client, _, _ = client2(FIRST[:-1] + b"\x00" + SECOND)
    assert client.read_all("present_position", (1, 2)) == {1: None, 2: 0x081F}
    assert client.statistics.failures == {Failure.CORRUPT: 1}


def test_protocol_1_reads_one_by_one_and_carries_on_past_a_mute_servo():
    client, port, log = client1(b"", packet("FF FF 02 03 00 20 DA"))
    assert client.read_all("present_temperature", (1, 2)) == {1: None, 2: 32}
    assert len(port.written) == 2
    assert math.isnan(log[0].raw)
    assert client.statistics.failures == {Failure.NO_REPLY: 1}


def test_no_reply_and_a_wrong_checksum_are_told_apart():
    client, _, log = client1(b"", IS_32[:-1] + b"\x00")
    with pytest.raises(NoReplyError, match="servo 1: read of present_temperature: no status"):
        client.read(1, "present_temperature")
    with pytest.raises(CorruptReplyError):
        client.read(1, "present_temperature")
    assert client.statistics.failures == {Failure.NO_REPLY: 1, Failure.CORRUPT: 1}
    assert len(log) == 2


def test_an_alert_keeps_the_value_and_is_counted():
    client, _, _ = client1(packet("FF FF 01 03 24 20 B7"))  # overload and overheating
    assert client.read(1, "present_temperature") == 32
    assert client.statistics.alerts == {1: 1}
    assert client.statistics.alert_bits == {1: 0x24}
    assert not client.statistics.failures
    client, _, _ = client2(status2(1, 0x80, b"\xa6\0\0\0") + status2(2, 0, b"\1\0\0\0"))
    assert client.read_all("present_position", (1, 2)) == {1: 0xA6, 2: 1}
    assert client.statistics.alerts == {1: 1}


def test_a_refusal_is_an_error_in_the_manuals_words():
    refused = packet("FF FF 01 02 02 FA")  # angle limit
    client, _, log = client1(refused)
    with pytest.raises(ServoError, match="write of goal_position: angle limit error") as caught:
        client.write(1, "goal_position", 1000)
    assert caught.value.error == 2
    assert log[0].op == "write"  # it was sent
    client, _, _ = client2(status2(1, 0x07))
    with pytest.raises(ServoError, match="access error"):
        client.read(1, "present_position")


def test_a_status_without_the_value_is_not_read_as_its_checksum():
    """The SDK alone would return the CRC's bytes as the value."""
    xl320 = load_table("XL-320")
    client, _, _ = client2(status2(1, 0), table=xl320)
    with pytest.raises(CorruptReplyError, match="too short"):
        client.read(1, "present_position")
    client, _, _ = client1(packet("FF FF 01 02 00 FC"))
    with pytest.raises(CorruptReplyError, match="too short"):
        client.read(1, "present_temperature")


@pytest.mark.parametrize("raw", [0x00FDFFFF, 0xFDFFFF00, 0xFFFDFFFF])
def test_a_write_the_sdk_would_send_unstuffed_is_refused(raw):
    client, port, log = client2()
    with pytest.raises(UnsendableError, match="FF FF FD"):
        client.write(1, "goal_position", raw)
    with pytest.raises(UnsendableError, match="FF FF FD"):
        client.sync_write("goal_position", {2: 5, 1: raw})
    assert not port.written
    assert not log


def test_a_value_too_large_for_its_bytes_is_refused():
    client, port, _ = client1()
    with pytest.raises(ValueError, match="does not fit in 1 byte"):
        client.write(1, "torque_enable", 256)
    assert not port.written


def test_too_many_servos_for_one_packet_are_refused_with_the_cause():
    clock = FakeClock()
    port = ScriptedPort(clock, [])
    client = BusClient(port, dict.fromkeys(range(254), load_table("AX-12A")), 1.0, clock)
    with pytest.raises(UnsendableError, match="fewer servos"):
        client.sync_write("goal_position", dict.fromkeys(range(90), 0))


@pytest.mark.parametrize("cut", [KeyboardInterrupt(), OSError("gone")])
def test_after_a_transaction_is_cut_off_the_next_can_be_sent(cut):
    client, port, log = client1(cut, IS_32)
    with pytest.raises((KeyboardInterrupt, PortLostError)):
        client.read(1, "present_temperature")
    assert math.isnan(log[0].raw)
    assert client.read(1, "present_temperature") == 32
    assert not port.is_using


def test_a_missing_port_and_a_port_that_is_none_are_named(tmp_path):
    with pytest.raises(PortError, match="no such port"):
        open_port(str(tmp_path / "ttyNONE"), 1_000_000)
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(PortError, match="not a serial port"):
        open_port(str(file), 1_000_000)
    with pytest.raises(PortError, match="does not offer 12345 baud"):
        open_port(os.devnull, 12345)


def test_without_a_listener_nothing_is_logged():
    clock = FakeClock()
    client = BusClient(ScriptedPort(clock, [IS_32]), {1: load_table("AX-12A")}, 1.0, clock)
    assert client.read(1, "present_temperature") == 32


def test_an_access_is_frozen():
    access = Access(0.0, 0.0, 1, "read", "present_position", 1.0)
    with pytest.raises(AttributeError):
        access.raw = 2.0  # type: ignore[misc]
