"""Reads of several servos in one go: fast reads of Protocol 2.0, the bulk read of MX servos."""

import dynamixel_sdk
import pytest
from virtual_bus import IDEAL, OK, TIMEOUT, small_robot

from busemu.assemble import assemble
from busemu.bus import Bus
from busemu.clock import VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.protocol import InstructionPacket, v1, v2
from busemu.tables import load_table
from busemu.timing import load_profile

IDS = tuple(range(1, 19))
X = "XM430-W350"


class Sdk:
    def __init__(self, model, ids=IDS, **changes):
        self.robot = small_robot(model, ids)
        self.clock = VirtualClock()
        self.bus = assemble(self.robot, ideal(self.robot), IDEAL)
        for servo in self.bus.servos:
            for name, raw in changes.items():
                servo.memory[name] = raw
        self.port = SdkPort(self.bus, self.clock)
        self.packets = dynamixel_sdk.PacketHandler(self.robot.protocol)
        self.position = load_table(model)["present_position"]

    def timed_ms(self, act):
        before_s = self.clock.now_s()
        result = act()
        return result, (self.clock.now_s() - before_s) * 1e3


def sync(sdk, ids=IDS, size=2):
    group = dynamixel_sdk.GroupSyncRead(sdk.port, sdk.packets, sdk.position.address, size)
    for servo_id in ids:
        group.addParam(servo_id)
    return group


@pytest.mark.parametrize(("delay", "takes_ms"), [(250, 1.98), (0, 1.48)])
def test_a_fast_sync_read_of_18_is_one_packet_after_one_return_delay(delay, takes_ms):
    sdk = Sdk(X, return_delay_time=delay)
    group = sync(sdk)
    result, took_ms = sdk.timed_ms(group.fastSyncRead)
    assert result == OK
    assert took_ms == pytest.approx(takes_ms, abs=1e-6)


def test_a_fast_sync_read_brings_what_a_sync_read_brings():
    sdk = Sdk(X, IDS)
    slow, fast = sync(sdk, size=4), sync(sdk, size=4)
    assert slow.txRxPacket() == fast.fastSyncRead() == OK
    where = (sdk.position.address, 4)
    got = [fast.getData(servo_id, *where) for servo_id in IDS]
    assert got == [slow.getData(servo_id, *where) for servo_id in IDS]
    assert set(got) == {2048}


def test_a_mute_servo_breaks_a_fast_read_off():
    sdk = Sdk(X, (1, 2, 4))
    assert sync(sdk, (1, 2, 3, 4)).fastSyncRead() != OK
    assert sync(sdk, (1, 2, 4)).fastSyncRead() == OK


def test_servos_without_fast_reads_are_silent():
    old = Sdk("XL-320", (1, 2))
    assert sync(old, (1, 2)).fastSyncRead() == TIMEOUT
    assert sync(old, (1, 2)).txRxPacket() == OK


def test_a_fast_read_of_more_than_a_packet_holds_is_nobodys():
    bulk = b"".join(bytes([i, 0, 0]) + (400).to_bytes(2, "little") for i in (1, 2, 3))
    request = v2.encode_instruction(InstructionPacket(0xFE, 0x9A, bulk))
    sdk = Sdk(X, (1, 2, 3))
    sdk.bus.receive(request, 0.0)
    assert sdk.bus.poll(0.1) == b""
    assert sdk.bus.counts.errors == 1
    fits = v2.encode_instruction(InstructionPacket(0xFE, 0x9A, bulk[:10]))
    sdk.bus.receive(fits, 0.2)
    assert len(sdk.bus.poll(0.3)) == 7 + 1 + 2 * (4 + 400)


def answers_at_once(monkeypatch, model, request, *, one_by_one, **changes):
    """What comes back in the profile without time, and the wire's account of it."""
    if one_by_one:
        monkeypatch.setattr(Bus, "_chain_at_once", lambda *_: 0)
    wire = []
    robot = small_robot(model, (1, 2, 3, 4))
    instant = load_profile("instant")
    bus = assemble(robot, ideal(robot), instant, start_s=1.0, on_wire=wire.append)
    for name, (index, raw) in changes.items():
        bus.servos[index].recall({name: raw}, {})
        bus.servos[index].memory[name] = raw  # in RAM the start has put it back
    bus.poll(1.0)
    bus.receive(request, 1.0)
    return bus.poll(1.0), wire, bus.counts


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"id": (2, 9)},  # a mute one
        {"id": (2, 4)},  # two with one ID
        {"status_return_level": (1, 0)},
        {"baud_rate": (1, 0)},
    ],
)
@pytest.mark.parametrize(
    ("model", "request_"),
    [
        (X, v2.encode_instruction(InstructionPacket(0xFE, 0x82, b"\x84\0\4\0\1\2\3\4"))),
        (X, v2.encode_instruction(InstructionPacket(0xFE, 0x82, b"\xff\0\4\xff\1\2"))),
        ("XL-320", v2.encode_instruction(InstructionPacket(0xFE, 0x82, b"\0\0\4\0\4\2\3"))),
        ("MX-64", v1.encode_instruction(InstructionPacket(0xFE, 0x92, b"\0\2\1\x24\1\2\x2b"))),
    ],
)
def test_a_chain_without_time_is_what_its_turns_are_one_by_one(
    monkeypatch, model, request_, changes
):
    at_once = answers_at_once(monkeypatch, model, request_, one_by_one=False, **changes)
    one_by_one = answers_at_once(monkeypatch, model, request_, one_by_one=True, **changes)
    assert at_once == one_by_one


def test_a_fast_bulk_read_brings_different_registers():
    sdk = Sdk(X, (1, 2, 3))
    table = load_table(X)
    group = dynamixel_sdk.GroupBulkRead(sdk.port, sdk.packets)
    asked = {1: "present_position", 2: "present_input_voltage", 3: "goal_position"}
    for servo_id, name in asked.items():
        group.addParam(servo_id, table[name].address, table[name].size)
    assert group.fastBulkRead() == OK
    for servo_id, name in asked.items():
        expected, result, _ = sdk.packets.readTxRx(
            sdk.port, servo_id, table[name].address, table[name].size
        )
        assert result == OK
        got = group.getData(servo_id, table[name].address, table[name].size)
        assert got == int.from_bytes(bytes(expected), "little")


def bulk_read_1(model, ids):
    """Send a bulk read of Protocol 1.0 and return the bytes that come back.

    The SDK's own class cannot: its txPacket raises TypeError (4.1.0).
    """
    sdk = Sdk(model, ids)
    address = load_table(model)["present_position"].address
    parameters = bytes([0]) + b"".join(bytes([2, i, address]) for i in ids)
    sdk.port.setPacketTimeoutMillis(20.0)
    sdk.port.writePort(v1.encode_instruction(InstructionPacket(0xFE, 0x92, parameters)))
    got = bytearray()
    while not sdk.port.isPacketTimeout():
        got += sdk.port.readPort(100)
    return bytes(got)


def test_mx_servos_answer_a_bulk_read_in_the_order_asked():
    got = bulk_read_1("MX-28", (2, 1))
    assert [got[2], got[10]] == [2, 1]
    assert len(got) == 16


def test_ax_servos_are_silent_to_a_bulk_read():
    assert bulk_read_1("AX-12A", (1, 2)) == b""
