"""Feet on the ground: weight, friction, springs; joints at their stops; drives of a whole robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from sim_rigs import LAWS

from busemu.plant import DriveCommand
from busemu.tables import Robot
from sim.drive.bank import command_column
from sim.entries import PhysicsError
from sim.floating.arrays import (
    BODIES,
    FRICTION,
    INERTIA,
    MASS,
    POINTS,
    REACH,
    STIFFNESS,
    TURNING,
    Tree,
    motion,
    work,
)
from sim.floating.rollout import Rolled, Start, rollout, step
from sim.robot import read_physics
from sim.stepped import TICK_S
from sim.tree import GRAVITY_M_S2, Ground, PhysicalRobot
from sim.world import BulletPlant

SECONDS = 1.0
EVERY = 10
NO_EVENTS = np.empty((0, 4))


def goals(robot: Robot, physical: PhysicalRobot, rad: dict[str, float]) -> np.ndarray:
    """Torque on, every joint at a goal."""
    law = LAWS[robot.name]
    mounts = {servo.joint: servo for servo in robot.servos}
    columns = [
        command_column(
            DriveCommand(
                torque_enable=True,
                goal_position_rad=mounts[joint.name].to_servo(rad[joint.name]),
                **law,
            )
        )
        for joint in physical.joints
    ]
    return np.array(columns).T


def standing(
    robot: Robot, physical: PhysicalRobot, seconds: float = SECONDS, high_m: float = 0.0
) -> Rolled:
    """A robot put on its feet, its joints held."""
    neutral = physical.posture(physical.neutral_rad)
    start = Start(neutral, (0.0, 0.0, physical.height_m(physical.neutral_rad) + high_m))
    ticks = round(seconds / TICK_S)
    return rollout(physical, start, goals(robot, physical, neutral), NO_EVENTS, ticks, EVERY)


def slid_m(seen: Rolled) -> float:
    return float(np.linalg.norm(seen.origin_m[-1, :2] - seen.origin_m[len(seen.look_s) // 2, :2]))


def test_a_robot_on_its_feet_stands_still(robot: Robot) -> None:
    physical = read_physics(robot)
    seen = standing(robot, physical)
    feet = [seen.pressed[f"{leg.name}.tibia"] for leg in physical.legs]
    assert np.stack(feet)[:, -10:].all()
    assert not seen.pressed["trunk"].any()
    assert np.ptp(seen.origin_m[-20:], axis=0) == pytest.approx(np.zeros(3), abs=1e-4)
    assert seen.frame[-1] == pytest.approx(np.eye(3), abs=0.02)


def test_it_slides_down_a_slope_that_is_steeper_than_friction_and_no_other(robot: Robot) -> None:
    physical = read_physics(robot)
    rub = 0.3
    assert math.isclose(physical.contact.friction, physical.legs[0].foot.friction)
    for steeper, slides in ((0.8, False), (1.5, True)):
        lean = math.atan(steeper * rub)
        ground = Ground(friction=rub / physical.contact.friction, pitch_rad=lean)
        seen = standing(robot, replace(physical, ground=ground))
        if not slides:
            assert slid_m(seen) < 1e-3
            continue
        late = seen.look_s > 0.4
        pace = np.gradient(seen.origin_m[late, 1], seen.look_s[late])
        down = np.polyfit(seen.look_s[late], pace, 1)[0]
        assert down == pytest.approx(
            -GRAVITY_M_S2 * (math.sin(lean) - rub * math.cos(lean)), rel=0.02
        )


@pytest.mark.parametrize("soft", ["feet", "ground", "both"])
def test_what_is_soft_gives_by_the_weight_that_is_on_it(robot: Robot, soft: str) -> None:
    rigid = read_physics(robot)
    gives = 0.003  # of one spring; joints are a little softer on rigid ground, as feet hold there
    stiffness = rigid.mass_kg * GRAVITY_M_S2 / (len(rigid.legs) * gives)
    damping = 0.01 * stiffness
    physical = rigid
    if soft != "ground":
        legs = [
            replace(leg, foot=replace(leg.foot, stiffness_n_m=stiffness, damping_n_s_m=damping))
            for leg in rigid.legs
        ]
        physical = replace(physical, legs=tuple(legs))
    if soft != "feet":
        ground = Ground(stiffness_n_m=stiffness, damping_n_s_m=damping)
        physical = replace(physical, ground=ground)
    on_rigid, on_soft = (standing(robot, p).origin_m[-1, 2] for p in (rigid, physical))
    assert on_rigid - on_soft == pytest.approx((2.0 if soft == "both" else 1.0) * gives, rel=0.05)


def test_feet_that_fall_on_rigid_ground_stay_on_it(robot: Robot) -> None:
    physical = read_physics(robot)
    seen = standing(robot, physical, high_m=0.03)
    pressed = np.stack([on for name, on in seen.pressed.items() if name.endswith("tibia")])
    fallen = math.sqrt(2.0 * 0.03 / GRAVITY_M_S2)
    assert not pressed[:, seen.look_s < fallen - 0.01].any()
    assert pressed[:, seen.look_s > fallen + 0.3].all()
    on = standing(robot, physical)  # and nothing has sunk in
    assert seen.origin_m[-1, 2] == pytest.approx(on.origin_m[-1, 2], abs=2e-3)


def test_a_robot_without_torque_lies_on_its_belly(robot: Robot) -> None:
    physical = read_physics(robot)
    assert physical.trunk is not None
    rest = physical.posture(physical.rest_rad)
    high = -physical.trunk.belly_m + 0.01
    still = np.zeros_like(goals(robot, physical, rest))
    seen = rollout(physical, Start(rest, (0.0, 0.0, high)), still, NO_EVENTS, 1000, EVERY)
    assert seen.pressed["trunk"][-10:].all()
    assert seen.origin_m[-1, 2] == pytest.approx(-physical.trunk.belly_m, abs=2e-4)


def test_a_joint_ends_at_its_stop(robot: Robot) -> None:
    plain = read_physics(robot)
    name = plain.joints[1].name
    physical = plain.clamped({name: (-0.1, 0.1)})
    neutral = physical.posture(physical.neutral_rad) | {name: 0.0}
    for goal, stop in ((0.6, 0.1), (-0.6, -0.1)):
        commands = goals(robot, physical, neutral | {name: goal})
        seen = rollout(
            physical, Start(neutral, (0.0, 0.0, 0.5), held=True), commands, NO_EVENTS, 600, EVERY
        )
        assert seen.angle_rad[-100:, 1] == pytest.approx(np.full(100, stop), abs=2e-3)
        assert np.abs(seen.angle_rad[:, 1]).max() < 0.1 + 0.005


def test_gears_too_stiff_for_any_step_are_refused(robot: Robot) -> None:
    plain = read_physics(robot)
    joints = tuple(
        replace(j, drive=replace(j.drive, gear_stiffness_nm_rad=1e6)) for j in plain.joints
    )
    with pytest.raises(PhysicsError, match="too high for these links"):
        standing(robot, replace(plain, joints=joints))


def test_joints_that_nobody_can_follow_are_refused(robot: Robot) -> None:
    physical = read_physics(robot)
    endless = replace(physical, supply=replace(physical.supply, voltage_v=math.inf))
    with pytest.raises(PhysicsError, match="move without bounds"):
        standing(robot, endless, 0.1)


def test_a_held_robot_does_what_the_engine_makes_of_it(
    robot: Robot, make: Callable[..., BulletPlant]
) -> None:
    physical = read_physics(robot)
    rest = physical.posture(physical.rest_rad)
    mounts = {servo.joint: servo for servo in robot.servos}
    ticks, between = 800, 40
    told = []
    for k in range(ticks // between):
        joint = physical.joints[k % len(physical.joints)]
        goal = mounts[joint.name].to_servo(rest[joint.name] + 0.2 * (-1.0) ** k)
        command = DriveCommand(torque_enable=True, goal_position_rad=goal, **LAWS[robot.name])
        told.append((k % len(physical.joints), joint.servo_id, command))

    def theirs(steps: int) -> np.ndarray:
        plant = make(robot, held=True, steps_per_tick=steps)
        seen = []
        for tick in range(ticks):
            plant.advance(tick * TICK_S)
            angles = [(j.name, plant.sample(j.servo_id).position_rad) for j in physical.joints]
            seen.append([mounts[name].to_joint(angle) for name, angle in angles])
            if tick % between == 0:
                _, servo, command = told[tick // between]
                plant.command(servo, command)
        return np.array(seen)

    events = [
        [k * between + 1, number, field, value]
        for k, (number, _, command) in enumerate(told)
        for field, value in enumerate(command_column(command))
    ]
    start = Start(rest, (0.0, 0.0, 0.5), held=True)
    still = np.repeat(command_column(DriveCommand())[:, None], len(physical.joints), axis=1)
    for steps in (1, 2):  # whose joints are 0.2 to 0.3 mrad RMS from those of steps of 0.125 ms
        engine = theirs(steps)
        assert np.ptp(engine, axis=0).max() > 0.15
        ours = rollout(physical, start, still, np.array(events), ticks, EVERY, steps).angle_rad
        assert np.sqrt(np.mean((ours - engine) ** 2)) < 1e-4


def puck(rub: float, arm_m: float) -> Tree:
    """A puck of 1 kg on one foot in the middle, that cannot topple."""
    bodies = np.zeros((BODIES, 1))
    bodies[MASS] = 1.0
    bodies[INERTIA : INERTIA + 3, 0] = 1e6, 1e6, 2e-4
    bodies[FRICTION], bodies[STIFFNESS], bodies[TURNING] = rub, math.inf, arm_m
    bodies[REACH] = 1.0
    point = np.zeros((POINTS, 1))
    none = np.array([-1])
    return Tree(bodies, none, none, point, np.array([0]), np.array([0.0, 0.0, -GRAVITY_M_S2]))


def moved(of: Tree, sliding_m_s: float, turning_rad_s: float, steps: int) -> np.ndarray:
    """Speeds of a puck after some steps of a tenth of a millisecond."""
    now, room = motion(of), work(of)
    now.pace[2], now.pace[3] = turning_rad_s, sliding_m_s
    for _ in range(steps):
        step(of, now, room, np.zeros(0), 1e-4, True)
    return now.pace


def test_a_foot_that_turns_on_its_spot_is_stopped_by_all_of_its_patch() -> None:
    rub, arm = 0.4, 0.003
    slower = rub * GRAVITY_M_S2 * arm / 2e-4  # rad/s^2
    assert moved(puck(rub, arm), 0.0, 30.0, 1000)[2] == pytest.approx(30.0 - 0.1 * slower, rel=1e-6)
    assert moved(puck(rub, arm), 0.0, 3.0, 1000)[2] == pytest.approx(0.0, abs=1e-6)
    assert moved(puck(rub, 0.0), 0.0, 30.0, 1000)[2] == 30.0


@pytest.mark.parametrize("sliding", [0.03, 0.09, 0.3])
def test_a_foot_that_turns_slides_the_easier(sliding: float) -> None:
    rub, arm, turning = 0.4, 0.003, 30.0
    share = sliding / math.hypot(sliding, arm * turning)  # of friction, against the way it slides
    lost = sliding - moved(puck(rub, arm), sliding, turning, 1)[3]
    assert lost == pytest.approx(1e-4 * rub * GRAVITY_M_S2 * share, rel=0.01)
    still = sliding - moved(puck(rub, arm), sliding, 0.0, 1)[3]
    assert still == pytest.approx(1e-4 * rub * GRAVITY_M_S2, rel=1e-6)
