"""What the registers of the X series and MX(2.0) tell the drive, mode by mode."""

from __future__ import annotations

import math

import pytest
from model_bench import COUNT_RAD, VELOCITY, OneServo

from busemu.plant import OperatingMode
from busemu.protocol import Instruction
from busemu.servo import Refusal
from busemu.tables import load_table, models

X = [m for m in models() if load_table(m).drive["law"] == "operating_modes"]
WITH_CURRENT = [m for m in X if "goal_current" in load_table(m)]
PWM = 1 / 885


def test_position_mode_is_the_mode_of_the_factory_and_goes_to_the_goal() -> None:
    servo = OneServo("XM430-W350")
    assert servo.get("operating_mode") == 3
    assert not servo.command.torque_enable
    servo.set(torque_enable=1, goal_position=3072)
    command = servo.command
    assert command.torque_enable
    assert command.operating_mode is OperatingMode.POSITION
    assert command.goal_position_rad == pytest.approx(math.pi / 2)
    assert command.duty_limit == pytest.approx(1.0, abs=1e-4)
    assert command.velocity_limit_rad_s == math.inf
    assert command.margin_cw_rad == command.margin_ccw_rad == command.punch_duty == 0.0


@pytest.mark.parametrize(("model", "gain"), [("XL330-M288", 400), ("XM430-W350", 800)])
def test_position_gain_of_the_factory_is_that_many_duty_for_a_radian(model: str, gain: int) -> None:
    servo = OneServo(model)
    # Two independent measurements of an XL330 gave 0.00287 for each unit.
    expected = gain * (4096 / (2 * math.pi)) / (256 * 885)
    assert servo.command.gain_cw_per_rad == pytest.approx(expected, rel=1e-3)
    assert servo.command.gain_ccw_per_rad == servo.command.gain_cw_per_rad
    servo.set(position_p_gain=2 * gain, position_i_gain=100, position_d_gain=200)
    assert servo.command.gain_cw_per_rad == pytest.approx(2 * expected, rel=1e-3)
    assert servo.command.integral_gain_per_rad_s == pytest.approx(0.562)
    assert servo.command.derivative_gain_s_per_rad == pytest.approx(4.604e-3)


@pytest.mark.parametrize("model", X)
def test_goal_pwm_limits_the_duty_in_every_mode_but_its_own(model: str) -> None:
    servo = OneServo(model)
    for mode in servo.table["operating_mode"].allowed:
        servo.set(torque_enable=0)
        servo.set(operating_mode=mode)
        servo.set(torque_enable=1, goal_pwm=-443)
        if mode == 16:
            assert servo.command.operating_mode is OperatingMode.PWM
            assert servo.command.goal_duty == pytest.approx(-443 * PWM, rel=1e-4)
            assert servo.command.duty_limit == pytest.approx(1.0, abs=1e-4)
        else:
            expected = 443 * PWM
            if mode == 5:
                expected = min(expected, abs(servo.table["goal_current"].to_si(
                    servo.get("goal_current"))) / servo.table.drive["stall_current_a"])  # fmt: skip
            assert servo.command.duty_limit == pytest.approx(expected, rel=1e-4)


def test_velocity_mode_turns_at_the_goal_velocity_in_both_directions() -> None:
    servo = OneServo("XL430-W250")
    servo.set(operating_mode=1)
    assert servo.get("goal_velocity") == 0
    servo.set(torque_enable=1, goal_velocity=100)
    assert servo.command.operating_mode is OperatingMode.VELOCITY
    assert servo.command.goal_velocity_rad_s == pytest.approx(100 * VELOCITY)
    assert servo.get("velocity_trajectory") == 100
    servo.set(goal_velocity=-100)
    assert servo.command.goal_velocity_rad_s == pytest.approx(-100 * VELOCITY)


def test_current_mode_is_the_duty_that_brings_the_current_at_standstill() -> None:
    servo = OneServo("XM430-W350")
    servo.set(operating_mode=0)
    assert servo.get("goal_current") == 0
    servo.set(torque_enable=1, goal_current=-200)
    assert servo.command.operating_mode is OperatingMode.PWM
    assert servo.command.goal_duty == pytest.approx(-200 * 2.69e-3 / 2.3)
    servo.set(goal_current=1193)
    assert servo.command.goal_duty == 1.0


@pytest.mark.parametrize("model", WITH_CURRENT)
def test_current_based_position_mode_limits_the_duty_by_the_goal_current(model: str) -> None:
    servo = OneServo(model)
    servo.set(operating_mode=5)
    assert servo.get("goal_current") == servo.get("current_limit")
    servo.set(torque_enable=1, goal_current=50, goal_position=-100_000)
    command = servo.command
    assert command.operating_mode is OperatingMode.POSITION
    assert command.goal_position_rad == pytest.approx((-100_000 - 2048) * COUNT_RAD)
    stall_a = servo.table.drive["stall_current_a"]
    assert command.duty_limit == pytest.approx(servo.table["goal_current"].to_si(50) / stall_a)


@pytest.mark.parametrize("model", sorted(set(X) - set(WITH_CURRENT)))
def test_models_that_measure_no_current_have_no_mode_for_it(model: str) -> None:
    servo = OneServo(model)
    for mode in (0, 5, 2, 17):
        assert servo.write("operating_mode", mode) is Refusal.RANGE
    servo.state(duty=-0.5)
    assert servo.get("present_load") == -500


@pytest.mark.parametrize("model", X)
def test_eeprom_is_locked_while_the_torque_is_on(model: str) -> None:
    servo = OneServo(model)
    servo.set(torque_enable=1)
    for register in servo.table.registers:
        if register.area == "EEPROM" and register.writable:
            assert servo.write(register.name, register.initial or 0) is Refusal.ACCESS
    servo.set(led=1, torque_enable=0, operating_mode=16, homing_offset=10)


@pytest.mark.parametrize(
    ("name", "limit"),
    [("goal_pwm", "pwm_limit"), ("goal_velocity", "velocity_limit"),
     ("goal_current", "current_limit")],
)  # fmt: skip
def test_goals_beyond_their_limit_are_refused_and_a_lower_limit_takes_them_along(
    name: str, limit: str
) -> None:
    servo = OneServo("XM430-W350")
    servo.set(**{limit: 90, name: 90})
    assert servo.write(name, 91) is Refusal.LIMIT
    assert servo.write(name, -91) is Refusal.LIMIT
    assert servo.get(name) == 90
    servo.set(**{limit: 40})
    assert servo.get(name) == 40
    assert servo.write(name, 20_000) is Refusal.RANGE


def test_change_of_mode_resets_gains_profile_and_goals() -> None:
    servo = OneServo("XM430-W350")
    servo.set(position_p_gain=1, profile_velocity=5, profile_acceleration=6, goal_pwm=7)
    servo.set(operating_mode=4)
    assert servo.get("position_p_gain") == 800
    assert servo.get("profile_velocity") == servo.get("profile_acceleration") == 0
    assert servo.get("goal_pwm") == 885
    servo.set(operating_mode=16)
    assert servo.get("goal_pwm") == 0


def test_drive_mode_reverse_turns_every_direction_around() -> None:
    servo = OneServo("XM430-W350", at_count=2148)
    servo.set(drive_mode=1)
    assert servo.get("present_position") == 1948
    servo.set(torque_enable=1, goal_position=2048 + 100)
    assert servo.command.goal_position_rad == pytest.approx(-100 * COUNT_RAD)
    servo.state(velocity_rad_s=10 * VELOCITY, duty=0.5, current_a=0.269)
    assert servo.get("present_velocity") == -10
    assert servo.get("present_pwm") == round(-0.5 * 885)
    assert servo.get("present_current") == -100
    servo.set(torque_enable=0)
    for mode, goal in ((1, "goal_velocity"), (16, "goal_pwm"), (0, "goal_current")):
        servo.set(operating_mode=mode)
        servo.set(**{goal: 10})
        command = servo.command
        assert command.goal_velocity_rad_s + command.goal_duty < 0.0


def test_torque_comes_on_with_a_goal_where_the_firmware_knows_the_bit() -> None:
    for firmware, on in ((45, 1), (44, 0)):
        servo = OneServo("XM430-W350", firmware_version=firmware)
        servo.set(drive_mode=8)
        servo.set(led=1)
        assert servo.get("torque_enable") == 0
        servo.set(goal_position=2000)
        assert servo.get("torque_enable") == on


def test_registers_newer_than_the_firmware_read_0_and_do_nothing() -> None:
    servo = OneServo("XM430-W350", firmware_version=37)
    assert servo.get("firmware_version") == 37
    assert servo.write("bus_watchdog", 5) is Refusal.ACCESS
    assert servo.write("drive_mode", 1) is Refusal.ACCESS
    assert servo.get("bus_watchdog") == 0
    assert OneServo("XM430-W350").write("bus_watchdog", 5) is None


@pytest.mark.parametrize("model", X)
def test_every_mode_of_every_model_can_be_read_and_driven(model: str) -> None:
    servo = OneServo(model)
    for mode in servo.table["operating_mode"].allowed:
        servo.set(torque_enable=0)
        servo.set(operating_mode=mode)
        servo.set(torque_enable=1)
        for register in servo.table.registers:
            servo.get(register.name)
        assert servo.command.torque_enable
        assert 0.0 < servo.command.duty_limit <= 1.0
        assert servo.command.goal_duty == servo.command.goal_velocity_rad_s == 0.0
        servo.sleep(0.05)


def test_factory_reset_restores_what_can_be_written_and_leaves_the_firmware() -> None:
    servo = OneServo("XM430-W350", firmware_version=37)
    servo.set(homing_offset=5, velocity_limit=6)
    assert servo.instruct(Instruction.FACTORY_RESET, b"\x02").error == 0
    assert (servo.get("homing_offset"), servo.get("velocity_limit")) == (0, 200)
    assert servo.get("firmware_version") == 37
    assert servo.servo.baud_rate == 1_000_000


def test_shaft_far_beyond_the_register_reads_its_end() -> None:
    servo = OneServo("XM430-W350")
    servo.stand(3e9)
    assert servo.get("present_position") == 2**31 - 1
    servo.stand(-3e9)
    assert servo.get("present_position") == -(2**31)
