"""Friction that gives way before it slips, against theory in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from one_joint_rigs import (
    INERTIA_KG_M2,
    OFF,
    candidate,
    level,
    pendulum,
    plain_drive,
    position,
    pushing,
    replay,
    run,
)

from sim import rollout
from sim.drive import fields, lanes
from sim.drive.bank import DriveBank, command_column
from sim.drive.parameters import DriveParameters, Friction
from sim.stepped import TICK_S

LEVEL_NM, BREAKAWAY_RAD = 0.06, 5e-4
INERTIA = INERTIA_KG_M2 + plain_drive().rotor_inertia_kg_m2


def giving_way(breakaway_rad: float = BREAKAWAY_RAD, **more: Any) -> DriveParameters:
    friction = Friction(coulomb_nm=LEVEL_NM)
    return plain_drive(friction=friction, breakaway_rad=breakaway_rad, **more)


def pulled(share: float, breakaway_rad: float = BREAKAWAY_RAD, **more: Any) -> np.ndarray:
    """Angles of a joint at which a weight pulls evenly, with a share of the friction's level."""
    load = pendulum(share * LEVEL_NM, centre_rad=0.5 * math.pi)
    return run(candidate(giving_way(breakaway_rad), load), replay(**more))


@pytest.mark.parametrize("share", [-0.45, -0.2, 0.3, 0.45])
def test_below_its_level_friction_is_a_spring(share: float) -> None:
    angle = position(pulled(share, duration_s=2.0))
    assert angle[-1] == pytest.approx(share * BREAKAWAY_RAD, rel=2e-3)


def test_above_its_level_it_slips_and_pulls_no_more() -> None:
    out = pulled(2.0, duration_s=0.1)
    assert position(out)[50] > 5.0 * BREAKAWAY_RAD
    faster = out[100, lanes.OUT_VELOCITY] - out[50, lanes.OUT_VELOCITY]
    assert faster == pytest.approx(LEVEL_NM / INERTIA * 50 * TICK_S, rel=2e-3)


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_joint_that_coasts_springs_back_from_where_it_stops(way: float) -> None:
    speed = way * 1.0
    stop_s = INERTIA * abs(speed) / LEVEL_NM
    angle = position(
        run(
            candidate(giving_way(), level()),
            replay(velocity_rad_s=speed, duration_s=2.0 + 2.0 * stop_s),
        )
    )
    back = way * (angle - angle[-1]).max() if way > 0.0 else (angle[-1] - angle).max()
    assert 0.3 * BREAKAWAY_RAD < back <= BREAKAWAY_RAD
    # what energy says, less the little that it needs to bend
    assert abs(angle[-1]) == pytest.approx(0.5 * INERTIA * speed**2 / LEVEL_NM, rel=0.02)


def test_without_an_angle_it_is_friction_that_holds() -> None:
    still = pulled(0.9, 0.0, duration_s=0.5)
    assert (position(still) == 0.0).all()
    almost = position(pulled(0.9, 1e-9, duration_s=0.5))
    assert np.abs(almost).max() < 1.1e-9


def test_it_never_makes_energy() -> None:
    """A swing through many reversals, undriven."""
    out = run(candidate(giving_way()), replay(position_rad=0.8, duration_s=4.0))
    load = pendulum()
    height = load.sine_nm * (1.0 - np.cos(position(out)))
    energy = 0.5 * INERTIA * out[:, lanes.OUT_VELOCITY] ** 2 + height
    bending = 0.5 * LEVEL_NM * BREAKAWAY_RAD  # what the spring may give back
    assert (np.maximum.accumulate(energy[::-1])[::-1] - energy).max() < 1.1 * bending
    assert energy[-1] < energy[0] / 100.0


def test_shorter_steps_change_little(monkeypatch: pytest.MonkeyPatch) -> None:
    push = [(0.01 * k, fields.GOAL_DUTY, 0.15 * math.sin(0.7 * k)) for k in range(1, 100)]
    told = replay(pushing(0.0), events=push, duration_s=1.0)
    found = []
    for substeps in (5, 10, 80):
        monkeypatch.setattr(rollout, "RIGID_SUBSTEPS", substeps)
        found.append(position(run(candidate(giving_way()), told)))
    apart = [float(np.abs(one - found[-1]).max()) for one in found[:-1]]
    assert np.ptp(found[-1]) > 20.0 * BREAKAWAY_RAD
    assert apart[0] < 0.3 * BREAKAWAY_RAD
    assert apart[1] < 0.7 * apart[0]


def test_a_physics_engines_servos_give_way_alike() -> None:
    """The same drive behind a shaft that is held: the rotor twists the gear and the bristles."""
    stiffness = 30.0
    drive = giving_way(gear_stiffness_nm_rad=stiffness, gear_damping_nm_s_rad=0.05)
    bank = DriveBank(
        [drive],
        np.zeros(1),
        supply_voltage_v=12.0,
        supply_resistance_ohm=0.0,
        step_s=TICK_S,
        substeps=10,
        tick_s=TICK_S,
    )
    duty = 0.02
    bank.command(0, command_column(pushing(duty)))
    still = np.zeros(1)
    for _ in range(2000):
        bank.tick(still, still)
        bank.step(still, still)
    motor = drive.torque_constant_nm_a * 12.0 * duty / drive.resistance_ohm
    assert motor < LEVEL_NM
    bent = motor / (stiffness + LEVEL_NM / BREAKAWAY_RAD)
    assert bank.states[fields.ROTOR_POSITION, 0] == pytest.approx(bent, rel=1e-3)
    assert bank.states[fields.BENT, 0] == pytest.approx(bent, rel=1e-3)
    assert bank.torque_nm[0] == pytest.approx(stiffness * bent, rel=1e-3)
    bank.command(0, command_column(OFF))
    for _ in range(2000):
        bank.step(still, still)
    assert abs(bank.states[fields.ROTOR_POSITION, 0]) < 0.01 * bent
