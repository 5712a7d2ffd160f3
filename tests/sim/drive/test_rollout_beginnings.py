"""How a rollout begins: a load that hangs on its gear, a goal that was there before."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from one_joint_rigs import (
    GAIN_PER_RAD,
    GRAVITY_NM,
    VOLTAGE_V,
    candidate,
    pendulum,
    plain_drive,
    position,
    pushing,
    regulating,
    replay,
    run,
)

from sim.drive import fields
from sim.drive.parameters import Friction
from sim.rollout import Candidate

STIFF_NM_RAD = 12.0
ANGLE_RAD = 1.1


def on_a_gear(play_rad: float) -> Candidate:
    drive = plain_drive(
        gear_stiffness_nm_rad=STIFF_NM_RAD,
        gear_damping_nm_s_rad=0.02,
        backlash_rad=play_rad,
        friction=Friction(coulomb_nm=0.03),
    )
    return candidate(drive, pendulum())


def holding_duty(angle_rad: float) -> float:
    """The duty that balances gravity at an angle."""
    drive = plain_drive()
    stall_nm = drive.torque_constant_nm_a * VOLTAGE_V / drive.resistance_ohm
    return GRAVITY_NM * math.sin(angle_rad) / stall_nm


@pytest.mark.parametrize("play_rad", [0.0, 0.06])
@pytest.mark.parametrize("angle_rad", [ANGLE_RAD, -ANGLE_RAD])
def test_a_joint_that_rests_stays(angle_rad: float, play_rad: float) -> None:
    """Else its load sinks into the gear first, and into the play."""
    told = replay(pushing(holding_duty(angle_rad)), position_rad=angle_rad, duration_s=0.5)
    sinks = position(run(on_a_gear(play_rad), told))
    stays = position(run(on_a_gear(play_rad), replace(told, rests=True)))
    assert np.ptp(stays) < 2e-4
    deep = GRAVITY_NM * math.sin(abs(angle_rad)) / STIFF_NM_RAD + 0.5 * play_rad
    assert np.ptp(sinks) > 0.9 * deep


def test_a_cable_pulls_at_the_gear_of_a_joint_that_rests_too() -> None:
    pull_nm, stiffness = 0.2, 0.1
    drive = on_a_gear(0.0).drive.copy()
    drive[fields.CABLE_STIFFNESS], drive[fields.CABLE_REST] = stiffness, pull_nm / stiffness
    one = replace(on_a_gear(0.0), drive=drive)
    stall_nm = GRAVITY_NM * math.sin(1.0) / holding_duty(1.0)
    told = replay(pushing(-pull_nm / stall_nm), position_rad=0.0, duration_s=0.3)
    assert np.ptp(position(run(one, replace(told, rests=True)))) < 2e-4
    assert np.ptp(position(run(one, told))) > 0.9 * pull_nm / STIFF_NM_RAD


def test_a_load_that_hangs_by_itself_is_in_the_middle_of_its_play() -> None:
    told = replace(replay(pushing(0.2), position_rad=0.0, duration_s=0.3), rests=True)
    up = position(run(on_a_gear(0.06), told))
    down = position(run(on_a_gear(0.06), replace(told, start=replay(pushing(-0.2)).start)))
    assert up == pytest.approx(-down, abs=1e-9)
    assert up[-1] > 0.01


def test_a_goal_that_was_in_force_before_holds_at_once() -> None:
    """Though its speed is limited; a new one starts from where the joint is, and lets it fall."""
    goal = ANGLE_RAD + holding_duty(ANGLE_RAD) / GAIN_PER_RAD
    told = replay(
        regulating(goal, velocity_limit_rad_s=0.1), position_rad=ANGLE_RAD, duration_s=0.3
    )
    one = candidate(plain_drive(sensor_step_rad=0.001), pendulum())
    falls = position(run(one, told))
    held = position(run(one, replace(told, held_rad=goal)))
    assert np.ptp(held) < 1e-3
    assert ANGLE_RAD - falls.min() > 0.01


def test_what_was_held_before_is_the_goal_until_there_is_another() -> None:
    goal = ANGLE_RAD + holding_duty(ANGLE_RAD) / GAIN_PER_RAD
    told = replay(regulating(-2.0), position_rad=ANGLE_RAD, duration_s=0.3)
    one = candidate(plain_drive(), pendulum())
    assert np.ptp(position(run(one, replace(told, held_rad=goal)))) < 1e-3
    assert np.ptp(position(run(one, told))) > 0.1
