"""A servo on a pendulum, against what theory says in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from sim_rigs import changed

from busemu.plant import DriveCommand, OperatingMode
from busemu.tables import Robot, load_robot
from sim.drive import fields
from sim.one_joint import OneJointLoad, one_joint_load
from sim.world import BulletPlant

Make = Callable[..., BulletPlant]
SERVO = 1


def value(number: float) -> dict[str, Any]:
    return {"value": number, "source": "assumed"}


def pendulum(**drive: float) -> Robot:
    """The pendulum with a stiff, well-known drive: no counts, no heat, no sag, little else."""
    robot = load_robot("pendulum")
    plain = {"sensor_step_rad": 0.0, "resistance_rise_per_k": 0.0, "coulomb_nm": 0.0}
    for key, number in (plain | drive).items():
        robot = changed(robot, "drive", "AX-12A", key, to=value(number))
    return changed(robot, "supply", "resistance_ohm", to=value(0.0))


def level(robot: Robot) -> Robot:
    """The same in a horizontal plane: no gravity about its axis."""
    return changed(robot, "body", 0, "axis", to=value_of([0.0, 0.0, 1.0]))


def value_of(numbers: list[float]) -> dict[str, Any]:
    return {"value": numbers, "source": "assumed"}


def loaded(plant: BulletPlant) -> tuple[OneJointLoad, float]:
    """The load, and the inertia of load and rotor together."""
    load = one_joint_load(plant.robot)
    return load, load.inertia_kg_m2 + plant.robot.joints[0].drive.rotor_inertia_kg_m2


def follow(plant: BulletPlant, seconds: float, every_s: float = 0.001) -> np.ndarray:
    """Angle [rad] and velocity [rad/s] in the servo's frame, shape (samples, 2)."""
    start, rows = plant._now_s, []
    for step in range(round(seconds / every_s)):
        plant.advance(start + every_s * (step + 1))
        state = plant.sample(SERVO)
        rows.append((state.position_rad, state.velocity_rad_s))
    return np.array(rows)


def at(robot: Robot, angle_rad: float) -> Robot:
    document = {**robot.document, "rest": {"arm_rad": value(angle_rad)}}
    return type(robot)(
        robot.name,
        robot.path,
        robot.protocol,
        robot.baud_rate,
        robot.timing,
        robot.servos,
        document,
    )


def test_viscous_friction_damps_a_swing_at_the_period_of_theory(make: Make) -> None:
    viscous = 0.006
    plant = make(at(pendulum(viscous_nm_s_rad=viscous), 0.05))
    load, inertia = loaded(plant)
    seen = follow(plant, 8.0)[:, 0]
    decay = viscous / (2.0 * inertia)
    omega = math.sqrt(load.gravity_nm / inertia - decay**2)
    crossings = np.flatnonzero(np.diff(np.sign(seen)))
    period_s = 2.0 * float(np.mean(np.diff(crossings))) * 0.001
    assert period_s == pytest.approx(2.0 * math.pi / omega, rel=0.003)
    halves = [np.abs(a).max() for a in np.split(seen, crossings)[1:-1]]
    lost = -np.diff(np.log(halves)) / (math.pi / omega)
    assert float(np.mean(lost)) == pytest.approx(decay, rel=0.02)


def energies_j(plant: BulletPlant, seconds: float) -> np.ndarray:
    """Load, rotor, gear and height together, at every step."""
    load, _ = loaded(plant)
    params, states = plant.bank.params[:, 0], plant.bank.states[:, 0]
    rows = []
    for step in range(round(seconds / plant.step_s)):
        plant.advance(plant.step_s * (step + 1))
        seen = plant.sample(SERVO)
        twist = states[fields.ROTOR_POSITION] - seen.position_rad
        rows.append(
            0.5 * load.inertia_kg_m2 * seen.velocity_rad_s**2
            + 0.5 * params[fields.ROTOR_INERTIA] * states[fields.ROTOR_VELOCITY] ** 2
            + 0.5 * params[fields.GEAR_STIFFNESS] * twist**2
            + load.gravity_nm * (1.0 - math.cos(seen.position_rad))
        )
    return np.array(rows)


def test_a_passive_pendulum_only_loses_energy(make: Make) -> None:
    """With the friction of its own data sheet, or even a twentieth of the viscous part alone."""
    own = make(at(load_robot("pendulum"), 1.0))
    viscous = own.robot.joints[0].drive.friction.viscous_nm_s_rad
    assert viscous > 0.0
    for plant in (own, make(at(pendulum(viscous_nm_s_rad=0.05 * viscous), 1.0))):
        energy = energies_j(plant, 4.0)
        tenths = energy.reshape(-1, 100).mean(axis=1)
        assert (np.diff(tenths) < 0.0005 * energy[0]).all()  # the ripple of semi-implicit steps
        assert tenths[-1] < 0.99 * tenths[0]


def test_what_steps_add_to_a_frictionless_swing_falls_with_the_step(make: Make) -> None:
    """The rotor's push comes half a step late, which adds a little energy: less than 1 %/s."""
    gains = []
    for steps_per_tick in (1, 2, 4):
        plant = make(at(pendulum(viscous_nm_s_rad=0.0), 1.0), steps_per_tick=steps_per_tick)
        energy = energies_j(plant, 4.0)
        second = round(1.0 / plant.step_s)
        gains.append((energy[-second:].mean() / energy[:second].mean() - 1.0) / 3.0)
    assert gains[0] < 0.01
    for coarse, finer in pairwise(gains):
        assert finer < 0.6 * coarse


def step_response(make: Make, gain: float) -> tuple[np.ndarray, float, float]:
    """Angles after a small step of the goal in the plane, damping ratio and goal."""
    goal = 0.05
    plant = make(level(pendulum(viscous_nm_s_rad=0.0, gear_damping_nm_s_rad=0.05)))
    drive = plant.robot.joints[0].drive
    _, inertia = loaded(plant)
    volts = plant.robot.supply.voltage_v
    law = DriveCommand(
        torque_enable=True, goal_position_rad=goal, gain_cw_per_rad=gain, gain_ccw_per_rad=gain
    )
    plant.command(SERVO, law)
    stiffness = drive.torque_constant_nm_a * volts * gain / drive.resistance_ohm
    damping = drive.torque_constant_nm_a * drive.back_emf_v_s_rad / drive.resistance_ohm
    # the firmware holds its duty for a tick of 1 ms: on average it is half a tick old
    damping -= stiffness * 0.0005
    ratio = damping / (2.0 * math.sqrt(stiffness * inertia))
    return follow(plant, 2.0)[:, 0], ratio, goal


@pytest.mark.parametrize("gain", [5.0, 15.0])
def test_a_step_overshoots_as_a_second_order_system_does(make: Make, gain: float) -> None:
    seen, ratio, goal = step_response(make, gain)
    assert 0.1 < ratio < 1.0
    overshoot = seen.max() / goal - 1.0
    wanted = math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2))
    assert overshoot == pytest.approx(wanted, abs=0.015)
    assert seen[-1] == pytest.approx(goal, rel=0.002)


def test_coulomb_friction_stops_a_coasting_joint_where_energy_says(make: Make) -> None:
    friction = 0.05
    plant = make(level(pendulum(viscous_nm_s_rad=0.0, coulomb_nm=friction)))
    _, inertia = loaded(plant)
    full = DriveCommand(torque_enable=True, operating_mode=OperatingMode.PWM, goal_duty=0.4)
    plant.command(SERVO, full)
    plant.advance(0.25)
    plant.command(SERVO, DriveCommand())
    plant.advance(0.252)
    start = plant.sample(SERVO)
    seen = follow(plant, 3.0)
    coasts = 0.5 * inertia * start.velocity_rad_s**2 / friction
    assert coasts > 0.2
    assert seen[-1, 0] - start.position_rad == pytest.approx(coasts, rel=0.05)
    assert abs(seen[-1, 1]) < 1e-3


def test_held_against_gravity_the_error_is_the_torque_until_the_duty_is_full(make: Make) -> None:
    plant = make(pendulum(viscous_nm_s_rad=0.0), condition={"payload_kg": 0.5})
    load, _ = loaded(plant)
    drive, gain = plant.robot.joints[0].drive, 5.0
    stall = drive.torque_constant_nm_a * plant.robot.supply.voltage_v / drive.resistance_ohm
    for number, goal in enumerate((0.3, 0.8, 1.4)):
        law = DriveCommand(
            torque_enable=True,
            goal_position_rad=goal,
            velocity_limit_rad_s=1.0,
            gain_cw_per_rad=gain,
            gain_ccw_per_rad=gain,
        )
        plant.command(SERVO, law)
        plant.advance(4.0 * (number + 1))
        angle = plant.sample(SERVO).position_rad
        wanted = load.gravity_nm * math.sin(angle)
        assert stall * gain * (goal - angle) == pytest.approx(wanted, rel=0.01)
        assert plant.sample(SERVO).torque_nm == pytest.approx(wanted, rel=0.01)
    heavy = make(pendulum(viscous_nm_s_rad=0.0), condition={"payload_kg": 2.0})
    heavy.command(
        SERVO,
        DriveCommand(torque_enable=True, goal_position_rad=1.5, gain_ccw_per_rad=gain,
                     gain_cw_per_rad=gain, velocity_limit_rad_s=0.3),
    )  # fmt: skip
    heavy.advance(20.0)
    assert heavy.sample(SERVO).torque_nm == pytest.approx(stall, rel=0.02)
    hangs = math.asin(stall / one_joint_load(heavy.robot).gravity_nm)
    assert heavy.sample(SERVO).position_rad == pytest.approx(hangs, rel=0.03)


def test_halving_the_step_halves_the_error_of_a_swing(make: Make) -> None:
    def swings(steps_per_tick: int) -> np.ndarray:
        plant = make(at(pendulum(), 1.2), steps_per_tick=steps_per_tick)
        return follow(plant, 2.0, 0.01)[:, 0]

    fine = swings(16)
    errors = [float(np.sqrt(np.mean((swings(k) - fine) ** 2))) for k in (1, 2, 4)]
    assert errors[0] < 0.002
    for coarse, finer in pairwise(errors):
        assert finer < 0.65 * coarse
