"""MX with Protocol 1.0, and the AX models beside the AX-12A."""

from __future__ import annotations

import math

import pytest
from model_bench import OneServo

from busemu.plant import OperatingMode
from busemu.servo import Refusal

SPEED = 0.114 * math.pi / 30.0


def test_joint_mode_goes_to_the_goal_within_the_turn_and_its_limits() -> None:
    servo = OneServo("MX-28", at_count=4096 + 1000)
    assert servo.get("present_position") == 1000
    servo.set(torque_enable=1, goal_position=4095, moving_speed=100)
    assert servo.command.operating_mode is OperatingMode.POSITION
    assert servo.goal_count == pytest.approx(4096 + 4095)
    assert servo.command.velocity_limit_rad_s == pytest.approx(100 * SPEED)
    assert servo.write("goal_position", -1) is Refusal.LIMIT
    servo.set(cw_angle_limit=500, ccw_angle_limit=600)
    assert servo.write("goal_position", 601) is Refusal.LIMIT
    servo.stand(-1)
    assert servo.get("present_position") == 4095


def test_goal_is_in_the_turn_that_the_shaft_is_in_when_the_torque_comes_on() -> None:
    servo = OneServo("MX-28", at_count=1000)
    servo.stand(2 * 4096 + 1000)
    servo.set(torque_enable=1, goal_position=1500)
    assert servo.get("present_position") == 1000
    assert servo.goal_count == pytest.approx(2 * 4096 + 1500)


def test_wheel_mode_is_both_limits_0_and_turns_without_end() -> None:
    servo = OneServo("MX-28")
    servo.set(torque_enable=1, ccw_angle_limit=0, moving_speed=-200)
    assert servo.command.operating_mode is OperatingMode.VELOCITY
    assert servo.command.goal_velocity_rad_s == pytest.approx(-200 * SPEED)
    servo.stand(9 * 4096 + 5)
    assert servo.get("present_position") == 5
    assert servo.get("moving_speed") == -200


def test_multi_turn_mode_has_seven_turns_an_offset_and_a_divider() -> None:
    servo = OneServo("MX-28", at_count=2048)
    servo.set(cw_angle_limit=4095, ccw_angle_limit=4095, torque_enable=1, goal_position=-28_672)
    assert servo.goal_count == pytest.approx(-28_672)
    assert servo.write("goal_position", 28_673) is Refusal.RANGE
    servo.stand(20_000)
    assert servo.get("present_position") == 20_000
    servo.set(multi_turn_offset=1024)
    assert servo.get("present_position") == 21_024
    servo.set(goal_position=5120)
    assert servo.goal_count == pytest.approx(4096)
    servo.set(multi_turn_offset=0, resolution_divider=4)
    assert servo.get("present_position") == 5000
    servo.set(goal_position=1000)
    assert servo.goal_count == pytest.approx(4000)
    assert servo.write("resolution_divider", 5) is Refusal.RANGE


def test_multi_turn_offset_is_for_multi_turn_mode_only() -> None:
    servo = OneServo("MX-28", at_count=2048)
    servo.set(multi_turn_offset=1024)
    assert servo.get("present_position") == 2048
    servo.set(goal_position=3000)
    assert servo.goal_count == pytest.approx(3000)


def test_gains_are_on_the_scale_of_the_manual() -> None:
    servo = OneServo("MX-64")
    command = servo.command
    assert command.gain_cw_per_rad == command.gain_ccw_per_rad == pytest.approx(32 * 0.158)
    servo.set(p_gain=8, i_gain=128, d_gain=125)
    # Kp = P / 8, Ki = I * 1000 / 2048, Kd = D * 4 / 1000: here 1, 62.5 and 0.5.
    unit = servo.command.gain_cw_per_rad
    assert servo.command.integral_gain_per_rad_s == pytest.approx(62.5 * unit, rel=2e-3)
    assert servo.command.derivative_gain_s_per_rad == pytest.approx(0.5 * unit, rel=2e-3)


@pytest.mark.parametrize("model", ["MX-64", "MX-106"])
def test_torque_control_mode_takes_the_goal_torque_alone(model: str) -> None:
    servo = OneServo(model)
    servo.set(torque_enable=1, torque_ctrl_mode_enable=1, goal_torque=-200, goal_position=9)
    assert servo.command.operating_mode is OperatingMode.PWM
    stall_a = servo.table.drive["stall_current_a"]
    assert servo.command.goal_duty == pytest.approx(-200 * 4.5e-3 / stall_a)
    servo.state(current_a=-0.45)
    assert servo.servo.read(68, 2)[1] == (2048 - 100).to_bytes(2, "little")
    servo.set(torque_ctrl_mode_enable=0)
    assert servo.command.operating_mode is OperatingMode.POSITION


def test_reverse_of_the_mx_106_holds_in_joint_mode_and_not_in_wheel_mode() -> None:
    servo = OneServo("MX-106", at_count=2148)
    servo.set(drive_mode=1)
    assert servo.get("present_position") == 1948
    servo.set(goal_position=2058, moving_speed=10)
    assert servo.goal_count == pytest.approx(2038)
    servo.set(ccw_angle_limit=0)
    assert servo.command.goal_velocity_rad_s > 0.0
    assert servo.get("present_position") == 2148


def test_lock_guards_the_eeprom_and_cannot_be_taken_back() -> None:
    servo = OneServo("MX-64")
    servo.set(torque_enable=1, cw_angle_limit=10, lock=1)
    assert servo.write("cw_angle_limit", 0) is Refusal.ACCESS
    assert servo.write("lock", 0) is Refusal.ACCESS
    servo.set(led=1)


def test_shutdown_of_an_mx_sets_the_torque_limit_to_0_until_it_is_set_again() -> None:
    servo = OneServo("MX-28")
    servo.set(torque_enable=1)
    servo.state(duty=1.0)
    servo.sleep(1.2)
    assert servo.get("torque_limit") == 0
    assert servo.command.duty_limit == 0.0
    servo.state(duty=0.0)
    servo.set(torque_limit=1023)
    servo.sleep(0.1)
    assert servo.command.duty_limit == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(("model", "wheel"), [("AX-12W", "pwm"), ("AX-18A", "pwm"),
                                              ("AX-12A", "velocity")])  # fmt: skip
def test_wheel_mode_of_ax_models(model: str, wheel: str) -> None:
    servo = OneServo(model)
    servo.set(torque_enable=1, ccw_angle_limit=0, moving_speed=-512)
    assert servo.command.operating_mode is OperatingMode(wheel)
    if wheel == "pwm":
        assert servo.command.goal_duty == pytest.approx(-512 / 1023)
    else:
        assert servo.command.goal_velocity_rad_s == pytest.approx(-512 * 0.111 * math.pi / 30)


def test_speed_of_the_mx_12w_has_its_own_unit() -> None:
    servo = OneServo("MX-12W")
    servo.set(moving_speed=300)
    assert servo.command.velocity_limit_rad_s == pytest.approx(274.8 * math.pi / 30)


def test_goal_acceleration_of_an_mx_needs_a_speed() -> None:
    servo = OneServo("MX-28", at_count=1000)
    servo.set(torque_enable=1, goal_position=2000, goal_acceleration=10)
    assert servo.command.acceleration_limit_rad_s2 == math.inf
    servo.set(moving_speed=100)
    assert servo.command.acceleration_limit_rad_s2 == pytest.approx(math.radians(85.83))
    servo.set(goal_acceleration=0)
    assert servo.command.acceleration_limit_rad_s2 == math.inf


def test_goal_acceleration_of_an_sts3215_needs_none() -> None:
    servo = OneServo("STS3215", at_count=1000)
    servo.set(torque_enable=1, goal_position=2000, goal_acceleration=50)
    assert servo.command.acceleration_limit_rad_s2 == pytest.approx(5000 * 2 * math.pi / 4096)


def test_a_dead_zone_of_a_feetech_servo_is_its_laws_and_one_count_from_the_factory() -> None:
    servo = OneServo("STS3215")
    count = 2.0 * math.pi / 4096
    assert servo.command.margin_cw_rad == pytest.approx(count)
    assert servo.command.margin_ccw_rad == pytest.approx(count)
    servo.set(cw_dead_zone=3, ccw_dead_zone=0)
    assert servo.command.margin_cw_rad == pytest.approx(3 * count)
    assert servo.command.margin_ccw_rad == 0.0
    assert OneServo("MX-28").command.margin_cw_rad == 0.0
