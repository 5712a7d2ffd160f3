"""Profiles, trajectories, moving and moving_status."""

from __future__ import annotations

import math

import pytest
from model_bench import COUNT_RAD, VELOCITY, OneServo

from busemu.servo.profile import (
    RECTANGULAR,
    STEP,
    TRAPEZOIDAL,
    TRIANGULAR,
    Profile,
    by_time,
    by_velocity,
)

#: counts/s a count of profile_velocity.
SPEED = VELOCITY / COUNT_RAD


def integral(profile: Profile) -> float:
    """The way, from the velocities alone."""
    steps, end_s = 20_000, profile.end_s
    step_s = (end_s - profile.start_s) / steps
    return sum(profile.at(profile.start_s + (i + 0.5) * step_s)[1] for i in range(steps)) * step_s


@pytest.mark.parametrize("way", [1000.0, -1000.0, 3.0])
@pytest.mark.parametrize(
    ("make", "kind", "duration_s"),
    [
        (lambda way: by_velocity(5.0, 5.0 + way, 1.0, 0.0, 100.0), STEP, lambda way: 0.0),
        (lambda way: by_velocity(5.0, 5.0 + way, 1.0, 50.0, 0.0), RECTANGULAR,
         lambda way: way / 50),
        (lambda way: by_velocity(5.0, 5.0 + way, 1.0, 1e4, 90.0), TRIANGULAR,
         lambda way: 2 * math.sqrt(way / 90)),
        (lambda way: by_velocity(5.0, 5.0 + way, 1.0, 1.0, 4.0), TRAPEZOIDAL,
         lambda way: way + 0.25),
        (lambda way: by_time(5.0, 5.0 + way, 1.0, 0.0, 0.5), STEP, lambda way: 0.0),
        (lambda way: by_time(5.0, 5.0 + way, 1.0, 2.0, 0.0), RECTANGULAR, lambda way: 2.0),
        (lambda way: by_time(5.0, 5.0 + way, 1.0, 2.0, 0.5), TRAPEZOIDAL, lambda way: 2.0),
        (lambda way: by_time(5.0, 5.0 + way, 1.0, 2.0, 9.0), TRIANGULAR, lambda way: 2.0),
    ],
)  # fmt: skip
def test_profile_covers_the_way_in_its_time(make, kind, duration_s, way) -> None:
    profile = make(way)
    assert profile.kind == kind
    assert profile.end_s - 1.0 == pytest.approx(duration_s(abs(way)))
    assert profile.at(profile.end_s) == (5.0 + way, 0.0)
    if kind == STEP:
        assert profile.at(1.0) == (5.0 + way, 0.0)
        return
    assert profile.at(1.0)[0] == pytest.approx(5.0)
    assert integral(profile) == pytest.approx(way, rel=1e-3)
    half = profile.at(0.5 * (1.0 + profile.end_s))
    assert half[0] == pytest.approx(5.0 + way / 2)
    assert abs(half[1]) == pytest.approx(profile.velocity)


def test_profile_velocity_limits_the_drive_and_0_does_not() -> None:
    servo = OneServo("XM430-W350", at_count=0)
    servo.set(torque_enable=1, profile_velocity=100, goal_position=2000)
    assert servo.command.velocity_limit_rad_s == pytest.approx(100 * VELOCITY)
    assert servo.get("moving") == 1
    whole_s = 2000 / (100 * SPEED)
    servo.sleep(0.1)
    assert servo.get("position_trajectory") == pytest.approx(2000 * 0.1 / whole_s, abs=1)
    assert servo.get("velocity_trajectory") == 100
    assert servo.get("moving_status") == 0b01_1010  # rectangular, does not follow, ongoing
    servo.stand(1999)
    servo.sleep(whole_s)
    assert servo.get("position_trajectory") == 2000
    assert servo.get("velocity_trajectory") == 0
    assert servo.get("moving_status") == 0b01_0001
    assert servo.get("moving") == 0
    servo.set(profile_velocity=0, goal_position=10)
    assert servo.command.velocity_limit_rad_s == math.inf
    assert servo.get("moving_status") & 0b11_0010 == 0


def test_new_profile_starts_where_the_old_one_is() -> None:
    servo = OneServo("XM430-W350", at_count=0)
    servo.set(torque_enable=1, profile_velocity=100, goal_position=4000)
    servo.sleep(0.5)
    before = servo.get("position_trajectory")
    servo.set(goal_position=0)
    assert servo.get("position_trajectory") == before
    servo.sleep(0.1)
    assert servo.get("velocity_trajectory") == -100
    assert 0 < servo.get("position_trajectory") < before


def test_the_acceleration_limits_the_drive_and_shows_in_the_trajectory() -> None:
    servo = OneServo("XM430-W350", at_count=0)
    servo.set(torque_enable=1, profile_acceleration=10, goal_position=3000)
    assert (
        servo.command.acceleration_limit_rad_s2 == math.inf
    )  # without a speed there is no profile
    servo.set(profile_velocity=150, goal_position=4000)
    acceleration = 10 * 214.577 * 2 * math.pi / 3600
    assert servo.command.acceleration_limit_rad_s2 == pytest.approx(acceleration)
    servo.sleep(0.2)
    assert servo.get("velocity_trajectory") * VELOCITY == pytest.approx(
        0.2 * acceleration, abs=0.02
    )
    assert servo.get("moving_status") >> 4 == TRAPEZOIDAL
    servo.set(goal_position=5)
    assert servo.get("moving_status") >> 4 == TRIANGULAR
    servo.set(torque_enable=0)
    assert servo.get("position_trajectory") == servo.get("present_position")


def test_the_acceleration_in_velocity_mode_is_the_register_s() -> None:
    servo = OneServo("XM430-W350", at_count=0)
    servo.set(operating_mode=1)
    servo.set(torque_enable=1, goal_velocity=100)
    assert servo.command.acceleration_limit_rad_s2 == math.inf
    servo.set(profile_acceleration=20)
    assert servo.command.acceleration_limit_rad_s2 == pytest.approx(20 * 214.577 * math.pi / 1800)


def test_time_based_profile_takes_the_time_that_is_set() -> None:
    servo = OneServo("XM430-W350", at_count=0)
    servo.set(drive_mode=4)
    servo.set(torque_enable=1, profile_velocity=500, goal_position=1000)
    assert servo.command.velocity_limit_rad_s == pytest.approx(1000 * COUNT_RAD / 0.5)
    servo.sleep(0.25)
    assert servo.get("position_trajectory") == pytest.approx(500, abs=1)
    servo.sleep(0.25)
    assert servo.get("position_trajectory") == 1000
    old = OneServo("XM430-W350", at_count=0, firmware_version=41)
    old.set(drive_mode=4)
    old.set(torque_enable=1, profile_velocity=500, goal_position=1000)
    assert old.command.velocity_limit_rad_s == pytest.approx(500 * VELOCITY)


def test_moving_looks_at_the_moving_threshold() -> None:
    servo = OneServo("XM430-W350")
    for velocity, moving in ((10, 0), (11, 1), (-11, 1), (-10, 0)):
        servo.state(velocity_rad_s=velocity * VELOCITY)
        assert servo.get("moving") == moving
    servo.set(moving_threshold=100)
    servo.state(velocity_rad_s=50 * VELOCITY)
    assert servo.get("moving") == 0


def test_present_registers_show_the_state_of_the_joint() -> None:
    servo = OneServo("XM430-W350", at_count=1000)
    servo.state(velocity_rad_s=-20 * VELOCITY, duty=-1.0, current_a=-2.69, voltage_v=11.14,
                temperature_c=41.4)  # fmt: skip
    assert servo.get("present_position") == 1000
    assert servo.get("present_velocity") == -20
    assert servo.get("present_pwm") == -885
    assert servo.get("present_current") == -1000
    assert servo.get("present_input_voltage") == 111
    assert servo.get("present_temperature") == 41


def test_realtime_tick_counts_milliseconds_and_starts_over() -> None:
    servo = OneServo("XM430-W350")
    servo.sleep(0.25)
    assert servo.get("realtime_tick") == 250
    servo.sleep(32.5)
    assert servo.get("realtime_tick") == (250 + 32_500) % 32_768
    servo.sleep(0.03)
    assert servo.get("realtime_tick") == 12
    assert OneServo("MX-28", firmware_version=39).get("realtime_tick") == 0
