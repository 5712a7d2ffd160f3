"""Reads of several servos in one go: fast reads of Protocol 2.0, the bulk read of MX servos."""

import dynamixel_sdk
import pytest
from virtual_bus import IDEAL, OK, TIMEOUT, small_robot

from busemu.assemble import assemble
from busemu.clock import VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.protocol import InstructionPacket, v1
from busemu.tables import load_table

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
