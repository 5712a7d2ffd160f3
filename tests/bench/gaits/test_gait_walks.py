"""A candidate walks for real: the robot's own program over the emulated bus, PyBullet behind."""

from dataclasses import replace

import pytest
from pretended_walks import MARVIN, ORIGINAL

from bench.experiments.position_error import TorqueSensor
from bench.gaits.outcome import Job, Reason
from bench.gaits.walking import Walker, steady_from_s
from hal.cpg import Gait
from sim.watch import Event, What

SECONDS = 2.4


@pytest.fixture(scope="module")
def walker():
    return Walker(MARVIN)


@pytest.fixture(scope="module")
def original(walker):
    return walker(Job(ORIGINAL, SECONDS, 0))


def test_the_original_gait_is_allowed_and_goes_as_far_as_its_strides(original):
    assert original.reasons == ()
    gait = Gait.of(MARVIN)
    commanded = gait.stride_m / (gait.duty_factor * gait.period_s)
    assert 0.8 * commanded < original.speed_m_s < commanded
    assert original.stride_m == pytest.approx(gait.stride_m, rel=0.2)


def test_torque_from_position_errors_is_near_the_true_one(original):
    # the friction of the gear lies between them: see docs/how-to/experiments.md
    sensor = TorqueSensor.of(MARVIN, MARVIN.servos[0], {})
    friction = sensor.friction_nm / sensor.stall_nm
    assert original.true_torque_of_stall > 0.0
    assert abs(original.torque_of_stall - original.true_torque_of_stall) < 2.0 * friction


def test_energy_is_at_least_the_friction_the_joints_overcome(original):
    # lifting nothing and going nowhere would still cost the motors' friction
    assert 0.0 < original.energy_j < 18 * 7.4 * 1.1 * SECONDS  # all servos stalled all the time


def test_strides_that_cross_the_legs_are_a_self_collision(walker):
    found = walker(Job(replace(ORIGINAL, v_left=6.5, v_right=6.5), SECONDS, 0))
    assert Reason.SELF_COLLISION in found.reasons
    assert found.self_collision_share > 0.0


def test_a_robot_that_does_not_stand_up_has_fallen(walker):
    found = walker(Job(replace(ORIGINAL, femur_rad=1.0, tibia_rad=-1.6), SECONDS, 0))
    assert found.reasons == (Reason.FALL,)
    assert found.fell_after_s == 0.0
    assert found.speed_m_s == 0.0


def test_a_fall_ends_the_walk_and_counts(walker, monkeypatch):
    fell = Event(2.0, What.FALL, ("trunk",))
    events = property(lambda eye: [fell] if eye.plant.bank.commands.any() else [])
    monkeypatch.setattr("bench.gaits.walking._Eye.events", events)
    checks = []
    found = walker(Job(ORIGINAL, 60.0, 0), lambda: checks.append(None))
    assert found.reasons == (Reason.FALL,)
    assert len(checks) == 1
    assert 0.0 < found.fell_after_s < 1.0
    assert found.speed_m_s == 0.0
    assert found.violation > 1.9


def test_the_same_job_is_the_same_walk_to_the_bit(walker, original):
    assert repr(walker(Job(ORIGINAL, SECONDS, 0))) == repr(original)


def test_what_the_check_raises_ends_the_walk_at_once(walker):
    class EnoughError(Exception):
        pass

    calls = []

    def check():
        calls.append(None)
        if len(calls) == 5:
            raise EnoughError

    with pytest.raises(EnoughError):
        walker(Job(ORIGINAL, 60.0, 0), check)
    assert len(calls) == 5


@pytest.mark.parametrize("seconds", [2.4, 5.0, 10.0])
def test_the_measured_part_is_whole_steps_after_the_start_up(seconds):
    job = Job(ORIGINAL, seconds, 0)
    measured = seconds - steady_from_s(job, (0.0, seconds))
    steps = measured / (0.5 * ORIGINAL.period_s)
    assert steps == pytest.approx(round(steps), abs=1e-9)
    assert round(steps) >= 1
    assert measured <= max(0.5 * seconds, 0.5 * ORIGINAL.period_s) or seconds - measured >= 3.0
