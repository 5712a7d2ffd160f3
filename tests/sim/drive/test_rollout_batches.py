"""Batches of rollouts: what a job gives depends on the job alone; commands, samples, supplies."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from one_joint_rigs import (
    GAIN_PER_RAD,
    VOLTAGE_V,
    candidate,
    goals,
    level,
    pendulum,
    plain_drive,
    position,
    pushing,
    regulated,
    regulating,
    replay,
    run,
    swinging,
)

from busemu.plant import DriveCommand, OperatingMode
from sim.drive import fields, lanes, lockstep
from sim.drive.bank import DriveBank, command_column
from sim.drive.parameters import Friction
from sim.rollout import GEAR_SUBSTEPS, Batch, Candidate, Load, Replay
from sim.stepped import TICK_S

FRICTION = Friction(
    coulomb_nm=0.05,
    viscous_nm_s_rad=0.01,
    stribeck_nm=0.02,
    load_motor=0.1,
    load_external=0.2,
)
DRIVE = plain_drive(
    friction=FRICTION, sensor_step_rad=0.005, resistance_rise_per_k=0.0039, heat_resistance_k_w=6.0
)
SOFT = replace(DRIVE, gear_stiffness_nm_rad=50.0, gear_damping_nm_s_rad=0.02, backlash_rad=0.01)


def replays() -> list[Replay]:
    uneven = np.sort(np.random.default_rng(1).uniform(0.0, 1.5, 200))
    return [
        swinging(1.0),
        swinging(1.5, samples=uneven, position_rad=0.4),
        replay(pushing(0.7), duration_s=0.4),
    ]


def candidates(drive: Any, count: int) -> list[Candidate]:
    """Servos that all differ a little."""
    return [
        candidate(
            replace(drive, delay_s=0.002 * k, punch_more=0.01 * k),
            pendulum(0.2 + 0.05 * k),
            source_ohm=0.1 * k,
            skew_s=0.001 * k,
            load_refresh_s=0.02 * k,
        )
        for k in range(count)
    ]


@pytest.mark.parametrize("drive", [DRIVE, SOFT])
def test_a_batch_gives_what_its_jobs_give_alone(drive: Any) -> None:
    told = replays()
    some = candidates(drive, 4)
    jobs = list(itertools.product(range(4), range(3)))
    together = Batch(told, 1).run([some[c] for c, _ in jobs], [r for _, r in jobs])
    for (c, r), out in zip(jobs, together, strict=True):
        assert (out == run(some[c], told[r])).all()
        assert not np.isnan(out).any()


def test_a_soft_gear_in_a_batch_changes_nothing_for_rigid_ones() -> None:
    (told,) = replays()[:1]
    stiff, soft = candidates(DRIVE, 1)[0], candidates(SOFT, 1)[0]
    together = Batch([told], 1).run([stiff, soft, soft, stiff], [0] * 4)
    for one, out in zip([stiff, soft, soft, stiff], together, strict=True):
        assert (out == run(one, told)).all()


PLAIN = replace(DRIVE, friction=replace(FRICTION, stribeck_nm=0.0))
GEAR = replace(PLAIN, gear_stiffness_nm_rad=50.0, gear_damping_nm_s_rad=0.02)
KINDS = {
    "rigid": PLAIN,
    "gear": GEAR,
    "play": replace(GEAR, backlash_rad=0.01),
    "droop, capped": replace(PLAIN, torque_droop_per_a=0.5, current_cap_a=0.6),
    "gear, droop, capped": replace(GEAR, torque_droop_per_a=0.5, current_cap_a=0.6),
    "cable, wave": replace(
        GEAR,
        cable_stiffness_nm_rad=0.3,
        cable_rest_rad=0.7,
        zero_offset_rad=0.1,
        wave_rad=0.05,
        wave_periods=3.0,
    ),
    "heat": replace(PLAIN, winding_heat_resistance_k_w=20.0, winding_heat_time_s=0.3),
    "given up": replace(PLAIN, overload_duty=0.3, overload_time_s=0.05),
    "every one of them": None,
}


def busy() -> list[Replay]:
    """Of several lengths, with all that can happen at a port."""
    told = [
        (0.10, lanes.SUPPLY_EVENT + fields.SUPPLY_VOLTAGE, 9.0),
        (0.15, fields.ENABLED, 0.0),
        (0.20, fields.ENABLED, 1.0),
        (0.30, fields.MODE, fields.MODE_VELOCITY),
        (0.30, fields.GOAL_VELOCITY, 2.0),
        (0.40, fields.MODE, fields.MODE_PWM),
        (0.40, fields.GOAL_DUTY, -0.4),
    ]
    firmware = regulating(0.4, integral_gain_per_rad_s=3.0, derivative_gain_s_per_rad=0.01)
    return [*replays(), replay(firmware, told, duration_s=0.5), replay(regulating(), samples=[0.0])]


def many(drives: list[Any], count: int) -> list[Candidate]:
    """Servos of some kinds in turn, that all differ a little; under every third, gravity turns."""
    moving = Load(3e-3, np.array([0.3, 0.2, 0.4]), np.array([0.0, 0.2, -0.1]))
    return [
        candidate(
            replace(drives[k % len(drives)], delay_s=0.0007 * (k % 5), punch_more=0.001 * k),
            moving if k % 3 == 0 else pendulum(0.2 + 0.005 * k),
            source_ohm=0.1 * (k % 4),
            skew_s=0.001 * (k % 7 - 3),
            load_refresh_s=0.02 * (k % 3),
        )
        for k in range(count)
    ]


@pytest.mark.parametrize("count", [lockstep.LANES + 5, lockstep.FEW])
@pytest.mark.parametrize("name", KINDS)
def test_lanes_give_what_their_jobs_give_alone(name: str, count: int) -> None:
    """Of one kind and of all, in groups that are full, not full, and of few."""
    told, kind = busy(), KINDS[name]
    drives = [DRIVE, SOFT, *(k for k in KINDS.values() if k)] if kind is None else [kind]
    some = many(drives, count * len(drives))
    which = [(3 * k + k // 5) % len(told) for k in range(len(some))]
    together = Batch(told).run(some, which)
    alone = [run(one, told[r]) for one, r in zip(some, which, strict=True)]
    for one, out in zip(alone, together, strict=True):
        assert (out == one).all()
        assert not np.isnan(out).any()
    moved = [one.tobytes() for one in alone if len(one) > 1]
    assert len(set(moved)) == len(moved)


@pytest.mark.parametrize("drive", [DRIVE, SOFT])
def test_threads_change_nothing(drive: Any) -> None:
    told, some = replays(), candidates(drive, 5)
    which = [0, 1, 2, 1, 0]
    one, two = (Batch(told, threads) for threads in (1, 2))
    for a, b in zip(one.run(some, which), two.run(some, which), strict=True):
        assert (a == b).all()
    sensed = [np.sin(3.0 * told[r].samples) for r in which]
    for a, b in zip(
        one.regulate(some, which, sensed), two.regulate(some, which, sensed), strict=True
    ):
        assert (a == b).all()


def test_a_batch_remembers_nothing_of_earlier_runs() -> None:
    """Heat, integrals, commands and supplies all begin anew."""
    told = [replay(regulating(0.5, integral_gain_per_rad_s=3.0), goals([0.2], [-0.5]))]
    told[0] = replace(told[0], events=np.vstack([told[0].events, [0.3, lanes.SUPPLY_EVENT, 9.0]]))
    batch, one = Batch(told, 1), candidate(DRIVE)
    first = batch.run([one], [0])[0]
    assert (batch.run([one], [0])[0] == first).all()


# --- the same drive in a bank, with an engine of one joint


def banked(drive: Any, told: Replay, load: Any) -> np.ndarray:
    """Angles at every tick: drives in a bank, the load moved here."""
    steps = GEAR_SUBSTEPS
    dt = TICK_S / steps
    shaft, pace = np.array([told.position_rad]), np.zeros(1)
    bank = DriveBank(
        [drive],
        shaft,
        supply_voltage_v=VOLTAGE_V,
        supply_resistance_ohm=0.0,
        step_s=dt,
        substeps=1,
        tick_s=TICK_S,
    )
    bank.command(0, told.start)
    events = told.events.tolist()
    angles = []
    for tick in range(len(told.samples)):
        while events and events[0][0] <= tick * TICK_S:
            _, field, value = events.pop(0)
            bank.commands[int(field), 0] = value
        angles.append(float(shaft[0]))
        bank.tick(shaft, pace)
        for _ in range(steps):
            pull = load.cosine_nm[0] * np.cos(shaft) - load.sine_nm[0] * np.sin(shaft)
            bank.step(shaft, pace)
            pace = pace + dt / load.inertia_kg_m2 * (bank.torque_nm + pull)
            shaft = shaft + dt * pace
    return np.array(angles)


@pytest.mark.parametrize("backlash_rad", [0.0, 0.01])
@pytest.mark.parametrize("cable_nm_rad", [0.0, 0.3])
@pytest.mark.parametrize("droop_per_a", [0.0, 2.0])
def test_a_bank_with_an_engine_of_one_joint_moves_as_a_rollout(
    backlash_rad: float, cable_nm_rad: float, droop_per_a: float
) -> None:
    drive = replace(
        SOFT,
        friction=replace(SOFT.friction, load_external=0.0),
        backlash_rad=backlash_rad,
        cable_stiffness_nm_rad=cable_nm_rad,
        cable_rest_rad=0.7,
        torque_droop_per_a=droop_per_a,
    )
    told = swinging(1.0)
    rolled = position(run(candidate(drive), told))
    assert np.ptp(rolled) > 0.3
    assert np.abs(banked(drive, told, pendulum()) - rolled).max() < 1e-5 * np.ptp(rolled)


def test_what_an_engine_does_not_tell_of_a_torque_from_outside_is_little() -> None:
    """There it is the gear's torque, and the load's inertia is in it."""
    told = swinging(1.0)
    assert SOFT.friction.load_external > 0.0
    rolled = position(run(candidate(SOFT), told))
    assert np.abs(banked(SOFT, told, pendulum()) - rolled).max() < 5e-3 * np.ptp(rolled)


# --- the controller alone


CONTROLLERS = {
    "plain": DRIVE,
    "free of counts": replace(DRIVE, sensor_step_rad=0.0),
    "late, capped, integral": replace(
        DRIVE,
        delay_s=0.013,
        velocity_cap_rad_s=2.0,
        duty_cap=0.4,
        integral_more_per_rad_s=4.0,
        punch_more=0.05,
        margin_more_rad=0.01,
        gain_scale=1.3,
    ),
    "given up": replace(DRIVE, overload_duty=0.3, overload_time_s=0.05),
}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_along_its_own_angles_gives_its_own_duty(name: str) -> None:
    # a hair after every tick, so that each sample shows the duty of its own tick
    told = swinging(1.5, samples=np.arange(1500) * TICK_S + 1e-9)
    one = candidate(CONTROLLERS[name])
    out = run(one, told)
    duty = regulated(one, told, position(out))
    # a count may fall the other way where an angle stands within rounding of half a count
    assert np.mean(np.abs(duty - out[:, lanes.OUT_DUTY]) < 1e-6) > 0.99
    assert np.ptp(duty) > 0.1


def test_a_controller_along_angles_knows_neither_motor_nor_load_nor_sensor() -> None:
    told = swinging(1.0)
    angles = 0.3 * np.sin(4.0 * told.samples)
    plain = regulated(candidate(DRIVE), told, angles)
    other = replace(
        SOFT,
        torque_constant_nm_a=1.0,
        resistance_ohm=3.0,
        zero_offset_rad=0.1,
        wave_rad=0.05,
        current_cap_a=0.1,
        torque_droop_per_a=0.3,
    )
    elsewhere = candidate(other, pendulum(0.9), source_ohm=1.0, load_refresh_s=0.13)
    assert (regulated(elsewhere, told, angles) == plain).all()


# --- commands, samples, supplies


def test_a_delay_is_goals_that_come_later() -> None:
    delay = 0.0173
    told = swinging(1.0)
    later = replace(told, events=told.events + np.array([delay, 0.0, 0.0]))
    slow = run(candidate(replace(DRIVE, delay_s=delay)), told)
    assert (slow == run(candidate(DRIVE), later)).all()
    assert (slow != run(candidate(DRIVE), told)).any()


@pytest.mark.parametrize("on", [True, False])
def test_goals_alone_are_late_and_a_drive_that_is_switched_on_knows_its_goal(on: bool) -> None:
    delay, at = 0.05, 0.1
    start = replace(regulating(0.0 if on else 0.5), torque_enable=not on)
    events = np.array([[at, fields.ENABLED, float(on)], [at, fields.GOAL_POSITION, 0.3]])
    told = replay(start, events, duration_s=0.3)
    plain, late = (run(candidate(replace(DRIVE, delay_s=x)), told) for x in (0.0, delay))
    assert (plain == late).all()
    later = replace(told, events=told.events + np.array([0.02, 0.0, 0.0]))
    assert (run(candidate(DRIVE), later) != plain).any()
    duties = regulated(candidate(replace(DRIVE, delay_s=delay)), told, np.zeros(301))
    assert (duties == regulated(candidate(DRIVE), told, np.zeros(301))).all()


@pytest.mark.parametrize("skew", [0.0057, -0.0057])
def test_a_skew_is_an_angle_of_another_instant_and_a_duty_of_this_one(skew: float) -> None:
    told = swinging(1.0, samples=np.arange(0.1, 0.9, 0.0123))
    late = replace(told, samples=told.samples + skew)
    skewed, now, then = (
        run(candidate(DRIVE, skew_s=s), t) for s, t in ((skew, told), (0.0, told), (0.0, late))
    )
    sensor = [lanes.OUT_POSITION, lanes.OUT_VELOCITY]
    assert (skewed[:, sensor] == then[:, sensor]).all()
    rest = [c for c in range(lanes.CHANNELS) if c not in sensor]
    assert (skewed[:, rest] == now[:, rest]).all()


@pytest.mark.parametrize("skew", [0.0057, -0.0057])
def test_a_controller_is_asked_along_angles_at_the_instants_they_are_of(skew: float) -> None:
    told = swinging(1.0, samples=np.arange(0.1, 0.9, 0.002))
    out = run(candidate(DRIVE, skew_s=skew), told)
    duty = regulated(candidate(DRIVE, skew_s=skew), told, position(out))
    misread = regulated(candidate(DRIVE), told, position(out))
    right, wrong = (np.abs(d - out[:, lanes.OUT_DUTY])[20:-20].mean() for d in (duty, misread))
    assert right < 0.1 * wrong


def test_a_sample_between_ticks_lies_between_them() -> None:
    ticks = swinging(0.5)
    between = replace(ticks, samples=ticks.samples[:-1] + 0.3 * TICK_S)
    at = position(run(candidate(), ticks))
    seen = position(run(candidate(), between))
    assert seen == pytest.approx(0.7 * at[:-1] + 0.3 * at[1:], abs=1e-12)


def test_a_load_register_is_held_for_its_period() -> None:
    period = 0.13
    told = swinging(1.0)
    fresh = run(candidate(), told)[:, lanes.OUT_DUTY]
    held = run(candidate(load_refresh_s=period), told)[:, lanes.OUT_DUTY]
    changed = np.flatnonzero(np.diff(held)) + 1
    for k, sample in enumerate(changed[1:], start=2):
        # a sample at a tick still shows what held until then
        assert sample * TICK_S == pytest.approx(k * period, abs=1.01 * TICK_S)
        assert held[sample] == fresh[sample]
    assert len(changed) == int(1.0 / period)


def test_the_phase_of_a_load_register_moves_its_instants() -> None:
    told = replay(regulating(), goals([0.0], [0.15]), duration_s=1.0)
    sunk = candidate(plain_drive(friction=Friction(viscous_nm_s_rad=2.0)))
    for phase in (0.0, 0.05):
        one = replace(sunk, load_refresh_s=0.13, load_phase_s=phase)
        held = run(one, told)[:, lanes.OUT_DUTY]
        instants = (np.flatnonzero(np.diff(held)) + 1) * TICK_S
        instants = instants[instants > phase + 2 * TICK_S]
        wanted = phase + 0.13 * np.arange(1, len(instants) + 1)
        # one tick for the sample at its end, one for sums of the period that round
        assert instants == pytest.approx(wanted, abs=2.01 * TICK_S)
        assert len(instants) == int((1.0 - phase) / 0.13)


def test_supply_events_set_the_supply_from_their_instant_on() -> None:
    events = [
        (0.25, lanes.SUPPLY_EVENT + fields.SUPPLY_VOLTAGE, 9.0),
        (0.50, lanes.SUPPLY_EVENT + fields.SUPPLY_RESISTANCE, 0.5),
    ]
    told = replay(pushing(0.5), events=events, duration_s=0.8)
    volts = run(candidate(load=level(10.0)), told)[:, lanes.OUT_VOLTAGE]
    t = np.arange(len(volts)) * TICK_S
    assert (volts[t <= 0.25] == VOLTAGE_V).all()
    assert (volts[(t > 0.2511) & (t <= 0.5)] == 9.0).all()
    assert (volts[t > 0.5011] < 9.0).all()


def test_supply_events_are_late_with_the_commands_and_no_concern_of_a_controller() -> None:
    told = swinging(0.5)
    dip = [0.2, lanes.SUPPLY_EVENT, 3.0]
    dipped = replace(told, events=np.vstack([told.events[told.events[:, 0] <= 0.2], dip]))
    plain = replace(told, events=told.events[told.events[:, 0] <= 0.2])
    angles = 0.1 * told.samples
    one = candidate(DRIVE)
    assert (regulated(one, dipped, angles) == regulated(one, plain, angles)).all()


def test_of_commands_at_one_instant_the_last_one_holds() -> None:
    both = replay(pushing(0.0), [(0.1, fields.GOAL_DUTY, 0.9), (0.1, fields.GOAL_DUTY, 0.2)])
    alone = replay(pushing(0.0), [(0.1, fields.GOAL_DUTY, 0.2)])
    assert (run(candidate(), both) == run(candidate(), alone)).all()


def test_commands_of_different_fields_at_one_instant_all_hold() -> None:
    events = [
        (0.1, fields.ENABLED, 1.0),
        (0.1, fields.GOAL_POSITION, 0.5),
        (0.1, fields.GAIN_CCW, 2.0),
    ]
    off = DriveCommand(operating_mode=OperatingMode.POSITION)
    out = run(candidate(load=level(10.0)), replay(off, events, duration_s=0.3))
    assert (out[:101, lanes.OUT_DUTY] == 0.0).all()
    assert out[102, lanes.OUT_DUTY] == pytest.approx(1.0, rel=1e-3)


def test_torque_off_lets_the_joint_fall_and_on_catches_it() -> None:
    events = [(0.2, fields.ENABLED, 0.0), (0.4, fields.ENABLED, 1.0)]
    out = run(candidate(load=pendulum(0.2, 1.0)), replay(regulating(), events, duration_s=2.0))
    current = out[:, lanes.OUT_CURRENT]
    assert (current[202:400] == 0.0).all()
    assert (current[402:500] != 0.0).all()
    assert position(out)[399] > position(out)[200] + 0.05


def test_the_start_is_what_the_sensor_read() -> None:
    """A sensor mounted turned: the shaft stands elsewhere, so that it reads the same."""
    told = replay(position_rad=0.3, duration_s=0.1)
    for offset in (-0.1, 0.0, 0.2):
        out = run(candidate(plain_drive(zero_offset_rad=offset)), told)
        assert position(out)[0] == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize("periods", [1.0, 3.0])
def test_the_start_is_what_a_sensor_that_is_not_linear_read(periods: float) -> None:
    drive = plain_drive(
        wave_rad=0.2, wave_periods=periods, wave_phase_rad=0.4, zero_offset_rad=0.05
    )
    out = run(candidate(drive), replay(position_rad=0.3, duration_s=0.1))
    assert position(out)[0] == pytest.approx(0.3, abs=1e-6)


def test_a_start_offset_moves_the_first_angle() -> None:
    out = run(candidate(start_offset_rad=0.02), replay(position_rad=0.3, duration_s=0.1))
    assert position(out)[0] == pytest.approx(0.32, abs=1e-12)


def test_a_gain_acts_on_the_first_tick() -> None:
    out = run(candidate(), replay(regulating(0.1), duration_s=0.01))
    assert out[0, lanes.OUT_DUTY] == pytest.approx(0.1 * GAIN_PER_RAD)
    assert command_column(regulating(0.1))[fields.GAIN_CW] == GAIN_PER_RAD
