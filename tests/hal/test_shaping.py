"""Feet on the ground: judged by forward kinematics that ``hal`` has no part in."""

from dataclasses import replace

import numpy as np
import pytest
from dh_oracle import feet_by_matrices

from busemu.tables import RobotError, load_robot, parse_robot
from hal.cpg import Gait, LocomotionController, OutputShaping, Rhythm
from hal.legs import Legs, UnreachableError

MICRON = 1e-6  # the robot files round pi/2 to six places
ROBOTS = ("phantomx", "marvin")
FIRST = np.array([True, False, True, False, False, True])  # leg1, leg3, leg6


def locked(phase):
    phases = np.mod(phase + np.where(FIRST, 0.0, 0.5), 1.0)
    return Rhythm(phases, np.ones(6), phases < 0.5)


def path(robot, v_left, v_right, n=200):
    """Feet (n, 6, 3) and stance (n, 6) over one locked period."""
    shaping = OutputShaping(Legs.of(robot), Gait.of(robot))
    feet, stance = [], []
    for phase in np.arange(n) / n:
        rhythm = locked(phase)
        feet.append(feet_by_matrices(robot, shaping.angles_rad(rhythm, v_left, v_right)))
        stance.append(shaping.advance_and_lift(rhythm)[2])
    return np.array(feet), np.array(stance)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("v", [1.0, 4.0, -1.0])
def test_stance_feet_move_straight_back_at_one_height_and_speed(name, v):
    robot = load_robot(name)
    gait = Gait.of(robot)
    feet, stance = path(robot, v, v)
    ground = feet[..., 2][stance]
    assert np.ptp(ground) < MICRON
    for leg in range(6):
        here = stance[:, leg]
        assert np.ptp(feet[here, leg, 0]) < MICRON
        both = here & np.roll(here, -1)
        speed = (np.roll(feet[:, leg, 1], -1) - feet[:, leg, 1])[both]
        assert speed == pytest.approx(-v * gait.stride_m / gait.duty_factor / 200, rel=1e-3)


@pytest.mark.parametrize("name", ROBOTS)
def test_swing_feet_clear_the_ground_and_the_tripods_take_turns(name):
    robot = load_robot(name)
    gait = Gait.of(robot)
    feet, stance = path(robot, 1.0, 1.0)
    ground = feet[..., 2].min()
    assert feet[..., 2].max() == pytest.approx(ground + gait.lift_m, abs=1e-4)
    assert stance.mean() == pytest.approx(gait.duty_factor, abs=0.01)
    for tripod in (FIRST, ~FIRST):
        assert (stance[:, tripod] == stance[:, tripod][:, :1]).all()
    assert (stance[:, FIRST].all(axis=1) | stance[:, ~FIRST].all(axis=1)).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_no_foot_jumps(name):
    feet, _ = path(load_robot(name), 4.0, 4.0)
    steps = np.linalg.norm(np.roll(feet, -1, axis=0) - feet, axis=-1)
    assert steps.max() < 6.0 * np.median(steps)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("v", [(1.0, 1.0), (0.5, 1.5), (-1.0, 1.0), (2.0, 0.0)])
def test_stance_feet_do_not_slip_against_each_other(name, v):
    """All feet of a tripod in stance keep their mutual distances: one rigid ground."""
    feet, stance = path(load_robot(name), *v)
    for tripod in (FIRST, ~FIRST):
        standing = feet[stance[:, tripod].all(axis=1)][:, tripod]
        for a, b in ((0, 1), (1, 2), (0, 2)):
            distance = np.linalg.norm(standing[:, a] - standing[:, b], axis=-1)
            assert np.ptp(distance) < MICRON


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("v", [(1.0, 1.0), (-1.0, 1.0), (3.0, 0.0)])
def test_while_both_tripods_stand_all_six_feet_share_one_ground(name, v):
    feet, stance = path(load_robot(name), *v)
    overlaps = 0
    for now, after, both in zip(
        feet, np.roll(feet, -1, 0), stance & np.roll(stance, -1, 0), strict=True
    ):
        if both.all():
            overlaps += 1
            apart = [np.linalg.norm(f[:, None] - f[None], axis=-1) for f in (now, after)]
            assert apart[1] == pytest.approx(apart[0], abs=1e-7)
    assert overlaps > 10


@pytest.mark.parametrize("name", ROBOTS)
def test_v_left_and_v_right_are_the_ways_of_the_middle_feet(name):
    robot = load_robot(name)
    stride_m = Gait.of(robot).stride_m
    feet, stance = path(robot, 0.5, 1.0, n=2000)
    for leg, v in ((4, 0.5), (5, 1.0)):
        way = np.ptp(feet[stance[:, leg], leg, 1])
        assert way == pytest.approx(v * stride_m, rel=0.01)


@pytest.mark.parametrize("name", ROBOTS)
def test_steering_is_symmetric_left_to_right(name):
    robot = load_robot(name)
    shaping = OutputShaping(Legs.of(robot), Gait.of(robot))
    mirror = [1, 0, 3, 2, 5, 4]
    for phase in np.arange(20) / 20:
        left = feet_by_matrices(robot, shaping.angles_rad(locked(phase), 0.5, 1.5))
        right = feet_by_matrices(robot, shaping.angles_rad(locked(phase + 0.5), 1.5, 0.5))
        assert left == pytest.approx(right[mirror] * (-1.0, 1.0, 1.0), abs=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_opposite_sides_turn_on_the_spot_to_the_left_with_v_right(name):
    robot = load_robot(name)
    feet, stance = path(robot, -1.0, 1.0)
    radius = np.linalg.norm(feet[..., :2], axis=-1)
    bearing = np.arctan2(feet[..., 1], feet[..., 0])
    for leg in range(6):
        here = stance[:, leg]
        assert np.ptp(radius[here, leg]) < MICRON
        both = here & np.roll(here, -1)
        turn = np.angle(np.exp(1j * (np.roll(bearing[:, leg], -1) - bearing[:, leg])))[both]
        assert (turn < 0.0).all()  # the ground turns right under a trunk that turns left


@pytest.mark.parametrize("name", ROBOTS)
def test_a_stride_of_four_is_in_reach_and_one_of_twenty_is_refused_with_the_bound(name):
    shaping = LocomotionController.of(load_robot(name)).shaping
    shaping.check(4.0, 4.0)
    shaping.check(6.0, 6.0)
    with pytest.raises(UnreachableError, match=r"v_left = 20, v_right = 20 .* use at most"):
        shaping.check(20.0, 20.0)


def test_a_leg_stands_while_its_extensor_leads_and_swings_while_its_flexor_does():
    shaping = LocomotionController.of(load_robot("marvin")).shaping
    for phase, standing in ((0.1, True), (0.25, True), (0.4, True), (0.6, False), (0.9, False)):
        rhythm = Rhythm(np.full(6, phase), np.ones(6), np.full(6, phase < 0.5))
        assert (shaping.advance_and_lift(rhythm)[2] == standing).all()


def test_amplitude_scales_stride_and_lift():
    shaping = LocomotionController.of(load_robot("marvin")).shaping
    whole, half = locked(0.6), replace(locked(0.6), amplitude=np.full(6, 0.5))
    for a, b in zip(
        shaping.advance_and_lift(whole)[:2], shaping.advance_and_lift(half)[:2], strict=True
    ):
        assert b == pytest.approx(0.5 * a)


def test_a_gait_that_cannot_be_is_refused():
    gait = Gait.of(load_robot("marvin"))
    with pytest.raises(ValueError, match="duty_factor"):
        replace(gait, duty_factor=0.4)
    with pytest.raises(ValueError, match="is not within"):
        replace(gait, stride_m=0.0)
    robot = load_robot("marvin")
    document = {**robot.document, "gait": {"neutral": robot.document["gait"]["neutral"]}}
    with pytest.raises(RobotError, match=r"gait\.period_s"):
        Gait.of(parse_robot(document, robot.path))


def test_a_misspelt_key_of_a_gait_is_refused_and_not_ignored():
    robot = load_robot("marvin")
    document = {**robot.document, "gait": {**robot.document["gait"], "lift": 0.1}}
    with pytest.raises(RobotError, match=r"marvin\.toml: \[gait\] unknown key lift; known are"):
        Gait.of(parse_robot(document, robot.path))
