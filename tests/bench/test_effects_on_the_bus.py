"""Every effect of the catalogue, as a robot's own program meets it over the emulated bus."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bench.running import Session, in_process
from busemu.plant import DriveCommand, ServoState
from busemu.tables import Robot, load_robot
from busemu.tables.robots import parse_robot
from busemu.timing import load_profile
from hal.robot_control import RobotControl
from sim.drive import fields
from sim.effects import Effect, Scope, catalogue
from sim.world import BulletPlant

EFFECTS = list(catalogue().values())
#: effects of the compiled rollouts of one joint: behind an engine they are as if always on
OF_ROLLOUTS = {"load_of_gear"}
#: an effect that a short motion at its typical size does not reach is driven further
STRONGER: dict[str, dict[str, float]] = {
    "overload_shutdown": {"duty": 0.3, "time_s": 0.05},
    "current_limit": {"limit_a": 0.3},
    "lost_samples": {"share": 0.2},
    "foot_slip": {"scale": 0.1},
}


def with_effect(robot: Robot, name: str, **values: float) -> Robot:
    parameters = {key: {"value": value, "source": "assumed"} for key, value in values.items()}
    document = {**robot.document, "effect": [{"name": name, "parameters": parameters}]}
    return parse_robot(document, robot.path)


def moved(robot: Robot, seconds: float = 0.6) -> list[tuple[float, ...]]:
    """What a program reads on the way: times, positions, loads, voltages, in its own order."""
    plant = BulletPlant(robot)
    try:
        session: Session = in_process(robot, plant, load_profile(robot.timing))
        control = RobotControl(robot, session.client)
        first = control.read_positions()
        start = np.where(np.isnan(first), 0.0, first)
        seen: list[tuple[float, ...]] = []
        control.set_goals(start)
        control.torque_on()
        while session.clock.now_s() < seconds:
            share = session.clock.now_s() / seconds
            swing = 0.25 * math.sin(4.0 * math.pi * share)
            goals = np.clip(start + swing, control.lower_rad, control.upper_rad)
            control.set_goals(goals)
            read = control.read_positions()
            slow = [
                float("nan") if raw is None else float(raw)
                for name in ("present_load", "present_voltage")
                for raw in session.client.read_all(name, control.ids).values()
            ]
            seen.append((session.clock.now_s(), *read.tolist(), *slow))
        return seen
    finally:
        plant.close()


def same(one: Any, other: Any) -> bool:
    return len(one) == len(other) and np.array_equal(np.array(one), np.array(other), equal_nan=True)


def rig_for(effect: Effect) -> Robot:
    legs = effect.scope is Scope.LEG or effect.name == "ground_compliance"
    return load_robot("marvin" if legs else "marvin-leg")


@pytest.fixture(scope="module")
def plain() -> dict[str, list[tuple[float, ...]]]:
    return {name: moved(load_robot(name)) for name in ("marvin", "marvin-leg")}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_that_is_off_changes_no_bit_of_what_a_program_reads(
    effect: Effect, plain: dict[str, Any]
) -> None:
    robot = rig_for(effect)
    assert same(moved(with_effect(robot, effect.name, **effect.off)), plain[robot.name])


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_that_is_on_shows_in_what_a_program_reads(
    effect: Effect, plain: dict[str, Any]
) -> None:
    robot = rig_for(effect)
    values = effect.typical | STRONGER.get(effect.name, {})
    assert same(moved(with_effect(robot, effect.name, **values)), plain[robot.name]) is (
        effect.name in OF_ROLLOUTS
    )


def swing(robot: Robot, until_s: float, begin: int = 0) -> list[ServoState]:
    """What the servo of a pendulum shows, a millisecond each; its goal comes at ``begin``."""
    plant = BulletPlant(robot)
    goal = DriveCommand(True, goal_position_rad=0.6, gain_ccw_per_rad=4.0)
    if begin:
        plant.command(1, replace(goal, goal_position_rad=0.0))
    found = []
    for step in range(round(until_s * 1e3)):
        plant.advance(1e-3 * step)
        if step == begin:
            plant.command(1, goal)
        found.append(plant.sample(1))
    plant.close()
    return found


def test_a_goal_acts_later_by_the_transport_delay() -> None:
    robot, at = load_robot("pendulum"), 20
    plain = [state.position_rad for state in swing(robot, 0.3, at)]
    late = [
        state.position_rad
        for state in swing(with_effect(robot, "transport_delay", delay_s=0.02), 0.32, at)
    ]
    assert late[20 + at :] == pytest.approx(plain[at:], abs=1e-9)
    assert np.ptp(late[: 20 + at]) < 1e-6 < np.ptp(plain)


def test_goals_of_servos_with_other_delays_overtake_each_other() -> None:
    delay = {"delay_s": {"value": 0.05, "source": "assumed"}}
    table = {"name": "transport_delay", "where": ["coxa"], "parameters": delay}
    leg = load_robot("marvin-leg")
    plant = BulletPlant(parse_robot({**leg.document, "effect": [table]}, leg.path))
    begun = {i: plant.sample(i).position_rad for i in (1, 3, 5)}
    for turn, more in enumerate((0.0, 0.3), 1):
        for servo_id, angle in begun.items():  # the slow one first
            plant.command(servo_id, DriveCommand(True, goal_position_rad=angle + more))
        plant.advance(0.03 * turn)
    goals = plant.bank.commands[fields.GOAL_POSITION]
    here = np.array(list(begun.values()))
    assert (goals - here).tolist() == pytest.approx([0.0, 0.3, 0.3])
    plant.advance(0.09)
    assert (goals - here).tolist() == pytest.approx([0.3, 0.3, 0.3])
    plant.close()


def test_a_load_is_renewed_at_the_multiples_of_its_period() -> None:
    robot, period = load_robot("pendulum"), 40
    plain = [state.duty for state in swing(robot, 0.3)]
    held = [
        state.duty
        for state in swing(with_effect(robot, "load_refresh", period_s=1e-3 * period), 0.3)
    ]
    assert held == [plain[k - k % period] if k >= period else 0.0 for k in range(len(held))]


def test_an_adapter_with_a_timer_holds_back_every_reply() -> None:
    def wait_s(robot: Robot) -> float:
        plant = BulletPlant(robot)
        session = in_process(robot, plant, load_profile(robot.timing))
        began_s = session.clock.now_s()
        session.client.read(1, "present_position")
        plant.close()
        return session.clock.now_s() - began_s

    robot = load_robot("pendulum")
    more_s = wait_s(with_effect(robot, "latency_timer", timer_s=0.016)) - wait_s(robot)
    assert more_s == pytest.approx(0.016, abs=2e-4)  # it begins with the reply's first byte


def test_so_many_samples_are_lost_as_the_robot_file_says() -> None:
    share, count = 0.2, 400
    robot = with_effect(load_robot("pendulum"), "lost_samples", share=share)
    plant = BulletPlant(robot)
    client = in_process(robot, plant, load_profile(robot.timing)).client
    lost = sum(client.read_all("present_position", [1])[1] is None for _ in range(count))
    plant.close()
    assert abs(lost - share * count) < 3.0 * math.sqrt(share * (1.0 - share) * count)


def test_a_goal_acceleration_takes_its_time_over_the_bus() -> None:
    """Half the way is gone at half the time of a triangle of speed: sqrt(way / acceleration)."""
    robot = load_robot("mx64-pendulum")
    (mount,) = robot.servos
    way, halves = 600, {}
    for acceleration in (0, 20):
        plant = BulletPlant(robot)
        session = in_process(robot, plant, load_profile(robot.timing))
        client, servo = session.client, mount.servo_id
        start = client.read(servo, "present_position")
        for name, raw in (
            ("moving_speed", 1000),
            ("goal_acceleration", acceleration),
            ("torque_enable", 1),
            ("goal_position", start + way),
        ):
            client.write(servo, name, raw)
        begun_s = session.clock.now_s()
        while client.read(servo, "present_position") < start + way // 2:
            assert session.clock.now_s() < begun_s + 3.0
        halves[acceleration] = session.clock.now_s() - begun_s
        plant.close()
    scale = math.radians(8.583) * 20.0
    assert halves[20] == pytest.approx(math.sqrt(way * 2.0 * math.pi / 4096.0 / scale), abs=0.06)
    assert halves[0] < 0.5 * halves[20]
