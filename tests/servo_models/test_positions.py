"""Homing offset, turns, limits: how an X servo's position register counts."""

from __future__ import annotations

import pytest
from model_bench import OneServo

from busemu.servo import Refusal


def test_power_on_takes_the_position_within_a_single_turn_and_stays_there() -> None:
    for shaft, present in ((100, 100), (4096 + 100, 100), (-100, 3996), (-3 * 4096 + 7, 7)):
        servo = OneServo("XM430-W350", at_count=shaft)
        assert servo.get("present_position") == present
        assert servo.get("goal_position") == present
        assert servo.goal_count == pytest.approx(shaft)


def test_position_counts_on_through_turns_until_something_resets_it() -> None:
    servo = OneServo("XM430-W350", at_count=4000)
    servo.stand(4000 + 4096)
    assert servo.get("present_position") == 8096
    servo.set(torque_enable=1)
    assert servo.get("present_position") == 4000
    servo.set(goal_position=10)
    assert servo.goal_count == pytest.approx(4096 + 10)
    servo.set(torque_enable=0)
    servo.stand(-50)
    assert servo.get("present_position") == -4146
    servo.reboot()
    assert servo.get("present_position") == 4046
    assert servo.get("goal_position") == 4046


def test_extended_position_mode_keeps_its_turns_when_the_torque_comes_on() -> None:
    servo = OneServo("XM430-W350", at_count=100)
    servo.set(operating_mode=4)
    servo.stand(3 * 4096 + 100)
    servo.set(torque_enable=1, goal_position=1_048_575)
    assert servo.get("present_position") == 3 * 4096 + 100
    assert servo.goal_count == pytest.approx(1_048_575)
    servo.set(goal_position=-1_048_575)
    assert servo.goal_count == pytest.approx(-1_048_575)
    for goal in (1_048_576, -1_048_576):
        assert servo.write("goal_position", goal) is Refusal.RANGE
    servo.set(torque_enable=0, operating_mode=3)
    assert servo.get("present_position") == 100


def test_position_limits_hold_in_position_mode_only() -> None:
    servo = OneServo("XM430-W350")
    servo.set(min_position_limit=1000, max_position_limit=3000)
    for goal in (999, 3001, -1):
        assert servo.write("goal_position", goal) is Refusal.LIMIT
    servo.set(goal_position=1000)
    servo.set(goal_position=3000)
    for mode in (4, 5):
        servo.set(operating_mode=mode)
        servo.set(goal_position=-5000)


def test_homing_offset_is_added_to_what_is_read_and_taken_from_what_is_written() -> None:
    servo = OneServo("XM430-W350", at_count=2000)
    servo.set(homing_offset=1024)
    assert servo.get("present_position") == 3024
    servo.set(torque_enable=1, goal_position=3000)
    assert servo.goal_count == pytest.approx(1976)


def test_homing_offset_beyond_a_quarter_turn_counts_only_where_there_are_turns() -> None:
    servo = OneServo("XM430-W350", at_count=2000)
    servo.set(homing_offset=-1025)
    assert servo.get("present_position") == 2000
    servo.set(operating_mode=4)
    assert servo.get("present_position") == 975
    servo.set(homing_offset=1_044_479)
    assert servo.get("present_position") == 1_046_479
    assert servo.write("homing_offset", 1_044_480) is Refusal.RANGE


def test_homing_offset_keeps_its_sign_in_reverse() -> None:
    servo = OneServo("XM430-W350", at_count=2048 + 300)
    servo.set(drive_mode=1, homing_offset=100)
    assert servo.get("present_position") == 2048 - 300 + 100
    servo.set(torque_enable=1, goal_position=2048 + 100)
    assert servo.goal_count == pytest.approx(2048)


def test_negative_numbers_are_two_complement_on_the_wire() -> None:
    servo = OneServo("XM430-W350", at_count=2048)
    servo.set(operating_mode=4)
    servo.stand(-1)
    _, data = servo.servo.read(132, 4)
    assert data == b"\xff\xff\xff\xff"
    assert servo.write_bytes(116, b"\xfe\xff\xff\xff") is None
    assert servo.goal_count == pytest.approx(-2)
