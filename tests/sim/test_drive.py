"""The servo drive alone, on loads whose answer is known in closed form."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from busemu.plant import DriveCommand, OperatingMode, position_duty
from busemu.tables import load_robot
from sim.drive import fields
from sim.drive.bank import DriveBank, command_column
from sim.drive.parameters import DriveParameters, Friction
from sim.robot import read_physics

MODELS = ("marvin", "phantomx")
FULL = DriveCommand(torque_enable=True, operating_mode=OperatingMode.PWM, goal_duty=1.0)


def drive_of(name: str) -> DriveParameters:
    return read_physics(load_robot(name)).joints[0].drive


def bank_of(
    drives: list[DriveParameters], voltage_v: float | None = None, resistance_ohm: float = 0.0
) -> DriveBank:
    return DriveBank(
        drives,
        np.zeros(len(drives)),
        supply_voltage_v=drives[0].data_sheet.voltage_v if voltage_v is None else voltage_v,
        supply_resistance_ohm=resistance_ohm,
        step_s=0.001,
        substeps=10,
        tick_s=0.001,
    )


def clamp(bank: DriveBank, at_rad: np.ndarray, for_s: float) -> None:
    """Output shafts held still."""
    still = np.zeros_like(at_rad)
    for _ in range(round(for_s * 1000)):
        bank.tick(at_rad, still)
        bank.step(at_rad, still)


def spin(bank: DriveBank, for_s: float, inertia_kg_m2: float = 2e-4) -> tuple[float, float]:
    """A free disc on the first shaft: its angle and velocity after a while."""
    position, velocity = np.zeros(1), np.zeros(1)
    for _ in range(round(for_s * 1000)):
        bank.tick(position, velocity)
        bank.step(position, velocity)
        velocity = velocity + bank.torque_nm[:1] / inertia_kg_m2 * 0.001
        position = position + velocity * 0.001
    return float(position[0]), float(velocity[0])


@pytest.mark.parametrize("name", MODELS)
def test_constants_reproduce_the_data_sheet(name: str) -> None:
    drive = drive_of(name)
    sheet = drive.data_sheet
    assert drive.stall_torque_nm(sheet.voltage_v) == pytest.approx(sheet.stall_torque_nm)
    assert drive.no_load_velocity_rad_s(sheet.voltage_v) == pytest.approx(
        sheet.no_load_velocity_rad_s
    )
    assert drive.torque_constant_nm_a < drive.back_emf_v_s_rad  # gears lose, they do not gain


@pytest.mark.parametrize("name", MODELS)
def test_a_free_shaft_runs_at_the_no_load_speed(name: str) -> None:
    drive = drive_of(name)
    bank = bank_of([drive])
    bank.command(0, command_column(FULL))
    _, velocity = spin(bank, 1.0)
    assert velocity == pytest.approx(drive.data_sheet.no_load_velocity_rad_s, rel=0.01)
    assert bank.states[fields.CURRENT, 0] == pytest.approx(
        drive.data_sheet.no_load_current_a, rel=0.03
    )


@pytest.mark.parametrize("name", MODELS)
def test_static_torque_is_a_line_in_the_error_that_saturates_at_stall(name: str) -> None:
    drive = replace(drive_of(name), sensor_step_rad=0.0, resistance_rise_per_k=0.0)
    errors = np.linspace(-0.4, 0.4, 41)
    bank = bank_of([drive] * errors.size)
    for i, error in enumerate(errors):
        law = DriveCommand(
            torque_enable=True,
            goal_position_rad=float(error),
            velocity_limit_rad_s=0.2,  # slowly, so that the rotor does not swing beyond
            gain_cw_per_rad=5.0,
            gain_ccw_per_rad=5.0,
        )
        bank.command(i, command_column(law))
    clamp(bank, np.zeros(errors.size), 3.0)
    sheet, friction = drive.data_sheet, drive.friction.coulomb_nm
    level = np.minimum(5.0 * np.abs(errors), 1.0) * (sheet.stall_torque_nm + friction) - friction
    wanted = np.sign(errors) * np.maximum(level, 0.0)  # pushing, with friction against it
    assert np.abs(bank.torque_nm - wanted).max() < 0.015 * sheet.stall_torque_nm
    assert bank.torque_nm[errors > 0.21] == pytest.approx(sheet.stall_torque_nm, rel=0.01)
    assert bank.states[fields.CURRENT, -1] == pytest.approx(sheet.stall_current_a, rel=0.01)


def test_the_position_law_is_that_of_the_plant_seam() -> None:
    rng = np.random.default_rng(5)
    drive = replace(drive_of("phantomx"), sensor_step_rad=0.0)
    bank = bank_of([drive] * 200)
    at = rng.uniform(-0.3, 0.3, 200)
    laws = [
        DriveCommand(
            torque_enable=bool(rng.integers(0, 5)),
            goal_position_rad=float(rng.uniform(-0.3, 0.3)),
            duty_limit=float(rng.uniform(0.2, 1.0)),
            gain_cw_per_rad=float(rng.uniform(0.0, 8.0)),
            gain_ccw_per_rad=float(rng.uniform(0.0, 8.0)),
            margin_cw_rad=float(rng.uniform(0.0, 0.1)),
            margin_ccw_rad=float(rng.uniform(0.0, 0.1)),
            punch_duty=float(rng.uniform(0.0, 0.2)),
        )
        for _ in range(200)
    ]
    for i, law in enumerate(laws):
        bank.command(i, command_column(law))
    bank.tick(at, np.zeros(200))
    wanted = [position_duty(law, float(q)) for law, q in zip(laws, at, strict=True)]
    assert bank.states[fields.DUTY] == pytest.approx(wanted, abs=1e-12)


def test_the_velocity_limit_ramps_the_goal() -> None:
    bank = bank_of([drive_of("marvin")])
    law = DriveCommand(
        torque_enable=True, goal_position_rad=1.0, velocity_limit_rad_s=2.0, gain_ccw_per_rad=5.0
    )
    bank.command(0, command_column(law))
    for _ in range(250):
        bank.tick(np.zeros(1), np.zeros(1))
    assert bank.states[fields.RAMP, 0] == pytest.approx(0.5)
    for _ in range(300):
        bank.tick(np.zeros(1), np.zeros(1))
    assert bank.states[fields.RAMP, 0] == 1.0


def test_the_ramp_starts_where_the_shaft_is_when_torque_comes_on() -> None:
    bank = bank_of([drive_of("marvin")])
    at = np.array([0.8])
    bank.tick(at, np.zeros(1))
    law = DriveCommand(
        torque_enable=True, goal_position_rad=0.0, velocity_limit_rad_s=1.0, gain_cw_per_rad=5.0
    )
    bank.command(0, command_column(law))
    bank.tick(at, np.zeros(1))
    assert bank.states[fields.RAMP, 0] == pytest.approx(0.8, abs=0.005)


def test_the_integral_removes_the_droop_and_does_not_wind_up_beyond_full_duty() -> None:
    drive = replace(drive_of("marvin"), sensor_step_rad=0.0)
    bank = bank_of([drive])
    law = DriveCommand(
        torque_enable=True,
        goal_position_rad=0.02,
        gain_cw_per_rad=1.0,
        gain_ccw_per_rad=1.0,
        integral_gain_per_rad_s=20.0,
        duty_limit=0.6,
    )
    bank.command(0, command_column(law))
    clamp(bank, np.zeros(1), 0.5)
    assert bank.states[fields.DUTY, 0] == pytest.approx(0.02 + 20.0 * 0.02 * 0.5, rel=0.01)
    clamp(bank, np.zeros(1), 5.0)
    assert bank.states[fields.INTEGRAL, 0] == 0.6
    assert bank.states[fields.DUTY, 0] == 0.6


def test_the_derivative_opposes_motion() -> None:
    drive = replace(drive_of("marvin"), sensor_step_rad=0.0)
    bank = bank_of([drive])
    law = DriveCommand(torque_enable=True, goal_position_rad=1.0, derivative_gain_s_per_rad=0.1)
    bank.command(0, command_column(law))
    for tick in range(3):
        bank.tick(np.array([0.002 * tick]), np.array([2.0]))
    assert bank.states[fields.DUTY, 0] == pytest.approx(-0.2)


def test_velocity_mode_gives_a_share_of_full_output() -> None:
    drive = drive_of("phantomx")
    bank = bank_of([drive])
    mode = OperatingMode.VELOCITY
    half = DriveCommand(
        torque_enable=True,
        operating_mode=mode,
        goal_velocity_rad_s=0.5 * drive.velocity_full_scale_rad_s,
    )
    bank.command(0, command_column(half))
    _, velocity = spin(bank, 1.0)
    assert bank.states[fields.DUTY, 0] == pytest.approx(0.5)
    assert velocity == pytest.approx(drive.no_load_velocity_rad_s(6.0), rel=0.02)


def test_torque_off_lets_no_current_flow_and_zero_duty_brakes() -> None:
    drive = drive_of("marvin")
    coast, brake = bank_of([drive]), bank_of([drive])
    brake.command(0, command_column(replace(FULL, goal_duty=0.0)))
    for bank in (coast, brake):
        bank.states[fields.ROTOR_VELOCITY] = 5.0
    turned = []
    for bank in (coast, brake):
        position = np.zeros(1)
        for _ in range(5):
            velocity = bank.states[fields.ROTOR_VELOCITY].copy()
            bank.tick(position, velocity)
            bank.step(position, velocity)
            position = position + 0.001 * velocity
        turned.append(float(bank.states[fields.ROTOR_VELOCITY, 0]))
    assert coast.states[fields.CURRENT, 0] == 0.0
    assert brake.states[fields.CURRENT, 0] < -0.1
    assert turned[1] < turned[0] < 5.0


def test_friction_holds_a_load_below_its_level_without_creep() -> None:
    drive = drive_of("marvin")
    bank = bank_of([drive])
    twist = 0.9 * drive.friction.coulomb_nm / drive.gear_stiffness_nm_rad
    clamp(bank, np.array([twist]), 0.2)
    before = float(bank.states[fields.ROTOR_POSITION, 0])
    clamp(bank, np.array([twist]), 5.0)
    assert bank.states[fields.ROTOR_POSITION, 0] == before
    assert abs(before) < 0.2 * twist


def test_friction_never_drives() -> None:
    friction = Friction(coulomb_nm=0.03, viscous_nm_s_rad=0.004, load_motor=0.2, load_external=0.2)
    bank = bank_of([replace(drive_of("marvin"), friction=friction)])
    bank.states[fields.ROTOR_VELOCITY] = 3.0
    speeds = []
    position = np.zeros(1)
    for _ in range(300):
        velocity = bank.states[fields.ROTOR_VELOCITY].copy()
        bank.step(position, velocity)
        position = bank.states[fields.ROTOR_POSITION].copy()
        speeds.append(float(bank.states[fields.ROTOR_VELOCITY, 0]))
    assert all(b <= a + 1e-12 for a, b in itertools.pairwise(speeds))
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)


def test_friction_levels_follow_the_published_ladder() -> None:
    v, tm, te = 0.2, 0.3, -0.1
    s = math.exp(-(2.0**1.5))
    full = Friction(0.02, 0.004, 0.01, 0.1, 1.5, 0.1, 0.2, 0.05, 0.06, 0.3, 0.4)
    m5 = 0.02 + 0.004 * v + abs(0.1 * tm - 0.2 * te) + s * (0.01 + abs(0.05 * tm - 0.06 * te))
    assert full.level_nm(v, tm, te) == pytest.approx(m5 + s * 0.4 * te**2)
    assert full.level_nm(v, -te, -tm) == pytest.approx(
        0.02
        + 0.004 * v
        + abs(0.1 * 0.1 + 0.2 * 0.3)
        + s * (0.01 + abs(0.05 * 0.1 + 0.06 * 0.3) + 0.3 * 0.1**2)
    )
    m1 = Friction(coulomb_nm=0.02, viscous_nm_s_rad=0.004)
    assert m1.level_nm(v, tm, te) == pytest.approx(0.0208)


def test_load_dependent_friction_keeps_the_data_sheets_stall_torque() -> None:
    robot = load_robot("marvin")
    document = dict(robot.document)
    sheet = dict(document["drive"]["XL-320"])
    for key in ("load_motor", "load_external"):
        sheet[key] = {"value": 0.1, "source": "assumed"}
    document["drive"] = {"XL-320": sheet}
    drive = read_physics(replace(robot, document=document)).joints[0].drive
    assert drive.stall_torque_nm(7.4) == pytest.approx(0.39)
    assert drive.no_load_velocity_rad_s(7.4) == pytest.approx(11.938)


def test_backlash_lets_the_shaft_move_freely_within_its_zone() -> None:
    drive = replace(drive_of("marvin"), backlash_rad=0.01)
    bank = bank_of([drive] * 4)
    bank.step(np.array([0.0, 0.0049, 0.0055, -0.0055]), np.zeros(4))
    assert bank.torque_nm[:2] == pytest.approx([0.0, 0.0])
    beyond = drive.gear_stiffness_nm_rad * 0.0005
    assert bank.torque_nm[2:] == pytest.approx([-beyond, beyond], rel=0.01)


def test_supply_sags_by_the_sum_of_all_currents() -> None:
    drive = drive_of("marvin")
    bank = bank_of([drive] * 6, resistance_ohm=0.3)
    for i in range(6):
        bank.command(i, command_column(FULL))
    clamp(bank, np.zeros(6), 0.2)
    total = float(bank.states[fields.CURRENT].sum())
    assert total > 4.0
    assert bank.states[fields.VOLTAGE, 0] == pytest.approx(7.4 - 0.3 * total, rel=1e-3)


def test_a_stalled_winding_warms_up_and_loses_torque() -> None:
    drive = replace(drive_of("marvin"), heat_time_constant_s=1.0)
    bank = bank_of([drive])
    bank.command(0, command_column(FULL))
    clamp(bank, np.zeros(1), 0.05)
    cold = float(bank.torque_nm[0])
    clamp(bank, np.zeros(1), 4.0)
    heat, current = (float(bank.states[row, 0]) for row in (fields.HEAT, fields.CURRENT))
    resistance = drive.resistance_ohm * (1.0 + drive.resistance_rise_per_k * heat)
    assert current == pytest.approx(7.4 / resistance, rel=1e-3)
    assert heat == pytest.approx(drive.heat_resistance_k_w * resistance * current**2, rel=0.05)
    assert bank.torque_nm[0] < cold - 0.02


def test_the_controller_sees_whole_counts() -> None:
    drive = drive_of("marvin")
    bank = bank_of([drive] * 2)
    law = DriveCommand(torque_enable=True, gain_cw_per_rad=1.0, gain_ccw_per_rad=1.0)
    for i in range(2):
        bank.command(i, command_column(law))
    step = drive.sensor_step_rad
    bank.tick(np.array([0.4 * step, 0.6 * step]), np.zeros(2))
    assert bank.states[fields.DUTY] == pytest.approx([0.0, -step])


def test_servos_of_a_batch_do_not_touch_each_other() -> None:
    slow = replace(drive_of("marvin"), rotor_inertia_kg_m2=5e-3)
    alone, batch = bank_of([slow]), bank_of([drive_of("marvin"), slow])
    alone.command(0, command_column(FULL))
    batch.command(1, command_column(FULL))
    clamp(alone, np.zeros(1), 0.05)
    clamp(batch, np.zeros(2), 0.05)
    assert (alone.states[:, 0] == batch.states[:, 1]).all()


def test_a_command_with_nan_is_refused() -> None:
    with pytest.raises(ValueError, match="NaN"):
        command_column(DriveCommand(goal_position_rad=math.nan))
