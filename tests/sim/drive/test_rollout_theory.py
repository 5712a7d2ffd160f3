"""Rollouts of one joint against theory in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from one_joint_rigs import (
    GAIN_PER_RAD,
    GRAVITY_NM,
    INERTIA_KG_M2,
    VOLTAGE_V,
    candidate,
    goals,
    level,
    pendulum,
    periods_s,
    plain_drive,
    position,
    pushing,
    regulating,
    replay,
    run,
    swinging,
)
from scipy.special import ellipk

from sim import rollout
from sim.drive import lanes, lockstep
from sim.drive.parameters import DriveParameters, Friction
from sim.rollout import Load
from sim.stepped import TICK_S

DRIVE = plain_drive()
INERTIA = INERTIA_KG_M2 + DRIVE.rotor_inertia_kg_m2
OMEGA = math.sqrt(GRAVITY_NM / INERTIA)
#: torque per duty, stalled
PUSH_NM = DRIVE.torque_constant_nm_a * VOLTAGE_V / DRIVE.resistance_ohm


def viscous(nm_s_rad: float) -> DriveParameters:
    return plain_drive(friction=Friction(viscous_nm_s_rad=nm_s_rad))


def coulomb(nm: float) -> DriveParameters:
    return plain_drive(friction=Friction(coulomb_nm=nm))


def zeros(angle: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.diff(np.sign(angle))) + 1


def turning_points(out: np.ndarray) -> np.ndarray:
    """The largest angle of every half swing that is whole."""
    angle = position(out)
    return np.array([np.abs(half).max() for half in np.split(angle, zeros(angle))[1:-1]])


@pytest.mark.parametrize("amplitude_rad", [0.02, 1.0, 2.5])
def test_a_pendulum_swings_at_the_period_of_theory(amplitude_rad: float) -> None:
    out = run(candidate(), replay(position_rad=amplitude_rad, duration_s=6.0))
    wanted = 4.0 / OMEGA * ellipk(math.sin(0.5 * amplitude_rad) ** 2)
    assert np.mean(periods_s(position(out))) == pytest.approx(wanted, rel=1e-3)


def test_viscous_friction_damps_a_swing_as_theory_says() -> None:
    more = 0.006
    out = run(candidate(viscous(more)), replay(position_rad=0.05, duration_s=6.0))
    decay = more / (2.0 * INERTIA)
    damped = math.sqrt(OMEGA**2 - decay**2)
    assert np.mean(periods_s(position(out))) == pytest.approx(2.0 * math.pi / damped, rel=1e-3)
    lost = -np.diff(np.log(turning_points(out))) / (math.pi / damped)
    assert np.mean(lost) == pytest.approx(decay, rel=0.01)


def test_a_shorted_motor_brakes_with_its_back_emf() -> None:
    """Zero duty with torque on: ``k ke / R`` is viscous friction."""
    start = 4.0
    out = run(candidate(load=level()), replay(pushing(0.0), velocity_rad_s=start, duration_s=0.2))
    rate = DRIVE.torque_constant_nm_a * DRIVE.back_emf_v_s_rad / DRIVE.resistance_ohm / INERTIA
    t = np.arange(len(out)) * TICK_S
    assert out[:, lanes.OUT_VELOCITY] == pytest.approx(start * np.exp(-rate * t), abs=0.01 * start)


def energy(out: np.ndarray) -> np.ndarray:
    return 0.5 * INERTIA * out[:, lanes.OUT_VELOCITY] ** 2 + GRAVITY_NM * (
        1.0 - np.cos(position(out))
    )


@pytest.mark.parametrize("amplitude_rad", [0.3, 1.5, 2.8])
def test_a_passive_joint_without_friction_neither_makes_nor_loses_energy(
    amplitude_rad: float,
) -> None:
    """Over some 40 periods, at the turning points: what steps do in between is not a drift."""
    out = run(candidate(), replay(position_rad=amplitude_rad, duration_s=40.0))
    tops = turning_points(out)
    assert tops.max() <= amplitude_rad * (1.0 + 1e-4)
    assert tops.min() >= amplitude_rad * (1.0 - 2e-3)


@pytest.mark.parametrize("drive", [coulomb(0.02), viscous(0.003)])
def test_a_passive_joint_with_friction_only_loses_energy(drive: DriveParameters) -> None:
    out = run(candidate(drive), replay(position_rad=2.0, duration_s=5.0))
    assert (np.diff(turning_points(out)) < 0.0).all()
    bottoms = energy(out)[zeros(position(out))]
    assert (np.diff(bottoms) < 0.0).all()


def test_coulomb_friction_stops_a_coasting_joint_where_energy_says() -> None:
    nm, speed = 0.06, 3.0
    stop_s = INERTIA * speed / nm
    out = run(
        candidate(coulomb(nm), level()), replay(velocity_rad_s=speed, duration_s=1.5 * stop_s)
    )
    still = out[math.ceil(stop_s / TICK_S) + 1 :]
    assert len(still) > 20
    assert position(still)[0] == pytest.approx(0.5 * INERTIA * speed**2 / nm, rel=2e-3)


def test_a_joint_that_friction_stopped_stays_exactly_where_it_is() -> None:
    """Gravity pulls below the friction level all the while."""
    nm = 0.06
    load = pendulum(0.9 * nm, centre_rad=0.5 * math.pi)
    out = run(candidate(coulomb(nm), load), replay(velocity_rad_s=-2.0, duration_s=2.0))
    later = out[len(out) // 2 :]
    assert (later[:, lanes.OUT_VELOCITY] == 0.0).all()
    assert (position(later) == position(later)[0]).all()
    assert position(later)[0] != 0.0


def test_a_load_above_the_friction_level_moves() -> None:
    nm = 0.06
    load = pendulum(1.1 * nm, centre_rad=0.5 * math.pi)
    out = run(candidate(coulomb(nm), load), replay(duration_s=0.5))
    t = 0.1
    fallen = 0.5 * 0.1 * nm / INERTIA * t**2
    assert position(out)[round(t / TICK_S)] == pytest.approx(fallen, rel=0.03)


@pytest.mark.parametrize("gravity_nm", [0.1, 0.4, 0.9])
def test_held_against_gravity_the_error_is_the_torque(gravity_nm: float) -> None:
    goal = 0.5 * math.pi
    held = run(
        candidate(viscous(0.3), pendulum(gravity_nm)),
        replay(regulating(goal), position_rad=goal, duration_s=6.0),
    )
    rest = position(held)[-1]
    assert held[-1, lanes.OUT_VELOCITY] == pytest.approx(0.0, abs=1e-6)
    wanted = gravity_nm * math.sin(rest) / (PUSH_NM * GAIN_PER_RAD)
    assert goal - rest == pytest.approx(wanted, rel=1e-4)
    assert held[-1, lanes.OUT_DUTY] == pytest.approx(GAIN_PER_RAD * (goal - rest), rel=1e-6)


def test_beyond_full_duty_the_joint_gives_what_it_can() -> None:
    """A load of 1.2 stall torques: the arm sinks until its lever is short enough."""
    gravity_nm, goal = 1.2 * PUSH_NM, 0.5 * math.pi
    held = run(
        candidate(viscous(1.0), pendulum(gravity_nm)),
        replay(regulating(goal), position_rad=goal, duration_s=20.0),
    )
    assert held[-1, lanes.OUT_DUTY] == 1.0
    assert math.sin(position(held)[-1]) == pytest.approx(1.0 / 1.2, rel=1e-4)


@pytest.mark.parametrize("load_ratio", [0.0, 0.4])
def test_a_stiff_gear_becomes_a_rigid_one(
    monkeypatch: pytest.MonkeyPatch, load_ratio: float
) -> None:
    monkeypatch.setattr(rollout, "GEAR_SUBSTEPS", 40)
    monkeypatch.setattr(rollout, "RIGID_SUBSTEPS", 40)
    friction = Friction(
        viscous_nm_s_rad=0.02, load_motor=load_ratio, load_external=0.5 * load_ratio
    )
    base = plain_drive(friction=friction)
    drives = [
        replace(base, gear_stiffness_nm_rad=k, gear_damping_nm_s_rad=0.3)
        for k in (30.0, 300.0, 3000.0, 30000.0)
    ]
    rigid = position(run(candidate(base), swinging()))
    apart = [np.abs(position(run(candidate(d), swinging())) - rigid).max() for d in drives]
    for softer, stiffer in itertools.pairwise(apart):
        assert stiffer < 0.5 * softer
    assert apart[-1] < (0.01 if load_ratio == 0.0 else 0.03) * apart[0]  # friction has corners


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("stiffness", [math.inf, 3e4])
def test_load_friction_knows_the_inertia_of_a_load_as_far_as_its_gear_says(
    share: float, stiffness: float
) -> None:
    """Without gravity ``I a = t - K (t + share I_load a)``: the gear passes on ``I_load a``."""
    ratio, t_s = 0.3, 0.05
    drive = plain_drive(
        friction=Friction(load_motor=ratio, load_external=ratio),
        load_of_gear=share,
        back_emf_v_s_rad=1e-9,
        gear_stiffness_nm_rad=stiffness,
        gear_damping_nm_s_rad=0.0 if math.isinf(stiffness) else 1.0,
    )
    out = run(candidate(drive, level()), replay(pushing(0.2), duration_s=t_s + TICK_S))
    speed = out[:, lanes.OUT_VELOCITY]
    wanted = (1.0 - ratio) * 0.2 * PUSH_NM / (INERTIA + ratio * share * INERTIA_KG_M2)
    assert (speed[-1] - speed[5]) / (len(speed) - 6) / TICK_S == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("stiffness", [math.inf, 50.0])
def test_the_error_of_a_rollout_falls_with_the_step(
    monkeypatch: pytest.MonkeyPatch, stiffness: float
) -> None:
    drive = plain_drive(
        friction=Friction(viscous_nm_s_rad=0.02),
        gear_stiffness_nm_rad=stiffness,
        gear_damping_nm_s_rad=0.05,
    )

    def rolled(substeps: int) -> np.ndarray:
        monkeypatch.setattr(rollout, "RIGID_SUBSTEPS", substeps)
        monkeypatch.setattr(rollout, "GEAR_SUBSTEPS", substeps)
        return position(run(candidate(drive), swinging()))

    finest = rolled(640)
    errors = [np.abs(rolled(n) - finest).max() for n in (5, 10, 20, 40)]
    for coarse, fine in itertools.pairwise(errors):
        assert fine == pytest.approx(0.5 * coarse, rel=0.1)
    assert errors[0] < 2e-3  # rad: what the shipped number of steps leaves


def test_a_moving_gravity_is_spread_over_the_replay() -> None:
    """From pushing one way to the other: the angle of a free joint is the double integral."""
    pull, duration = 0.2, 0.5
    load = Load(1.0, np.zeros(3), np.array([pull, 0.0, -pull]))
    out = run(candidate(load=load), replay(duration_s=duration))
    t = np.arange(len(out)) * TICK_S
    inertia = 1.0 + DRIVE.rotor_inertia_kg_m2
    speed = pull / inertia * (t - t**2 / duration)
    held = pull / inertia * TICK_S  # what holding it for a tick may do
    assert out[:, lanes.OUT_VELOCITY] == pytest.approx(speed, abs=1.01 * held)
    assert held < 0.01 * speed.max()


def test_a_bearing_of_the_load_holds_it_though_the_gear_gives(load_friction: Any) -> None:
    held = load_friction(0.1)
    free = load_friction(0.0)
    assert (held == held[0]).all()
    assert np.ptp(free) > 1e-3


@pytest.fixture
def load_friction() -> Iterator[Any]:
    """The shaft's angle with a bearing, through the kernel: candidates have none."""
    drive = plain_drive(
        gear_stiffness_nm_rad=20.0, gear_damping_nm_s_rad=0.05, friction=Friction(coulomb_nm=9.0)
    )

    def rolled(bearing_nm: float) -> np.ndarray:
        batch = rollout.Batch([replay(duration_s=0.3)], 1)
        one = candidate(drive, pendulum(0.09, centre_rad=1.0))
        groups, jobs = batch._jobs([one], [0])
        groups[:, lanes.OF_LOADS + lanes.SHAFT_FRICTION] = bearing_nm
        at = np.empty((lanes.PLACES, lockstep.LANES), np.int64)
        out = np.full((1, 301, lanes.CHANNELS), np.nan)
        rollout.ROLLOUTS[rollout.SOFT](groups, jobs, TICK_S, 20, 0, 1, at, out)
        return position(out[0])

    return rolled


def test_goals_are_followed_at_the_lag_of_a_first_order_system() -> None:
    """A ramp of the goal: behind by speed over (gain times torque per duty over damping)."""
    damping, speed = 1.5, 0.4
    t = np.arange(0.0, 3.0, TICK_S)
    out = run(
        candidate(viscous(damping), level()),
        replay(regulating(), events=goals(t, speed * t), samples=t),
    )
    emf = DRIVE.torque_constant_nm_a * DRIVE.back_emf_v_s_rad / DRIVE.resistance_ohm
    lag = speed * (damping + emf) / (PUSH_NM * GAIN_PER_RAD)
    assert speed * t[-1] - position(out)[-1] == pytest.approx(lag, rel=5e-3)
