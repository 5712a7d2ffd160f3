"""When things happen: ticks, slices, repeatability, several plants at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from sim_rigs import LAWS, hold, with_effect

from busemu.plant import DriveCommand, Plant
from busemu.tables import Robot, load_robot
from sim.stepped import TICK_S, grid_index
from sim.world import BulletPlant, plant

Make = Callable[..., BulletPlant]
POSTURE = {"coxa": 0.2, "femur": 0.9, "tibia": -1.8}


def everything(p: BulletPlant, robot: Robot) -> tuple:
    states = tuple(p.sample(s.servo_id) for s in robot.servos)
    return (*states, *sorted(p.observe().items()))


def test_slicing_an_advance_changes_no_bit(robot: Robot, make: Make) -> None:
    whole, sliced = make(robot), make(robot)
    hold(whole, robot, POSTURE)
    hold(sliced, robot, POSTURE)
    rng = np.random.default_rng(1)
    now = 0.0
    while now < 0.4:
        now = min(0.4, now + float(rng.choice([1e-7, 3.3e-5, 1e-3, 2.7e-3, 1.234e-2])))
        sliced.advance(now)
        sliced.sample(1)
    whole.advance(0.4)
    assert everything(whole, robot) == everything(sliced, robot)
    for p in (whole, sliced):
        hold(p, robot, plant_neutral(p))
    whole.advance(0.7003)
    for step in range(1, 301):
        sliced.advance(0.4 + 0.001 * step)
    sliced.advance(0.7003)
    assert everything(whole, robot) == everything(sliced, robot)


def plant_neutral(p: BulletPlant) -> dict[str, float]:
    return dict(p.robot.neutral_rad)


def test_two_runs_are_the_same_to_the_bit(robot: Robot, make: Make) -> None:
    def run() -> tuple:
        p = make(robot)
        hold(p, robot, POSTURE)
        p.advance(0.6)
        return everything(p, robot)

    assert run() == run()


def test_two_plants_in_one_process_do_not_touch_each_other(make: Make) -> None:
    marvin, phantom = load_robot("marvin"), load_robot("phantomx")
    alone = make(marvin)
    hold(alone, marvin, POSTURE)
    alone.advance(0.3)
    first, second = make(marvin), make(phantom)
    hold(first, marvin, POSTURE)
    hold(second, phantom, POSTURE)
    for step in range(1, 31):
        first.advance(0.01 * step)
        second.advance(0.01 * step)
    second.close()
    assert everything(first, marvin) == everything(alone, marvin)
    first.advance(0.35)


@pytest.mark.parametrize(
    ("given_s", "acts_s"),
    [(0.0, 0.001), (0.0104, 0.011), (0.010, 0.011), (0.010999, 0.011)],
)
@pytest.mark.parametrize("steps_per_tick", [1, 2])
def test_a_command_acts_from_the_next_tick(
    make: Make, given_s: float, acts_s: float, steps_per_tick: int
) -> None:
    robot = load_robot("marvin")
    p = make(robot, held=True, steps_per_tick=steps_per_tick)
    p.advance(given_s)
    here = p.sample(1).position_rad
    p.command(1, DriveCommand(torque_enable=True, goal_position_rad=here + 0.5, **LAWS["marvin"]))
    p.advance(acts_s)
    assert p.sample(1).duty == 0.0
    p.advance(acts_s + 1e-5)
    assert p.sample(1).duty > 0.5


def test_a_goal_given_later_within_a_tick_replaces_the_earlier_one(make: Make) -> None:
    robot = load_robot("marvin")
    p = make(robot, held=True)
    for when, goal in ((0.0101, 0.5), (0.0109, -0.5)):
        p.advance(when)
        p.command(1, DriveCommand(torque_enable=True, goal_position_rad=goal, **LAWS["marvin"]))
    p.advance(0.0115)
    assert p.sample(1).duty < -0.5


def test_a_goal_given_at_a_tick_leaves_that_tick_to_the_earlier_goal(make: Make) -> None:
    robot = load_robot("marvin")
    p = make(robot, held=True)
    p.advance(0.0095)
    p.command(1, DriveCommand(torque_enable=True, goal_position_rad=0.5, **LAWS["marvin"]))
    p.advance(0.010)
    p.command(1, DriveCommand(torque_enable=True, goal_position_rad=-0.5, **LAWS["marvin"]))
    p.advance(0.0105)
    assert p.sample(1).duty > 0.5
    p.advance(0.0115)
    assert p.sample(1).duty < -0.5


def test_goals_are_late_and_switching_is_not(make: Make) -> None:
    robot = with_effect(load_robot("marvin"), "transport_delay", [], delay_s=0.01)
    p = make(robot, held=True)

    def told(goal: float, *, on: bool = True) -> None:
        p.command(1, DriveCommand(torque_enable=on, goal_position_rad=goal, **LAWS["marvin"]))

    told(-0.5, on=False)  # what was told before it was switched on never comes
    p.advance(0.0085)
    told(0.5)
    p.advance(0.0105)
    assert p.sample(1).duty > 0.5
    told(-0.5)
    p.advance(0.0135)
    assert p.sample(1).duty > 0.5
    p.advance(0.0205)
    assert p.sample(1).duty > 0.5
    p.advance(0.0215)
    assert p.sample(1).duty < -0.5
    told(-0.5, on=False)
    p.advance(0.0225)
    assert p.sample(1).duty == 0.0


def test_a_sample_lies_on_the_line_between_two_steps(make: Make) -> None:
    robot = load_robot("marvin")
    p = make(robot, held=True)
    hold(p, robot, POSTURE)
    positions = []
    for when in (0.050, 0.05025, 0.0505, 0.051):
        p.advance(when)
        positions.append(p.sample(3).position_rad)
    start, quarter, half, end = positions
    assert start != end
    assert quarter == pytest.approx(start + 0.25 * (end - start), abs=1e-12)
    assert half == pytest.approx(start + 0.5 * (end - start), abs=1e-12)


def test_time_never_runs_backwards(make: Make) -> None:
    p = make(load_robot("marvin"))
    p.advance(0.01)
    p.advance(0.01)
    with pytest.raises(ValueError, match="go back"):
        p.advance(0.009)
    with pytest.raises(ValueError, match="go back"):
        p.advance(float("nan"))


def test_an_unknown_servo_is_a_key_error(make: Make) -> None:
    p = make(load_robot("marvin"))
    with pytest.raises(KeyError):
        p.sample(99)
    with pytest.raises(KeyError):
        p.command(99, DriveCommand())


def test_instants_of_decimal_seconds_fall_on_the_grid() -> None:
    for tick in range(100_000):
        assert grid_index(tick * 0.001, TICK_S, up=True) == tick
        assert grid_index(tick / 1000, TICK_S, up=False) == tick
    assert grid_index(0.0100001, TICK_S, up=True) == 11
    assert grid_index(0.0099999, TICK_S, up=False) == 9


def test_the_entry_point_satisfies_the_plant_protocol() -> None:
    p: Plant = plant(load_robot("marvin"))
    p.advance(0.002)
    seen = p.observe()
    for key in ("mocap/base_x_m", "mocap/base_yaw_rad", "contact/leg6_n", "contact/trunk_n"):
        assert key in seen
    assert {f"rig/{s.joint}_rad" for s in load_robot("marvin").servos} <= set(seen)
    p.close()


def test_closing_twice_is_fine_and_frees_the_world() -> None:
    for _ in range(50):
        p = plant(load_robot("marvin"))
        p.close()
        p.close()


def test_closing_late_does_not_close_the_next_plant(make: Make) -> None:
    robot = load_robot("marvin")
    old = make(robot)
    old.close()
    new = make(robot)
    old.close()
    new.advance(0.01)
