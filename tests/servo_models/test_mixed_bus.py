"""A bus of different models behind the official SDK, in virtual time, moved by the ideal plant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dynamixel_sdk
import pytest
from dynamixel_sdk import GroupBulkRead, GroupSyncRead, GroupSyncWrite
from model_bench import robot_file

from busemu.assemble import assemble
from busemu.clock import VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.tables import load_robot, load_table, models
from busemu.timing import Profile

OK = 0
X_ROBOT = """
format = "busemu-robot/1"
[bus]
protocol = 2.0
baud_rate = 1000000
[[servo]]
id = 1
joint = "a"
model = "XM430-W350"
[[servo]]
id = 2
joint = "b"
model = "XL430-W250"
[[servo]]
id = 3
joint = "c"
model = "MX-28(2.0)"
registers = { drive_mode = 1 }
[[servo]]
id = 4
joint = "d"
model = "XC330-T288"
registers = { operating_mode = 4, firmware_version = 46 }
"""


class Bus:
    """A robot's bus and the SDK on it; registers by name, decoded."""

    def __init__(self, path: Path) -> None:
        self.robot = load_robot(path)
        self.clock = VirtualClock()
        bus = assemble(self.robot, ideal(self.robot), Profile("ideal"))
        self.port = SdkPort(bus, self.clock)
        self.sdk: Any = dynamixel_sdk.PacketHandler(self.robot.protocol)

    def get(self, servo_id: int, name: str) -> int:
        register = self.robot.tables[servo_id][name]
        data, result, error = self.sdk.readTxRx(
            self.port, servo_id, register.address, register.size
        )
        assert (result, error) == (OK, 0), (servo_id, name)
        return register.decode(int.from_bytes(bytes(data), "little"))

    def put(self, servo_id: int, name: str, count: int) -> int:
        """The error of the status packet."""
        register = self.robot.tables[servo_id][name]
        data = register.encode(count).to_bytes(register.size, "little")
        result, error = self.sdk.writeTxRx(
            self.port, servo_id, register.address, len(data), list(data)
        )
        assert result == OK
        return int(error)

    def sleep(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now_s() + seconds)
        self.port.clearPort()


@pytest.fixture
def bus(tmp_path: Path) -> Bus:
    return Bus(robot_file(tmp_path, X_ROBOT))


def test_ping_brings_model_number_and_every_servo_answers_the_broadcast(bus: Bus) -> None:
    for servo_id, number in ((1, 1020), (2, 1060), (3, 30), (4, 1220)):
        assert bus.sdk.ping(bus.port, servo_id) == (number, OK, 0)
    found, result = bus.sdk.broadcastPing(bus.port)
    assert result == OK
    assert found == {1: [1020, 45], 2: [1060, 45], 3: [30, 43], 4: [1220, 46]}


def test_sync_write_moves_all_and_sync_read_tells_where_they_are(bus: Bus) -> None:
    group = GroupSyncWrite(bus.port, bus.sdk, 116, 4)
    for servo_id, goal in ((1, 3000), (2, 1000), (3, 2500), (4, -9000)):
        assert bus.put(servo_id, "torque_enable", 1) == 0
        assert group.addParam(servo_id, list(goal.to_bytes(4, "little", signed=True)))
    assert group.txPacket() == OK
    bus.sleep(8.0)
    read = GroupSyncRead(bus.port, bus.sdk, 132, 4)
    for servo_id in (4, 2, 1, 3):
        read.addParam(servo_id)
    assert read.txRxPacket() == OK
    positions = {i: read.getData(i, 132, 4) for i in (1, 2, 3, 4)}
    assert positions == {1: 3000, 2: 1000, 3: 2500, 4: (-9000) & 0xFFFFFFFF}
    assert all(bus.get(i, "moving") == 0 for i in (1, 2, 3, 4))
    plant = bus.port.bus.plant
    assert plant.sample(3).position_rad < 0.0 < plant.sample(1).position_rad


def test_one_bulk_read_of_indirect_data_brings_what_each_servo_was_told_to_show(bus: Bus) -> None:
    for servo_id in (1, 4):
        for number, address in enumerate((132, 133, 134, 135, 146), 1):
            assert bus.put(servo_id, f"indirect_address_{number}", address) == 0
    group = GroupBulkRead(bus.port, bus.sdk)
    group.addParam(1, 224, 5)
    group.addParam(4, 208, 5)
    group.addParam(2, 144, 2)
    assert group.txRxPacket() == OK
    assert [group.getData(i, start, 4) for i, start in ((1, 224), (4, 208))] == [2048, 2048]
    assert [group.getData(i, start + 4, 1) for i, start in ((1, 224), (4, 208))] == [25, 25]
    assert group.getData(2, 144, 2) == 120


def test_errors_come_as_the_numbers_of_the_protocol(bus: Bus) -> None:
    data_range, data_limit, access = 4, 6, 7
    assert bus.put(1, "goal_position", 4096) == data_limit
    assert bus.put(1, "led", 2) == data_range
    assert bus.put(1, "present_position", 0) == access
    assert bus.put(2, "goal_velocity", 266) == data_limit
    assert bus.put(2, "operating_mode", 0) == data_range
    assert bus.put(1, "torque_enable", 1) == 0
    assert bus.put(1, "operating_mode", 1) == access


def test_watchdog_of_one_servo_sees_that_the_program_is_gone(bus: Bus) -> None:
    assert bus.put(1, "operating_mode", 1) == 0
    for name, value in (("torque_enable", 1), ("goal_velocity", 50), ("bus_watchdog", 10)):
        assert bus.put(1, name, value) == 0
    bus.sleep(0.15)
    assert bus.get(1, "present_velocity") == 50
    bus.sleep(0.25)
    before = bus.get(1, "present_position")
    bus.sleep(0.5)
    assert bus.get(1, "bus_watchdog") == -1
    assert bus.get(1, "present_position") == before
    assert bus.put(1, "goal_velocity", 50) == 4
    assert bus.put(1, "bus_watchdog", 0) == 0
    assert bus.put(1, "goal_velocity", 50) == 0


def test_reboot_clears_what_was_set_in_ram_and_keeps_the_eeprom(bus: Bus) -> None:
    assert bus.put(1, "homing_offset", -500) == 0
    assert bus.put(1, "position_p_gain", 5) == 0
    assert bus.sdk.reboot(bus.port, 1) == (OK, 0)
    bus.sleep(0.5)
    assert bus.get(1, "position_p_gain") == 800
    assert bus.get(1, "homing_offset") == -500
    assert 400 < bus.get(1, "realtime_tick") < 600


def test_mx_and_ax_share_a_bus_of_protocol_1(tmp_path: Path) -> None:
    text = X_ROBOT.split("[[servo]]", maxsplit=1)[0].replace("2.0", "1.0")
    for servo_id, model in ((1, "AX-18A"), (2, "MX-64"), (3, "MX-12W")):
        text += f'[[servo]]\nid = {servo_id}\njoint = "j{servo_id}"\nmodel = "{model}"\n'
    bus = Bus(robot_file(tmp_path, text))
    assert [bus.sdk.ping(bus.port, i)[0] for i in (1, 2, 3)] == [18, 310, 360]
    for servo_id, goal in ((1, 700), (2, 3000), (3, 1000)):
        assert bus.put(servo_id, "torque_enable", 1) == 0
        assert bus.put(servo_id, "goal_position", goal) == 0
    bus.sleep(2.0)
    assert [bus.get(i, "present_position") for i in (1, 2, 3)] == [700, 3000, 1000]


@pytest.mark.parametrize("model", models())
def test_every_model_answers_for_each_of_its_registers(model: str, tmp_path: Path) -> None:
    table = load_table(model)
    maximum = table["max_voltage_limit"].initial
    assert maximum is not None
    text = X_ROBOT.split("[[servo]]", maxsplit=1)[0].replace("2.0", str(table.protocol))
    text += f'[[servo]]\nid = 7\njoint = "j"\nmodel = "{model}"\n'
    text += f"[supply.voltage_v]\nvalue = {maximum / 10}\n"
    bus = Bus(robot_file(tmp_path, text))
    for register in table.registers:
        bus.get(7, register.name)
        if register.writable and register.initial is not None and register.name != "baud_rate":
            count = 7 if register.name == "id" else register.decode(register.initial)
            if register.name == "lock":
                continue
            assert bus.put(7, register.name, count) == 0, register.name
