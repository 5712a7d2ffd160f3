"""The promises of `busemu.plant.Plant`, held by every plant."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from dataclasses import astuple, replace
from typing import Any

import pytest

from busemu.plant import DriveCommand, IdealPlant, OperatingMode, Plant, ServoState
from busemu.tables import load_robot

Make = Callable[[], Plant]
IDS = range(1, 19)


def bullet() -> Any:
    world = pytest.importorskip("sim.world")
    return world.BulletPlant(load_robot("marvin"), held=True)


def mujoco() -> Any:
    legs = pytest.importorskip("bench.blind.legs")
    legged = pytest.importorskip("bench.blind.legged")
    every = tuple(f"leg{i}" for i in range(1, 7))
    return legs.LegsPlant(load_robot("marvin"), legged.Body(support="suspended", legs=every))


@pytest.fixture(params=["ideal", "bullet", "mujoco"])
def make(request: pytest.FixtureRequest) -> Iterator[Make]:
    made: list[Any] = []

    def one() -> Plant:
        others = {"bullet": bullet, "mujoco": mujoco}
        plant = IdealPlant(IDS) if request.param == "ideal" else others[request.param]()
        made.append(plant)
        return plant

    yield one
    for plant in made:
        if hasattr(plant, "close"):
            plant.close()


def hold(plant: Plant, goal_rad: float, **more: Any) -> DriveCommand:
    return DriveCommand(
        torque_enable=True,
        goal_position_rad=goal_rad,
        gain_cw_per_rad=5.0,
        gain_ccw_per_rad=5.0,
        **more,
    )


def state(plant: Plant) -> list[ServoState]:
    return [plant.sample(i) for i in IDS]


def test_plant_begins_at_rest_with_sound_numbers(make: Make) -> None:
    for servo in state(make()):
        assert all(math.isfinite(value) for value in astuple(servo))
        assert servo.velocity_rad_s == servo.duty == 0.0
        assert 5.0 < servo.voltage_v < 15.0
        assert 0.0 < servo.temperature_c < 60.0


def test_time_never_goes_back(make: Make) -> None:
    plant = make()
    plant.advance(0.01)
    with pytest.raises(ValueError, match="back"):
        plant.advance(0.0099)
    with pytest.raises(ValueError, match="back"):
        plant.advance(math.nan)
    before = state(plant)
    plant.advance(0.01)
    assert state(plant) == before


def test_unknown_servo_is_a_key_error(make: Make) -> None:
    plant = make()
    for servo_id in (0, 19, 254):
        with pytest.raises(KeyError):
            plant.sample(servo_id)
        with pytest.raises(KeyError):
            plant.command(servo_id, DriveCommand())


def run(plant: Plant, slices: int, looks: bool) -> list[Any]:
    """A fixed programme of commands; between them, time passes in so many slices."""
    now_s = 0.0
    seen = []
    for round_ in range(10):
        for i in IDS:
            goal = 0.2 * math.sin(round_ + i)
            plant.command(i, hold(plant, goal, velocity_limit_rad_s=2.0))
        for part in range(slices):
            plant.advance(now_s + 0.0137 * (part + 1) / slices)
            if looks:
                state(plant)
                plant.observe()
        now_s += 0.0137
        plant.advance(now_s)
        seen.append([astuple(servo) for servo in state(plant)])
    return seen


def near(runs: list[Any]) -> list[float]:
    return [value for seen in runs for servo in seen for value in servo]


def test_how_time_is_sliced_does_not_change_the_result(make: Make) -> None:
    whole = near(run(make(), 1, looks=False))
    for slices in (2, 17):
        assert near(run(make(), slices, looks=False)) == pytest.approx(whole, abs=1e-9)


def test_looking_does_not_change_the_result(make: Make) -> None:
    assert near(run(make(), 5, looks=True)) == near(run(make(), 5, looks=False))


def test_two_plants_alike_run_alike_to_the_bit(make: Make) -> None:
    assert run(make(), 3, looks=False) == run(make(), 3, looks=False)


def test_command_changes_nothing_before_time_passes(make: Make) -> None:
    plant = make()
    plant.advance(0.0105)
    before = [s.position_rad for s in state(plant)]
    plant.command(1, hold(plant, before[0] + 0.3))
    assert [s.position_rad for s in state(plant)] == before
    plant.advance(0.2)
    assert plant.sample(1).position_rad > before[0] + 0.1


def test_servo_without_torque_does_not_drive(make: Make) -> None:
    plant = make()
    plant.command(1, DriveCommand(torque_enable=False, goal_position_rad=1.0))
    plant.advance(0.05)
    assert plant.sample(1).duty == 0.0


def test_position_mode_brings_the_servo_to_its_goal(make: Make) -> None:
    plant = make()
    before = plant.sample(1).position_rad
    for i in IDS:
        plant.command(i, hold(plant, plant.sample(i).position_rad))
    plant.command(1, hold(plant, before + 0.3))
    plant.advance(1.5)
    assert plant.sample(1).position_rad == pytest.approx(before + 0.3, abs=0.03)
    assert abs(plant.sample(1).velocity_rad_s) < 0.05


def test_velocity_limit_holds_on_the_way(make: Make) -> None:
    plant = make()
    before = plant.sample(1).position_rad
    plant.command(1, hold(plant, before + 0.6, velocity_limit_rad_s=0.5))
    plant.advance(0.5)
    moved = plant.sample(1).position_rad - before
    assert 0.1 < moved < 0.35


@pytest.mark.parametrize(
    "command",
    [
        DriveCommand(
            torque_enable=True,
            operating_mode=OperatingMode.VELOCITY,
            goal_velocity_rad_s=1.0,
            gain_cw_per_rad=5.0,
            gain_ccw_per_rad=5.0,
        ),
        DriveCommand(torque_enable=True, operating_mode=OperatingMode.PWM, goal_duty=0.4),
    ],
)
def test_velocity_and_pwm_modes_turn_the_servo_their_way(make: Make, command: DriveCommand) -> None:
    for sign in (1.0, -1.0):
        plant = make()
        before = plant.sample(1).position_rad
        plant.command(
            1,
            replace(
                command,
                goal_velocity_rad_s=sign * command.goal_velocity_rad_s,
                goal_duty=sign * command.goal_duty,
            ),
        )
        plant.advance(0.3)
        assert sign * (plant.sample(1).position_rad - before) > 0.05


def test_observations_are_numbers_with_a_namespace(make: Make) -> None:
    plant = make()
    plant.advance(0.02)
    for name, value in plant.observe().items():
        assert name.split("/")[0] in ("mocap", "contact", "rig")
        assert math.isfinite(value)


def test_every_plant_is_installed_by_its_name() -> None:
    plants = importlib.import_module("busemu.assemble").plants()
    assert set(plants) == {"bullet", "ideal"}
