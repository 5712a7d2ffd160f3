"""Clear and control table backup, by model and firmware; asked by the SDK where it can."""

from __future__ import annotations

import dynamixel_sdk
import pytest
from dynamixel_sdk import PacketHandler
from model_bench import OneServo, robot_file

from busemu.assemble import assemble
from busemu.clock import VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.protocol import Error2, Instruction
from busemu.servo import Servo
from busemu.tables import ServoMount, load_robot, load_table
from busemu.timing import Profile

X = "XM430-W350"
CLEAR, BACKUP = Instruction.CLEAR, Instruction.CONTROL_TABLE_BACKUP
TURNS, ERRORS = b"\x01DXL\x22", b"\x02ERCL"
STORE, RESTORE = b"\x01CTRL", b"\x02CTRL"
EXTENDED, TURN = 4, 4096


def turned(**registers: int) -> OneServo:
    """An X servo in extended position mode, whose shaft has gone on three turns."""
    servo = OneServo(X, at_count=700, operating_mode=EXTENDED, **registers)
    servo.stand(700 + 3 * TURN)
    assert servo.get("present_position") == 700 + 3 * TURN
    return servo


def test_clear_forgets_the_turns_and_the_servo_holds_where_it_stands() -> None:
    servo = turned()
    servo.set(torque_enable=1)
    held = servo.command.goal_position_rad
    servo.set(goal_position=700 + 3 * TURN)
    assert servo.instruct(CLEAR, TURNS).error == 0
    assert servo.get("present_position") == servo.get("goal_position") == 700
    assert servo.command.goal_position_rad == pytest.approx(servo.joint.state.position_rad)
    assert servo.command.goal_position_rad != held


def test_clear_of_turns_fails_while_the_servo_moves() -> None:
    servo = turned()
    servo.state(velocity_rad_s=5.0)
    assert servo.instruct(CLEAR, TURNS).error == Error2.RESULT_FAIL
    assert servo.get("present_position") == 700 + 3 * TURN


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        (b"", Error2.DATA_LENGTH),
        (TURNS[:-1], Error2.DATA_LENGTH),
        (TURNS + b"\x00", Error2.DATA_LENGTH),
        (b"\x01DXL\x23", Error2.DATA_RANGE),
        (b"\x03DXL\x22", Error2.DATA_RANGE),
        (ERRORS, Error2.DATA_RANGE),
    ],
)
def test_clear_that_is_not_as_the_manual_says_changes_nothing(
    parameters: bytes, error: int
) -> None:
    servo = turned()
    assert servo.instruct(CLEAR, parameters).error == error
    assert servo.get("present_position") == 700 + 3 * TURN


@pytest.mark.parametrize(
    ("model", "firmware", "error"),
    [
        (X, 41, Error2.INSTRUCTION),
        (X, 42, 0),
        ("MX-64(2.0)", 42, 0),
        ("XL330-M288", 46, 0),
        ("XL-320", 30, Error2.INSTRUCTION),
    ],
)
def test_clear_comes_with_the_model_and_its_firmware(model: str, firmware: int, error: int) -> None:
    assert OneServo(model, firmware_version=firmware).instruct(CLEAR, TURNS).error == error


def test_a_model_that_clears_errors_forgets_those_whose_cause_is_over(tmp_path) -> None:
    (tmp_path / "y.toml").write_text('extends = "XM430-W350"\n[drive]\nclears_errors = true\n')
    servo = OneServo(str(tmp_path / "y.toml"))
    servo.state(temperature_c=95.0)
    servo.sleep(0.1)
    assert servo.get("hardware_error_status")
    hot = servo.instruct(CLEAR, ERRORS)
    assert hot.error & 0x7F == Error2.RESULT_FAIL
    servo.state(temperature_c=30.0)
    servo.sleep(0.1)
    assert servo.get("hardware_error_status")  # what shut it down stays
    assert servo.instruct(CLEAR, ERRORS).error == 0
    servo.sleep(0.1)
    assert servo.get("hardware_error_status") == 0
    servo.set(torque_enable=1)


def test_the_sdk_clears_the_turns(tmp_path) -> None:
    path = robot_file(
        tmp_path,
        'format = "busemu-robot/1"\n[bus]\nprotocol = 2.0\nbaud_rate = 1000000\n'
        f'servo_model = "{X}"\n[[servo]]\nid = 1\njoint = "a"\n'
        "registers = { operating_mode = 4 }\n",
    )
    robot, clock = load_robot(path), VirtualClock()
    port = SdkPort(assemble(robot, ideal(robot), Profile("ideal")), clock)
    sdk = PacketHandler(2.0)
    assert sdk.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
    assert sdk.write4ByteTxRx(port, 1, 116, 3 * TURN + 100) == (0, 0)
    clock.sleep_until(1.0)
    assert sdk.clearMultiTurn(port, 1) == (dynamixel_sdk.COMM_SUCCESS, Error2.RESULT_FAIL)
    clock.sleep_until(10.0)
    port.clearPort()
    assert sdk.read4ByteTxRx(port, 1, 132) == (3 * TURN + 100, 0, 0)
    assert sdk.clearMultiTurn(port, 1) == (dynamixel_sdk.COMM_SUCCESS, 0)
    assert sdk.read4ByteTxRx(port, 1, 132) == (100, 0, 0)


# -- backup -------------------------------------------------------------------------------------


def test_backup_brings_the_eeprom_back_and_the_servo_reboots() -> None:
    servo = OneServo(X)
    servo.set(homing_offset=77, max_position_limit=3000, position_p_gain=500)
    assert servo.get("backup_ready") == 0
    assert servo.instruct(BACKUP, STORE).error == 0
    assert servo.get("backup_ready") == 1
    servo.set(homing_offset=0, max_position_limit=2000, position_p_gain=600, led=1)
    assert servo.instruct(BACKUP, RESTORE).error == 0
    assert not servo.servo.listens(servo.now_s)
    servo.now_s += 1.0
    assert (servo.get("homing_offset"), servo.get("max_position_limit")) == (77, 3000)
    initial = servo.table["position_p_gain"].initial
    assert (servo.get("position_p_gain"), servo.get("led")) == (initial, 0)
    assert servo.get("backup_ready") == 1


def test_startup_configuration_brings_back_the_ram_and_switches_torque_on() -> None:
    servo = OneServo(X)
    servo.set(position_p_gain=500, profile_velocity=33, indirect_address_2=132, led=1)
    servo.set(startup_configuration=3)
    assert servo.instruct(BACKUP, STORE).error == 0
    servo.reboot()
    for name, value in (("position_p_gain", 500), ("profile_velocity", 33), ("led", 0)):
        assert servo.get(name) == value, name
    assert servo.get("indirect_address_2") == 132
    assert servo.get("torque_enable") == 1
    assert servo.command.torque_enable


def test_backup_needs_torque_off_and_something_stored() -> None:
    servo = OneServo(X)
    assert servo.instruct(BACKUP, RESTORE).error == Error2.RESULT_FAIL
    servo.set(torque_enable=1)
    assert servo.instruct(BACKUP, STORE).error == Error2.RESULT_FAIL
    assert servo.get("backup_ready") == 0


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        (b"", Error2.DATA_LENGTH),
        (STORE + b"\x00", Error2.DATA_LENGTH),
        (b"\x01CTRM", Error2.DATA_RANGE),
        (b"\x03CTRL", Error2.DATA_RANGE),
    ],
)
def test_backup_that_is_not_as_the_manual_says_is_refused(parameters: bytes, error: int) -> None:
    assert OneServo(X).instruct(BACKUP, parameters).error == error


@pytest.mark.parametrize(
    ("model", "firmware", "error"),
    [
        (X, 44, Error2.INSTRUCTION),
        (X, 45, 0),
        ("XL330-M288", 45, Error2.INSTRUCTION),
        ("XL330-M288", 46, 0),
        ("MX-28(2.0)", 43, Error2.INSTRUCTION),
        ("XL-320", 30, Error2.INSTRUCTION),
    ],
)
def test_backup_comes_with_the_model_and_its_firmware(
    model: str, firmware: int, error: int
) -> None:
    servo = OneServo(model, firmware_version=firmware)
    assert servo.instruct(BACKUP, STORE).error == error


# -- deafness -----------------------------------------------------------------------------------


def deaf(model: str, byte_s: float) -> tuple[Servo, list[float]]:
    servo = OneServo(model)
    mount = ServoMount(1, model, "j")
    made = Servo(mount, load_table(model), servo.joint, 1_000_000, eeprom_byte_s=byte_s)
    told: list[float] = []
    made.on_eeprom = lambda: told.append(1.0)
    return made, told


def test_a_servo_is_deaf_for_each_byte_of_eeprom_it_writes() -> None:
    servo, told = deaf("AX-12A", 6e-3)
    assert servo.listens(1.0)
    assert servo.execute(1, Instruction.WRITE, b"\x06\x01\x00\x00\x02", 1.0).error == 0
    assert not servo.listens(1.0 + 4 * 6e-3 - 1e-6)
    assert servo.listens(1.0 + 4 * 6e-3 + 1e-6)
    assert len(told) == 1


def test_a_write_to_ram_and_a_refused_one_leave_no_deafness() -> None:
    servo, told = deaf("AX-12A", 6e-3)
    servo.execute(1, Instruction.WRITE, b"\x1e\x00\x02", 1.0)
    servo.execute(1, Instruction.WRITE, b"\x05\xff", 1.0)
    assert servo.listens(1.0 + 1e-9)
    assert not told
