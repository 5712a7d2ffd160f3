"""The hidden world of one joint: it keeps the laws that need no model of a servo."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bench.blind.bristles import Bristles
from bench.blind.instant import TICK_S
from bench.blind.pendulum import GRAVITY_M_S2, Commands, Trace, roll
from bench.blind.rigs import RIGS
from bench.blind.specimen import Build, Gear, Numerics, Specimen

LET_GO = -1.0


def free(specimen: Specimen) -> Specimen:
    """A specimen without any friction."""
    return specimen.but(coulomb_nm=0.0, viscous_nm_s_rad=0.0)


def swing(specimen: Specimen, start_rad: float, seconds: float = 4.0) -> Trace:
    return roll(specimen, Commands(np.zeros(1), np.full(1, start_rad), seconds, LET_GO))


def inertia(specimen: Specimen) -> float:
    arm = specimen.arm
    own = arm.inertia_kg_m2[1] + arm.mass_kg * arm.com_m[2] ** 2
    return own + specimen.payload_kg * specimen.payload_at_m**2 + specimen.armature_kg_m2


def moment(specimen: Specimen) -> float:
    """Mass times distance [kg m]."""
    hung = specimen.payload_kg * specimen.payload_at_m
    return hung - specimen.arm.mass_kg * specimen.arm.com_m[2]


@pytest.fixture
def pendulum() -> Specimen:
    return RIGS["xl330-pendulum"].specimen()


def test_small_swing_has_the_period_of_a_physical_pendulum(pendulum: Specimen) -> None:
    trace = swing(free(pendulum), 0.02)
    crossings = np.flatnonzero(np.diff(np.sign(trace.position_rad)))
    measured_s = 2.0 * TICK_S * float(np.diff(crossings).mean())
    expected_s = 2.0 * math.pi * math.sqrt(inertia(pendulum) / (GRAVITY_M_S2 * moment(pendulum)))
    assert measured_s == pytest.approx(expected_s, rel=2e-3)


def test_free_swing_keeps_its_energy(pendulum: Specimen) -> None:
    still = free(pendulum).but(numerics=Numerics(substeps=4))
    trace = swing(still, 1.0)
    lifted = GRAVITY_M_S2 * moment(still) * (1.0 - np.cos(trace.position_rad))
    energy = 0.5 * inertia(still) * trace.velocity_rad_s**2 + lifted
    assert np.ptp(energy) < 5e-3 * energy[0]


def test_holding_torque_is_weight_times_lever(pendulum: Specimen) -> None:
    trace = roll(free(pendulum), Commands(np.zeros(1), np.full(1, 1.0), 3.0))
    held_nm = pendulum.torque_constant_nm_a * trace.current_a[-1]
    lever = math.sin(trace.position_rad[-1])
    # the drive holds to within one count of the sensor
    count_nm = pendulum.sheet.law({}).gain_per_rad * pendulum.sheet.step_rad
    count_nm *= pendulum.sheet.stall_torque_nm
    assert held_nm == pytest.approx(GRAVITY_M_S2 * moment(pendulum) * lever, abs=count_nm)


def test_dry_friction_holds_what_is_below_its_level(pendulum: Specimen) -> None:
    weight_nm = GRAVITY_M_S2 * moment(pendulum) * math.sin(0.5)
    held = swing(pendulum.but(coulomb_nm=1.1 * weight_nm), 0.5)
    fell = swing(pendulum.but(coulomb_nm=0.9 * weight_nm), 0.5)
    assert np.abs(held.position_rad - 0.5).max() < 0.1 * pendulum.sheet.step_rad
    # it comes to rest where friction has taken all that the fall gave
    end = float(fell.position_rad[-1])
    gave = GRAVITY_M_S2 * moment(pendulum) * (math.cos(end) - math.cos(0.5))
    assert end < 0.45
    assert gave == pytest.approx(0.9 * weight_nm * (0.5 - end), rel=0.02)


def test_bristles_give_way_by_the_weight_over_their_stiffness_and_hold(pendulum: Specimen) -> None:
    weight_nm = GRAVITY_M_S2 * moment(pendulum) * math.sin(0.5)
    stiffness = 1000.0 * weight_nm
    held = swing(pendulum.but(coulomb_nm=2.5 * weight_nm, bristle_nm_rad=stiffness), 0.5)
    sunk = 0.5 - held.position_rad
    assert sunk[-1] == pytest.approx(1e-3, rel=0.01)
    assert np.ptp(sunk[len(sunk) // 2 :]) < 1e-6
    slipped = swing(pendulum.but(coulomb_nm=0.9 * weight_nm, bristle_nm_rad=stiffness), 0.5)
    end = float(slipped.position_rad[-1])
    gave = GRAVITY_M_S2 * moment(pendulum) * (math.cos(end) - math.cos(0.5))
    assert gave == pytest.approx(0.9 * weight_nm * (0.5 - end), rel=0.02)


def test_bristles_slip_at_their_level_and_turn_back_elastically() -> None:
    bristles = Bristles(stiffness_nm_rad=100.0, inertia_kg_m2=1e-3, step_s=1e-3)
    pulls = [bristles.torque(1.0, 0.5) for _ in range(20)]
    assert pulls[-1] == -0.5
    assert bristles.bent_rad == 0.005
    assert bristles.torque(-1.0, 0.5) > -0.5
    assert bristles.bent_rad == pytest.approx(0.004)
    assert -0.2 <= bristles.torque(0.0, 0.2) < 0.0  # a level that fell


def test_a_sprung_gear_turns_behind_a_rotor_that_rests() -> None:
    rig = RIGS["xl330-rod"]
    still = rig.specimen(0.0, Build(sprung=True)).but(coulomb_nm=50.0)
    trace = swing(still.gear_but(damping_nm_s_rad=0.0), 0.05)
    crossings = np.flatnonzero(np.diff(np.sign(trace.position_rad - trace.position_rad.mean())))
    hz = 0.5 / (TICK_S * float(np.diff(crossings).mean()))
    spring = rig.sheet.gear_stiffness_nm_rad + GRAVITY_M_S2 * moment(still)
    arm = inertia(still) - still.armature_kg_m2
    assert hz == pytest.approx(math.sqrt(spring / arm) / (2.0 * math.pi), rel=0.01)


def test_the_law_works_on_what_is_counted_at_a_tick(pendulum: Specimen) -> None:
    slow = pendulum.but(tick_s=1.4e-3, tick_phase=0.25)
    goals = Commands(np.array([0.0, 0.5]), np.array([0.0, 0.8]), 1.0, start_rad=0.0)
    trace = roll(slow, goals, np.random.default_rng(1))
    assert np.diff(trace.t_s) == pytest.approx(1.4e-3)
    assert trace.t_s[0] / 1.4e-3 % 1.0 == pytest.approx(0.25)
    step = slow.sheet.step_rad
    goal = np.where(trace.t_s >= 0.5, 0.8, 0.0)
    law = np.clip(slow.sheet.law({}).gain_per_rad * (goal - step * trace.count), -1.0, 1.0)
    assert trace.duty == pytest.approx(law)
    off = trace.count - trace.sensed_rad / step
    spread = math.hypot(slow.sensing.noise_steps, 1.0 / math.sqrt(12.0))
    assert np.std(off[trace.t_s > 0.5]) == pytest.approx(spread, rel=0.1)


def test_noise_is_the_seeds_and_none_without_one(pendulum: Specimen) -> None:
    goals = Commands(np.zeros(1), np.full(1, 0.8), 0.5, start_rad=0.0)
    one, same, other = (roll(pendulum, goals, np.random.default_rng(n)) for n in (1, 1, 2))
    assert np.array_equal(one.count, same.count)
    assert not np.array_equal(one.count, other.count)
    quiet = roll(pendulum, goals)
    assert np.array_equal(quiet.count, np.round(quiet.sensed_rad / pendulum.sheet.step_rad))


def test_full_duty_without_load_reaches_the_data_sheets_speed() -> None:
    rig = RIGS["xl330-turntable"]
    bare = rig.specimen(0.0)
    goals = Commands(np.zeros(1), np.full(1, 60.0), 3.0, start_rad=0.0)
    trace = roll(bare, goals)
    assert trace.velocity_rad_s[-1] == pytest.approx(rig.sheet.no_load_velocity_rad_s, rel=1e-3)


def test_smaller_steps_converge(pendulum: Specimen) -> None:
    fine = swing(pendulum.but(numerics=Numerics(substeps=16)), 1.0).position_rad
    off = [
        float(np.abs(swing(pendulum.but(numerics=Numerics(n)), 1.0).position_rad - fine).max())
        for n in (1, 2, 4)
    ]
    assert off[0] > 1.5 * off[1] > 2.0 * off[2] > 0.0


@pytest.mark.parametrize("gear", [Gear(play_rad=1e-5), Gear(stiffness_nm_rad=1e4)])
def test_tight_gear_is_nearly_none(pendulum: Specimen, gear: Gear) -> None:
    goals = Commands(np.zeros(1), np.full(1, 0.8), 2.0, start_rad=0.0)
    rigid, tight = roll(pendulum, goals), roll(pendulum.but(gear=gear), goals)
    apart = np.abs(rigid.position_rad - tight.position_rad)
    assert np.sqrt(np.mean(apart**2)) < pendulum.sheet.step_rad


def test_play_lets_the_output_move_by_its_width() -> None:
    rig = RIGS["xl330-turntable"]
    loose = rig.specimen().but(gear=Gear(play_rad=0.05), coulomb_nm=5.0, tilt_y_rad=0.2)
    trace = swing(loose, 0.0, 3.0)
    rigid = swing(loose.but(gear=Gear()), 0.0, 3.0)
    moved = np.abs(trace.position_rad[-1] - rigid.position_rad[-1])
    assert moved == pytest.approx(0.025, rel=0.05)


def test_gravity_does_not_turn_an_upright_shaft() -> None:
    trace = swing(free(RIGS["xl330-turntable"].specimen()), 0.7)
    assert np.abs(trace.position_rad - 0.7).max() < 1e-9


def test_a_case_that_explodes_is_an_error_and_leaves_no_file(
    pendulum: Specimen, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(str(tmp_path))
    with pytest.raises(ArithmeticError, match="the engine became unstable"):
        swing(pendulum.but(viscous_nm_s_rad=-5.0), 0.5)
    assert list(Path.cwd().iterdir()) == []
