"""Rigs: trees of joints on a fixed base, and the load of a rig of one joint."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sim_rigs import changed, swing

from busemu.plant import DriveCommand
from busemu.tables import Robot, RobotError, load_robot
from sim.condition import under
from sim.one_joint import one_joint_load
from sim.robot import read_physics
from sim.tree import GRAVITY_M_S2
from sim.world import BulletPlant, World

Make = Callable[..., BulletPlant]
PENDULUMS = (
    "pendulum",
    "xl330-pendulum",
    "xl320-pendulum",
    "mx64-pendulum",
    "mx106-pendulum",
    "sts3215-pendulum",
)
RIGS = (*PENDULUMS, "marvin-leg", "arm")
HELD = {"payload_kg": 0.35, "payload_at_m": 0.15, "payload_inertia_kg_m2": 1.2e-4}


def value(number: Any) -> dict[str, Any]:
    return {"value": number, "source": "assumed"}


def test_a_pendulums_load_is_the_sum_of_arm_and_weight() -> None:
    rig = read_physics(load_robot("pendulum"))
    (arm,) = rig.bodies
    load = one_joint_load(rig, HELD)
    down = -arm.mass.centre_m[2]
    about_axis = arm.mass.inertia_kg_m2[1] + arm.mass.mass_kg * down**2
    assert load.inertia_kg_m2 == pytest.approx(about_axis + 1.2e-4 + 0.35 * 0.15**2)
    assert load.gravity_nm == pytest.approx(GRAVITY_M_S2 * (arm.mass.mass_kg * down + 0.35 * 0.15))
    assert load.centre_rad == 0.0


@pytest.mark.parametrize("name", PENDULUMS)
def test_the_engine_swings_a_one_joint_rig_as_its_load_says(name: str) -> None:
    rig = under(read_physics(load_robot(name)), HELD)
    load = one_joint_load(rig)
    world = World(rig, step_s=1e-4)
    turn = np.zeros(1)
    position, velocity = np.zeros(1), np.zeros(1)
    for angle in (-2.0, -0.3, 0.5, 1.6):
        world.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), {"arm": angle})
        world.step(turn)
        world.read(position, velocity)
        wanted = -load.gravity_nm * math.sin(angle - load.centre_rad) / load.inertia_kg_m2
        assert velocity[0] / 1e-4 == pytest.approx(wanted, rel=1e-6)
    world.close()


@pytest.mark.parametrize("hangs", [-0.7, 0.0, 1.1])
def test_a_load_hangs_at_its_centre_whichever_way_the_axis_points(hangs: float) -> None:
    robot = load_robot("pendulum")
    at = [0.1 * math.sin(hangs), 0.0, -0.1 * math.cos(hangs)]
    tilted = changed(robot, "payload", "at_m", to=value(at))
    tilted = changed(tilted, "body", 0, "mass_kg", to=value(0.0))
    load = one_joint_load(read_physics(tilted))
    assert load.centre_rad == pytest.approx(hangs)
    backwards = changed(tilted, "body", 0, "axis", to=value([0.0, -1.0, 0.0]))
    assert one_joint_load(read_physics(backwards)).centre_rad == pytest.approx(-hangs)


def test_the_weight_of_a_joint_that_leans_counts_in_its_plane_of_motion() -> None:
    lean = 0.4
    robot = changed(
        load_robot("pendulum"), "body", 0, "axis", to=value([math.sin(lean), math.cos(lean), 0.0])
    )
    upright = one_joint_load(read_physics(load_robot("pendulum")))
    across = one_joint_load(read_physics(robot))
    assert across.gravity_nm == pytest.approx(upright.gravity_nm)
    stood = changed(robot, "body", 0, "axis", to=value([0.0, math.cos(lean), math.sin(lean)]))
    leaning = one_joint_load(read_physics(stood))
    assert leaning.gravity_nm == pytest.approx(upright.gravity_nm * math.cos(lean) ** 2)


def test_small_swings_have_the_pendulums_period() -> None:
    rig = read_physics(load_robot("pendulum"))
    load = one_joint_load(rig)
    world = World(rig, step_s=1e-4)
    measured = swing(world, "arm", 0.02)
    world.close()
    wanted = 2.0 * math.pi * math.sqrt(load.inertia_kg_m2 / load.gravity_nm)
    assert measured == pytest.approx(wanted * (1.0 + 0.02**2 / 16.0), rel=2e-4)


@pytest.mark.parametrize("name", RIGS)
def test_rigs_hold_their_goals_behind_their_servos(make: Make, name: str) -> None:
    robot = load_robot(name)
    plant = make(robot)
    start = plant.observe()
    for servo in robot.servos:
        goal = servo.to_servo(start[f"rig/{servo.joint}_rad"] + 0.2)
        law = DriveCommand(
            torque_enable=True,
            goal_position_rad=goal,
            velocity_limit_rad_s=2.0,
            gain_cw_per_rad=5.0,
            gain_ccw_per_rad=5.0,
        )
        plant.command(servo.servo_id, law)
    plant.advance(1.5)
    seen = plant.observe()
    for servo in robot.servos:
        joint = f"rig/{servo.joint}_rad"
        assert seen[joint] == pytest.approx(start[joint] + 0.2, abs=0.03)
    assert seen["contact/self_n"] == 0.0
    assert not any(key.startswith("mocap/") for key in seen)


def test_a_leg_on_a_stand_is_a_leg_of_the_robot_it_comes_from() -> None:
    whole, alone = read_physics(load_robot("marvin")), read_physics(load_robot("marvin-leg"))
    for segment in ("coxa", "femur", "tibia"):
        one, other = whole.body(f"leg6.{segment}"), alone.body(segment)
        assert one.mass == other.mass
        assert one.axis == other.axis
        assert (one.shapes, one.parent is None) == (other.shapes, other.parent is None)
        if segment != "coxa":
            assert one.at_m == other.at_m
    assert [j.drive for j in alone.joints] == [whole.joints[0].drive] * 3


def test_a_light_load_on_a_stiff_gear_gets_shorter_steps_and_a_heavy_one_does_not(
    make: Make,
) -> None:
    robot = load_robot("xl330-pendulum")
    assert make(robot).step_s < 0.001
    assert make(robot, condition={"payload_kg": 0.3}).step_s == 0.001


def test_a_condition_replaces_weight_and_supply_and_leaves_the_rest() -> None:
    rig = read_physics(load_robot("pendulum"))
    assert under(rig, {"support": "rig", "note": 3}) == rig
    heavy = under(rig, {**HELD, "supply_v": 11.1})
    assert heavy.supply.voltage_v == 11.1
    assert heavy.supply.resistance_ohm == rig.supply.resistance_ohm
    assert heavy.payload is not None
    assert heavy.payload.mass_kg == 0.35
    assert heavy.payload.at_m == pytest.approx((0.0, 0.0, -0.15))
    assert heavy.bodies == rig.bodies


REFUSED = {
    "no file's payload": ("marvin", {"payload_kg": 0.1}, "no [payload]"),
    "negative": ("pendulum", {"payload_kg": -0.1}, "-0.1 kg is not within 0 to 20 kg"),
    "text": ("pendulum", {"payload_at_m": "long"}, "number in m"),
    "dead supply": ("pendulum", {"supply_v": 0.0}, "1 to 50 V"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_condition_that_cannot_be_is_refused(case: str) -> None:
    name, condition, says = REFUSED[case]
    with pytest.raises(RobotError) as caught:
        under(read_physics(load_robot(name)), condition)
    assert says in str(caught.value)


def test_only_a_rig_of_one_joint_is_a_load_of_one_joint() -> None:
    for name in ("arm", "marvin"):
        with pytest.raises(RobotError, match="one joint"):
            one_joint_load(read_physics(load_robot(name)))


INSANE = {
    "long axis": (("body", 0, "axis"), value([0.0, 2.0, 0.0]), "axis"),
    "axis of length 0.5": (("body", 0, "axis"), value([0.0, 0.5, 0.0]), "unit vector"),
    "parent below": (("body", 0, "parent"), "arm", "no body above"),
    "no limits": (("body", 0, "lower_rad"), None, "lower_rad"),
    "limits crossed": (("body", 0, "lower_rad"), value(2.7), "not below"),
    "impossible inertia": (
        ("body", 0, "inertia_kg_m2"),
        value([1e-5, 1e-5, 3e-5]),
        "no rigid body",
    ),
    "misspelt key": (("body", 0, "mas_kg"), value(1.0), "mas_kg"),
    "weight on nothing": (("payload", "body"), "hand", "arm"),
    "trunk of a rig": (("trunk",), {}, "no trunk"),
    "servo elsewhere": (("servo", 0, "joint"), "hand", "arm has no servo"),
    "rest beyond the stops": (("rest",), {"arm_rad": value(3.0)}, "-2.6 to 2.6"),
}


@pytest.mark.parametrize("case", INSANE)
def test_insane_rigs_are_refused_with_one_line(case: str) -> None:
    keys, to, says = INSANE[case]
    with pytest.raises(RobotError) as caught:
        read_physics(changed(load_robot("pendulum"), *keys, to=to))
    assert says in str(caught.value)
    assert "pendulum.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_has_no_inertia_about_its_axis_is_refused_with_what_to_give() -> None:
    point = changed(load_robot("pendulum"), "payload", to=None)
    point = changed(point, "body", 0, "com_m", to=value([0.0, 0.0, 0.0]))
    point = changed(point, "body", 0, "inertia_kg_m2", to=value([0.0, 0.0, 0.0]))
    with pytest.raises(RobotError, match=r"pendulum\.toml: .* no inertia .* give its \[\[body\]\]"):
        BulletPlant(point)


def test_a_rigid_gear_is_refused_with_how_stiff_it_may_be() -> None:
    rigid = changed(load_robot("pendulum"), "drive", "AX-12A", "gear_stiffness_nm_rad", to=None)
    with pytest.raises(RobotError, match=r"arm: no gear_stiffness_nm_rad is given, .* at most"):
        BulletPlant(rigid)


def test_a_body_without_mass_is_refused_where_it_would_move(make: Make) -> None:
    empty: Robot = changed(load_robot("pendulum"), "body", 0, "mass_kg", to=value(0.0))
    with pytest.raises(RobotError, match=r"arm has no mass: give it mass_kg"):
        make(empty, condition={"payload_kg": 0.0})
    make(empty).advance(0.01)
