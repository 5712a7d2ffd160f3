"""Bus watchdog, hardware errors and shutdown of the X series and MX(2.0)."""

from __future__ import annotations

from pathlib import Path

import pytest
from model_bench import OneServo

from busemu.plant import OperatingMode
from busemu.protocol import ALERT_BIT, Instruction
from busemu.servo import Refusal
from busemu.servo.status import Alarm


def running(mode: int, **goal: int) -> OneServo:
    servo = OneServo("XM430-W350", at_count=1000)
    servo.set(operating_mode=mode)
    servo.set(torque_enable=1, profile_velocity=10, bus_watchdog=5, **goal)
    return servo


@pytest.mark.parametrize(
    ("mode", "goal"),
    [(0, "goal_current"), (1, "goal_velocity"), (3, "goal_position"), (4, "goal_position"),
     (5, "goal_position"), (16, "goal_pwm")],
)  # fmt: skip
def test_watchdog_stops_the_servo_and_holds_its_goals_until_it_is_cleared(
    mode: int, goal: str
) -> None:
    servo = running(mode, **{goal: 100})
    servo.stand(1010)
    servo.sleep(0.10)
    assert servo.servo.memory.count("bus_watchdog") == 5
    servo.sleep(0.02)
    assert servo.get("bus_watchdog") == -1
    command = servo.command
    assert command.torque_enable
    assert command.goal_velocity_rad_s == command.goal_duty == 0.0
    if command.operating_mode is OperatingMode.POSITION:
        assert servo.get("goal_position") == 1010
    assert servo.get("profile_velocity") == 0
    for name in ("goal_pwm", "goal_current", "goal_velocity", "goal_position"):
        assert servo.write(name, 1000 if name == "goal_position" else 1) is Refusal.RANGE
    servo.set(bus_watchdog=0)
    servo.set(**{goal: 50})


def test_watchdog_is_fed_by_any_instruction() -> None:
    servo = running(3, goal_position=2000)
    for _ in range(10):
        servo.sleep(0.09)
        servo.get("present_position")
        servo.sleep(0.09)
        servo.instruct(Instruction.PING)
        servo.sleep(0.09)
        servo.set(led=1)
    assert servo.get("bus_watchdog") == 5


def test_watchdog_waits_for_torque_and_for_being_set() -> None:
    servo = OneServo("XM430-W350")
    servo.set(bus_watchdog=1)
    servo.sleep(1.0)
    assert servo.get("bus_watchdog") == 1
    servo.set(bus_watchdog=0, torque_enable=1)
    servo.sleep(5.0)
    assert servo.get("bus_watchdog") == 0
    for value in (-1, 128):
        assert servo.write("bus_watchdog", value) is Refusal.RANGE


def stalled(servo: OneServo) -> None:
    servo.state(duty=1.0, velocity_rad_s=0.0)
    servo.sleep(1.2)


def heat(servo: OneServo) -> None:
    servo.state(temperature_c=servo.table["temperature_limit"].initial + 1.0)
    servo.sleep(0.02)


def sag(servo: OneServo) -> None:
    servo.state(voltage_v=servo.table["min_voltage_limit"].initial / 10 - 0.2)
    servo.sleep(0.02)


def break_encoder(servo: OneServo) -> None:
    servo.servo.protection.raise_alarm(Alarm.ENCODER)
    servo.sleep(0.02)


def shock(servo: OneServo) -> None:
    servo.servo.protection.raise_alarm(Alarm.ELECTRICAL_SHOCK)
    servo.sleep(0.02)


CAUSES = [(sag, 0x01), (heat, 0x04), (break_encoder, 0x08), (shock, 0x10), (stalled, 0x20)]


@pytest.mark.parametrize("model", ["XM430-W350", "XL330-M288", "MX-64(2.0)"])
@pytest.mark.parametrize(("cause", "bit"), CAUSES)
def test_hardware_error_has_its_bit_and_shuts_down_if_it_shall(cause, bit, model) -> None:
    servo = OneServo(model)
    torque = servo.table["torque_enable"]
    servo.set(torque_enable=1)
    cause(servo)
    assert servo.get("hardware_error_status") == bit
    status = servo.instruct(Instruction.PING)
    assert status.error == ALERT_BIT
    shuts = bool(servo.get("shutdown") & bit)
    assert shuts == bool({"XL330-M288": 53}.get(model, 52) & bit)
    assert servo.get("torque_enable") == int(not shuts)
    assert servo.command.torque_enable == (not shuts)
    expected = Refusal.RESULT if shuts else None
    assert servo.write_bytes(torque.address, b"\x01") is expected


@pytest.mark.parametrize(("cause", "bit"), CAUSES)
def test_shutdown_lasts_until_a_reboot_even_when_its_cause_is_gone(cause, bit) -> None:
    servo = OneServo("XM430-W350")
    before = servo.joint.state
    servo.set(shutdown=bit, torque_enable=1)
    cause(servo)
    servo.joint.state = before
    servo.sleep(3.0)
    assert servo.get("hardware_error_status") == bit
    assert servo.write("torque_enable", 1) is Refusal.RESULT
    servo.reboot()
    assert servo.get("hardware_error_status") == 0
    assert servo.get("torque_enable") == 0
    servo.set(torque_enable=1)
    assert servo.command.torque_enable


def test_error_that_does_not_shut_down_ends_with_its_cause() -> None:
    servo = OneServo("XM430-W350")
    before = servo.joint.state
    servo.set(torque_enable=1)
    sag(servo)
    assert servo.get("hardware_error_status") == 1
    servo.joint.state = before
    servo.sleep(0.02)
    assert servo.get("hardware_error_status") == 0
    assert servo.instruct(Instruction.PING).error == 0


def test_goal_does_not_switch_the_torque_of_a_servo_on_that_is_shut_down() -> None:
    servo = OneServo("XM430-W350")
    servo.set(drive_mode=8)
    servo.set(torque_enable=1)
    heat(servo)
    servo.set(goal_position=1000)
    assert servo.get("torque_enable") == 0
    assert not servo.command.torque_enable


def test_instruction_that_the_model_or_its_firmware_lacks_is_an_instruction_error() -> None:
    servo = OneServo("XM430-W350")
    assert servo.servo.supports(Instruction.FAST_SYNC_READ)
    assert not OneServo("XL-320").servo.supports(Instruction.FAST_SYNC_READ)
    assert not OneServo("XM430-W350", firmware_version=44).servo.supports(
        Instruction.FAST_SYNC_READ
    )
    assert not servo.servo.supports(0x77)
    assert OneServo("MX-28").instruct(Instruction.REBOOT).error == 1 << 6


def test_instruction_that_a_table_takes_away_is_refused_and_does_nothing(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'extends = "XM430-W350"\nmodel = "Mine"\nmodel_number = 1020\n'
        "[instructions]\nwrite = false\n",
        "utf-8",
    )
    servo = OneServo(str(path))
    assert servo.instruct(Instruction.WRITE, b"\x41\x00\x01").error == 2
    assert servo.get("led") == 0
    assert servo.instruct(Instruction.REG_WRITE, b"\x41\x00\x01").error == 0
    assert servo.get("registered_instruction") == 1
