"""What servos do with instructions, asked by the official SDK."""

from __future__ import annotations

import pytest
from dynamixel_sdk import GroupBulkRead, GroupBulkWrite
from virtual_bus import (
    ACCESS_2,
    ANGLE_1,
    AX,
    CHECKSUM_1,
    CRC_2,
    INSTRUCTION_1,
    INSTRUCTION_2,
    LENGTH_2,
    LIMIT_2,
    OK,
    RANGE_1,
    RANGE_2,
    RESULT_2,
    ROBOT,
    TIMEOUT,
    XL,
    Bench,
    ScriptedPlant,
    count_rad,
    small_robot,
)

BOTH = pytest.mark.parametrize("model", [AX, XL])
NUMBER = {AX: 12, XL: 350}
FACTORY, REBOOT, ACTION = 0x06, 0x08, 0x05
BROADCAST = 254


def error(model: str, one: int, two: int) -> int:
    return one if model == AX else two


# -- ping, read, write --------------------------------------------------------------------------


@BOTH
def test_ping_brings_the_model_number(model: str) -> None:
    bench = Bench(model)
    assert [bench.ping(i) for i in (1, 2, 3)] == [(NUMBER[model], OK, 0)] * 3
    assert bench.ping(4) == (0, TIMEOUT, 0)


@BOTH
def test_written_values_are_read_back(model: str) -> None:
    bench = Bench(model)
    for name, value in (("goal_position", 700), ("moving_speed", 100), ("led", 1)):
        bench.set(name, value, 2)
        assert bench.get(name, 2) == value
        assert bench.get(name, 1) != value


@BOTH
def test_goal_position_moves_the_joint_when_torque_is_on(model: str) -> None:
    bench = Bench(model)
    bench.set("goal_position", 700)
    bench.sleep(0.5)
    assert bench.get("present_position") == 512
    bench.set("torque_enable", 1)
    bench.sleep(1.5)
    assert bench.get("present_position") == 700
    assert bench.get("present_position", 2) == 512


@BOTH
def test_power_on_goal_is_where_the_servo_stands_and_torque_is_off(model: str) -> None:
    plant = ScriptedPlant()
    plant.angle = lambda servo_id, now_s: count_rad(None, 600 + servo_id)
    bench = Bench(model, plant)
    for i in (1, 2, 3):
        assert bench.get("goal_position", i) == bench.get("present_position", i) == 600 + i
        assert bench.get("torque_enable", i) == 0
        assert bench.get("torque_limit", i) == bench.get("max_torque", i) == 1023


@BOTH
def test_many_registers_are_read_at_once(model: str) -> None:
    bench = Bench(model)
    data, result, problem = bench.sdk.readTxRx(bench.port, 1, 0, bench.table.size)
    assert (result, problem) == (OK, 0)
    assert len(data) == bench.table.size
    assert data[0] | data[1] << 8 == NUMBER[model]
    assert data[3] == 1


@BOTH
def test_read_beyond_the_table_is_refused_and_brings_no_data(model: str) -> None:
    bench = Bench(model)
    status = bench.instruct(2, [250, 2] if model == AX else [0xFF, 0x0F, 2, 0])
    assert status.error == error(model, RANGE_1, ACCESS_2)
    assert status.parameters == b""


@BOTH
def test_write_to_a_read_only_register_is_refused(model: str) -> None:
    bench = Bench(model)
    before = bench.image()
    assert bench.write("present_position", 3) == (OK, error(model, RANGE_1, ACCESS_2))
    assert bench.write("model_number", 3) == (OK, error(model, RANGE_1, ACCESS_2))
    assert bench.image() == before


@BOTH
def test_value_outside_its_range_is_refused(model: str) -> None:
    bench = Bench(model)
    before = bench.image()
    for name, value in (("torque_enable", 2), ("return_delay_time", 255), ("torque_limit", 1024)):
        assert bench.write(name, value) == (OK, error(model, RANGE_1, RANGE_2)), name
    assert bench.image() == before


@BOTH
def test_goal_outside_the_angle_limits_is_refused(model: str) -> None:
    bench = Bench(model)
    bench.set("cw_angle_limit", 400)
    bench.set("ccw_angle_limit", 600)
    for goal in (399, 601):
        assert bench.write("goal_position", goal) == (OK, error(model, ANGLE_1, LIMIT_2))
    assert bench.get("goal_position") == 512
    for goal in (400, 600):
        bench.set("goal_position", goal)


@BOTH
def test_wheel_mode_turns_by_moving_speed_and_knows_no_goal_limits(model: str) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    if model == AX:
        bench.set("cw_angle_limit", 0)
        bench.set("ccw_angle_limit", 0)
    else:
        bench.set("control_mode", 1)
    bench.set("torque_enable", 1)
    for raw, rpm in ((100, 11.1), (1024 + 100, -11.1)):
        bench.set("moving_speed", raw)
        command = plant.last()
        assert command.operating_mode.value == "velocity"
        assert command.goal_velocity_rad_s == pytest.approx(rpm * 0.1047198, rel=1e-4)
    bench.set("goal_position", 1000)


@BOTH
def test_write_over_several_registers_is_all_or_nothing(model: str) -> None:
    bench = Bench(model)
    before = bench.image()
    # goal position, moving speed, and what follows: torque limit of AX is at 34, 35 of XL-320
    good = b"\xbc\x02\x64\x00" + (b"" if model == AX else b"\x00") + b"\xf4\x01"
    bad = good[:-2] + b"\x00\x04"
    assert bench.write_bytes(30, bad)[1] == error(model, RANGE_1, RANGE_2)
    assert bench.image() == before
    assert bench.write_bytes(30, good) == (OK, 0)
    assert [bench.get(n) for n in ("goal_position", "moving_speed", "torque_limit")] == [
        700,
        100,
        500,
    ]


@BOTH
def test_write_that_runs_into_a_read_only_register_changes_nothing(model: str) -> None:
    bench = Bench(model)
    before = bench.image()
    data = (
        b"\xbc\x02\x64\x00\xf4\x01\x00\x02"
        if model == AX
        else b"\xbc\x02\x64\x00\x00\xf4\x01\x00\x02"
    )
    assert bench.write_bytes(30, data)[1] == error(model, RANGE_1, ACCESS_2)
    assert bench.image() == before


# -- registered writes --------------------------------------------------------------------------


@BOTH
def test_registered_write_waits_for_action(model: str) -> None:
    bench = Bench(model)
    assert bench.reg_write("goal_position", 700) == (OK, 0)
    assert bench.get("goal_position") == 512
    assert bench.get("registered_instruction") == 1
    assert bench.instruct(ACTION).error == 0
    assert bench.get("goal_position") == 700
    assert bench.get("registered_instruction") == 0


@BOTH
def test_action_without_a_registered_write_is_refused(model: str) -> None:
    bench = Bench(model)
    assert bench.instruct(ACTION).error == error(model, INSTRUCTION_1, INSTRUCTION_2)


@BOTH
def test_broadcast_action_acts_on_all_at_one_instant_without_a_status(model: str) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    for i in (1, 2, 3):
        bench.reg_write("goal_position", 600 + i, i)
    before = len(plant.commands[1])
    assert bench.sdk.action(bench.port, BROADCAST) == OK
    assert bench.sleep(0.02) == b""
    assert [bench.get("goal_position", i) for i in (1, 2, 3)] == [601, 602, 603]
    assert len({plant.commands[i][before][0] for i in (1, 2, 3)}) == 1


@BOTH
def test_registered_write_is_checked_when_it_is_registered(model: str) -> None:
    bench = Bench(model)
    assert bench.reg_write("goal_position", 1024)[1] != 0
    assert bench.get("registered_instruction") == 0


# -- several servos at once ---------------------------------------------------------------------


@BOTH
def test_sync_write_reaches_those_it_names_and_nobody_answers(model: str) -> None:
    bench = Bench(model)
    address = bench.table["goal_position"].address
    assert bench.sync_write(address, {1: b"\x00\x01", 3: b"\x00\x03"}) == OK
    assert bench.sleep(0.02) == b""
    assert [bench.get("goal_position", i) for i in (1, 2, 3)] == [256, 512, 768]


@BOTH
def test_sync_write_refused_by_one_servo_is_taken_by_the_others(model: str) -> None:
    bench = Bench(model)
    errors = bench.bus.counts.errors
    bench.sync_write(bench.table["goal_position"].address, {1: b"\xff\xff", 2: b"\x00\x03"})
    bench.sleep(0.02)
    assert [bench.get("goal_position", i) for i in (1, 2)] == [512, 768]
    assert bench.bus.counts.errors == errors + 1


def test_sync_read_brings_all_in_the_order_asked() -> None:
    bench = Bench(XL)
    for i in (1, 2, 3):
        bench.set("goal_position", 600 + i, i)
    result, values = bench.sync_read("goal_position", [3, 1, 2])
    assert result == OK
    assert values == {3: 603, 1: 601, 2: 602}
    assert [e.data[4] for e in bench.wire[-3:]] == [3, 1, 2]


def test_sync_read_is_unknown_to_protocol_1() -> None:
    bench = Bench(AX)
    assert bench.instruct(0x82, [36, 2, 1, 2]).error == INSTRUCTION_1
    assert bench.send(b"\xff\xff\xfe\x05\x84\x24\x02\x01\x51") == b""


def test_bulk_read_and_bulk_write_name_addresses_for_each_servo() -> None:
    bench = Bench(XL)
    write = GroupBulkWrite(bench.port, bench.sdk)
    write.addParam(1, 30, 2, [0xBC, 2])
    write.addParam(2, 25, 1, [5])
    assert write.txPacket() == OK
    assert bench.sleep(0.02) == b""
    read = GroupBulkRead(bench.port, bench.sdk)
    read.addParam(2, 25, 1)
    read.addParam(1, 30, 2)
    read.addParam(3, 0, 2)
    assert read.txRxPacket() == OK
    assert read.getData(1, 30, 2) == 700
    assert read.getData(2, 25, 1) == 5
    assert read.getData(3, 0, 2) == 350


def test_bulk_read_of_an_ax_is_met_with_silence() -> None:
    bench = Bench(AX)
    assert bench.send(b"\xff\xff\xfe\x09\x92\x00\x02\x01\x24\x02\x02\x24\x15") == b""
    assert bench.ping()[1] == OK


@pytest.mark.parametrize("instruction", [0x8A, 0x9A])
def test_fast_reads_are_met_with_silence_by_an_xl320(instruction: int) -> None:
    bench = Bench(XL)
    for parameters in (bytes([37, 0, 2, 0, 1, 2]), bytes([1, 37, 0, 2, 0])):
        assert bench.send(bench.packet(instruction, parameters, BROADCAST)) == b""
    assert bench.ping()[1] == OK


@BOTH
def test_group_instruction_that_does_not_divide_up_is_nobodys(model: str) -> None:
    bench = Bench(model)
    before = [bench.image(i) for i in range(3)]
    for instruction in (0x83, 0x93, 0x82, 0x92):
        for parameters in (
            b"",
            b"\x1e",
            b"\x1e\x00\x02\x00\x01\x02",
            b"\x1e\x02\x01\x02",
            bytes(7),
        ):
            bench.send(bench.packet(instruction, parameters, BROADCAST))
    assert [bench.image(i) for i in range(3)] == before
    assert bench.ping()[1] == OK


# -- factory reset and reboot -------------------------------------------------------------------

CHANGED = {"id": 7, "return_delay_time": 0, "cw_angle_limit": 100, "led": 1}


def changed(model: str) -> Bench:
    """A servo alone on its bus, with another ID, baud rate and more."""
    bench = Bench(small_robot(model, [7], baud_rate=115_200))
    for name in ("return_delay_time", "cw_angle_limit", "led"):
        bench.set(name, CHANGED[name], 7)
    return bench


def test_factory_reset_of_protocol_1_resets_all() -> None:
    bench = changed(AX)
    assert bench.sdk.factoryReset(bench.port, 7)[0] == OK
    bench.port.setBaudRate(1_000_000)
    assert bench.ping(7)[1] == TIMEOUT
    assert bench.get("return_delay_time") == 250
    assert bench.get("cw_angle_limit") == 0
    assert bench.get("led") == 0


@pytest.mark.parametrize(
    ("option", "servo_id", "baud_rate"), [(0xFF, 1, 1_000_000), (1, 7, 1_000_000), (2, 7, 115_200)]
)
def test_factory_reset_of_protocol_2_keeps_what_its_option_says(
    option: int, servo_id: int, baud_rate: int
) -> None:
    bench = changed(XL)
    assert bench.sdk.factoryReset(bench.port, 7, option)[0] == OK
    bench.port.setBaudRate(baud_rate)
    assert bench.get("return_delay_time", servo_id) == 250
    assert bench.get("cw_angle_limit", servo_id) == 0
    assert bench.get("led", servo_id) == 0
    assert bench.get("id", servo_id) == servo_id


def test_factory_reset_of_all_by_broadcast_is_refused() -> None:
    bench = Bench(XL)
    for i in (1, 2, 3):
        bench.set("return_delay_time", 10, i)
    bench.sdk.factoryReset(bench.port, BROADCAST, 0xFF)
    bench.sleep(0.5)
    assert [bench.get("return_delay_time", i) for i in (1, 2, 3)] == [10] * 3
    bench.sdk.factoryReset(bench.port, BROADCAST, 0x01)
    bench.sleep(0.5)
    assert [bench.get("return_delay_time", i) for i in (1, 2, 3)] == [250] * 3


@pytest.mark.parametrize(
    ("parameters", "number"), [([], LENGTH_2), ([3], RANGE_2), ([1, 1], LENGTH_2)]
)
def test_factory_reset_without_a_known_option_is_refused(
    parameters: list[int], number: int
) -> None:
    bench = Bench(XL)
    assert bench.instruct(FACTORY, parameters).error == number


def test_reboot_answers_then_is_deaf_then_comes_back_with_ram_reset() -> None:
    bench = Bench(XL)
    bench.set("cw_angle_limit", 100)
    bench.set("led", 3)
    bench.set("torque_enable", 1)
    assert bench.sdk.reboot(bench.port, 1) == (OK, 0)
    assert bench.ping()[1] == TIMEOUT
    assert bench.ping(2)[1] == OK
    bench.sleep(1.0)
    assert bench.ping()[1] == OK
    assert bench.get("led") == bench.get("torque_enable") == 0
    assert bench.get("cw_angle_limit") == 100


def test_reboot_is_undefined_in_protocol_1() -> None:
    assert Bench(AX).instruct(REBOOT).error == INSTRUCTION_1


# -- who answers what ---------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("level", [0, 1, 2])
def test_status_return_level_says_what_is_answered(model: str, level: int) -> None:
    bench = Bench(model)
    bench.write("status_return_level", level)
    assert bench.instruct(1) is not None
    assert bench.read("led")[1] == (OK if level >= 1 else TIMEOUT)
    assert bench.write("led", 1)[0] == (OK if level == 2 else TIMEOUT)
    assert bench.memory("led") == 1
    assert bench.reg_write("led", 0)[0] == (OK if level == 2 else TIMEOUT)
    assert (bench.instruct(ACTION) is not None) == (level == 2)
    assert bench.memory("led") == 0


@pytest.mark.parametrize("level", [0, 1])
def test_status_return_level_holds_for_sync_read_too(level: int) -> None:
    bench = Bench(XL)
    bench.write("status_return_level", level, 2)
    result, _ = bench.sync_read("led", [1, 2, 3])
    assert (result == OK) == (level == 1)
    assert [e.data[4] for e in bench.wire if len(e.data) == 12] == (
        [1] if level == 0 else [1, 2, 3]
    )


@BOTH
def test_broadcast_write_is_taken_by_all_and_answered_by_none(model: str) -> None:
    bench = Bench(model)
    bench.sdk.write1ByteTxOnly(bench.port, BROADCAST, 25, 1)
    assert bench.sleep(0.05) == b""
    assert [bench.memory("led", i) for i in range(3)] == [1, 1, 1]


@BOTH
def test_broadcast_read_is_not_answered(model: str) -> None:
    bench = Bench(model)
    parameters = b"\x24\x02" if model == AX else b"\x25\0\2\0"
    assert bench.send(bench.packet(2, parameters, BROADCAST)) == b""


@BOTH
def test_undefined_instruction_is_refused(model: str) -> None:
    for instruction in (0x33, 0x77):
        status = Bench(model).instruct(instruction, [1, 2])
        assert status.error == error(model, INSTRUCTION_1, INSTRUCTION_2)


@BOTH
@pytest.mark.parametrize("instruction", [2, 3, 4])
def test_read_or_write_of_the_wrong_length_is_refused(model: str, instruction: int) -> None:
    for parameters in ([], [30]) if model == AX else ([], [30], [30, 0]):
        problem = Bench(model).instruct(instruction, parameters).error
        assert problem == error(model, INSTRUCTION_1, LENGTH_2)


@BOTH
def test_wrong_checksum_or_crc_is_answered_by_the_servo_addressed(model: str) -> None:
    bench = Bench(model)
    if model == AX:
        assert bench.send(b"\xff\xff\x01\x04\x02\x24\x02\x00") == b"\xff\xff\x01\x02\x10\xec"
    else:
        reply = bench.send(b"\xff\xff\xfd\x00\x01\x03\x00\x01\x00\x00")
        assert reply[:9] == b"\xff\xff\xfd\x00\x01\x04\x00\x55" + bytes([CRC_2])
    assert bench.image() == Bench(model).image()
    assert CHECKSUM_1 == 0x10
    assert bench.ping()[1] == OK


# -- EEPROM -------------------------------------------------------------------------------------


def test_ax_lock_guards_the_eeprom_until_power_is_cut() -> None:
    bench = Bench(AX)
    bench.set("return_delay_time", 100)
    bench.set("lock", 1)
    assert bench.write("return_delay_time", 50) == (OK, RANGE_1)
    assert bench.write("lock", 0) == (OK, RANGE_1)
    bench.set("led", 1)
    assert bench.get("return_delay_time") == 100


def test_xl320_torque_guards_the_eeprom() -> None:
    bench = Bench(XL)
    bench.set("return_delay_time", 100)
    bench.set("torque_enable", 1)
    assert bench.write("return_delay_time", 50) == (OK, ACCESS_2)
    bench.set("led", 1)
    bench.set("torque_enable", 0)
    bench.set("return_delay_time", 50)


@BOTH
def test_new_id_holds_from_the_next_packet_on(model: str) -> None:
    bench = Bench(model)
    bench.set("id", 9)  # the SDK takes a status from the old ID only
    assert bench.ping(1)[1] == TIMEOUT
    assert bench.ping(9) == (NUMBER[model], OK, 0)


@BOTH
def test_new_baud_rate_holds_from_the_next_packet_on(model: str) -> None:
    bench = Bench(model)
    bench.set("baud_rate", 16 if model == AX else 2)
    assert bench.ping()[1] == TIMEOUT
    bench.port.setBaudRate(115_200)
    assert bench.ping()[1] == OK
    assert bench.ping(2)[1] == TIMEOUT


def test_undervalued_action_of_a_changed_limit_is_refused() -> None:
    """A registered write is judged again when it acts."""
    bench = Bench(XL)
    assert bench.reg_write("goal_position", 900) == (OK, 0)
    bench.set("ccw_angle_limit", 600)
    assert bench.instruct(ACTION).error == LIMIT_2
    assert bench.get("goal_position") == 512


def test_result_fail_is_the_number_for_what_could_not_be_done() -> None:
    bench = Bench(ROBOT[XL], plant := ScriptedPlant(range(1, 19)))
    plant.temperature_c = 80.0
    bench.sleep(0.1)
    assert bench.write("torque_enable", 1)[1] & 0x7F == RESULT_2
