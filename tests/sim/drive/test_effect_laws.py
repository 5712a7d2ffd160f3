"""Every effect of drive, controller, supply and sensing against its own law, in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from one_joint_rigs import (
    GAIN_PER_RAD,
    GRAVITY_NM,
    INERTIA_KG_M2,
    VOLTAGE_V,
    goals,
    level,
    pendulum,
    periods_s,
    plain_drive,
    position,
    pushing,
    regulated,
    regulating,
    replay,
    rig,
    run,
)
from scipy.optimize import brentq

from busemu.plant import DriveCommand, OperatingMode
from busemu.servo.profile import by_velocity
from busemu.tables import load_robot
from sim.drive import lanes, rotor
from sim.drive.parameters import DriveParameters, Friction
from sim.effects import effect
from sim.robot import read_physics
from sim.rollout import Candidate, Load
from sim.stepped import TICK_S
from sim.tree import PhysicalRobot, Supply

ROTOR = plain_drive().rotor_inertia_kg_m2
INERTIA = INERTIA_KG_M2 + ROTOR
STALL_A = VOLTAGE_V / plain_drive().resistance_ohm
TORQUE_CONSTANT = plain_drive().torque_constant_nm_a
HEAVY = 1e4  #: kg m^2: a load that stands still though it is pushed


def base(drive: DriveParameters | None = None) -> PhysicalRobot:
    robot = rig()
    (joint,) = robot.joints
    return replace(
        robot,
        supply=Supply(VOLTAGE_V, 0.0),
        joints=(replace(joint, drive=plain_drive() if drive is None else drive),),
    )


def having(
    name: str, load: Load | None = None, drive: DriveParameters | None = None, **values: float
) -> Candidate:
    """A servo with an effect whose other parameters are off."""
    robot = effect(name).apply(base(drive), (), effect(name).off | values)
    return Candidate.of(robot, 0, pendulum() if load is None else load, rigid=False)


def duties(name: str, error_rad: float, seconds: float = 0.5, **values: float) -> np.ndarray:
    """Duty at a constant position error from the beginning."""
    told = replay(regulating(error_rad), duration_s=seconds)
    return regulated(having(name, **values), told, np.zeros(len(told.samples)))


# --- controller


@pytest.mark.parametrize("error", [-0.1, -0.02, 0.019, 0.021, 0.1])
def test_dead_zone(error: float) -> None:
    margin = 0.02
    wanted = GAIN_PER_RAD * math.copysign(max(0.0, abs(error) - margin), error)
    assert duties("dead_zone", error, margin_rad=margin) == pytest.approx(wanted)


@pytest.mark.parametrize("error", [-0.1, -0.001, 0.0, 0.001, 0.1])
def test_punch(error: float) -> None:
    least = 0.07
    wanted = float(np.sign(error)) * least + GAIN_PER_RAD * error
    assert duties("punch", error, duty=least) == pytest.approx(wanted)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_of_the_punch_is_left_out(share: float) -> None:
    told = replay(regulating(0.02, punch_duty=0.1), duration_s=0.1)
    found = regulated(having("punch_left_out", share=share), told, np.zeros(len(told.samples)))
    assert found == pytest.approx((1.0 - share) * 0.1 + GAIN_PER_RAD * 0.02)


def test_punch_acts_beyond_the_dead_zone_only() -> None:
    command = regulating(0.03, margin_cw_rad=0.05, margin_ccw_rad=0.05)
    told = replay(command, duration_s=0.1)
    assert (regulated(having("punch", duty=0.2), told, np.zeros(101)) == 0.0).all()


@pytest.mark.parametrize("margin", [0, 1])
@pytest.mark.parametrize(
    "name", ["pendulum", "xl320-pendulum", "mx64-pendulum", "xl330-pendulum", "sts3215-pendulum"]
)
def test_no_servo_pushes_where_its_counts_say_that_it_is_at_its_goal(
    name: str, margin: int
) -> None:
    """A robot file rounds its step, so that goals and counts are not the same to the last digit."""
    robot = load_robot(name)
    (table,) = robot.tables.values()
    goal = table["goal_position"]
    one = Candidate.of(read_physics(robot), 0, level(), rigid=False)
    counts = np.arange(min(int(goal.maximum), 4095) + 1)
    step_rad = goal.to_si(1) - goal.to_si(0)
    more = {"punch_duty": 0.1, "margin_cw_rad": margin * step_rad}
    for off, pushes in ((0, False), (margin, False), (margin + 1, True)):
        pushed = set()
        for count in counts[off::17].tolist():
            told = replay(regulating(goal.to_si(count - off), **more), duration_s=TICK_S)
            sensed = np.full(len(told.samples), goal.to_si(count))
            pushed.add(bool(regulated(one, told, sensed)[-1] != 0.0))
        assert pushed == {pushes}


@pytest.mark.parametrize("scale", [0.5, 1.2, 3.0])
def test_gain_error(scale: float) -> None:
    assert duties("gain_error", 0.05, scale=scale) == pytest.approx(scale * GAIN_PER_RAD * 0.05)


def test_gain_error_is_of_the_derivative_too() -> None:
    command = regulating(0.0, gain_per_rad=0.0, derivative_gain_s_per_rad=0.02)
    told = replay(command, duration_s=0.5)
    moving = 2.0 * told.samples
    duty = regulated(having("gain_error", scale=1.5), told, moving)
    assert duty[2:] == pytest.approx(-1.5 * 0.02 * 2.0)


def test_integral_action() -> None:
    gain, error = 3.0, 0.02
    duty = duties("integral_action", error, gain_per_rad_s=gain)
    t = np.arange(len(duty)) * TICK_S
    assert duty == pytest.approx(
        GAIN_PER_RAD * error + gain * error * t, abs=1.01 * gain * error * TICK_S
    )


def test_velocity_limit() -> None:
    limit, step = 0.8, 0.15
    duty = duties("velocity_limit", step, limit_rad_s=limit)
    t = np.arange(len(duty)) * TICK_S
    ramp = np.minimum(step, limit * t)
    assert duty == pytest.approx(GAIN_PER_RAD * ramp, abs=1.01 * GAIN_PER_RAD * limit * TICK_S)


def test_the_slower_of_two_velocity_limits_holds() -> None:
    told = replay(regulating(0.1, velocity_limit_rad_s=0.3), duration_s=0.2)
    still = np.zeros(201)
    own = regulated(having("gain_error"), told, still)
    assert (regulated(having("velocity_limit", limit_rad_s=0.5), told, still) == own).all()
    assert regulated(having("velocity_limit", limit_rad_s=0.2), told, still)[-1] < own[-1]


@pytest.mark.parametrize("step", [0.15, -0.4])
@pytest.mark.parametrize("speed", [0.4, 100.0])
def test_acceleration_limit(speed: float, step: float) -> None:
    """A trapezoid or a triangle of speed, as the manual has it, and nothing beyond the goal."""
    limit = 5.0
    told = replay(regulating(step, 1.0, velocity_limit_rad_s=speed), duration_s=1.5)
    still = np.zeros(len(told.samples))
    duty = regulated(having("acceleration_limit", limit_rad_s2=limit), told, still)
    plan = by_velocity(0.0, step, 0.0, speed, limit)
    way = np.array([plan.at(k * TICK_S)[0] for k in range(len(duty))])
    tick = plan.velocity * TICK_S
    assert duty == pytest.approx(way, abs=2.0 * tick)
    assert duty[-1] == pytest.approx(step, rel=1e-9)
    assert np.abs(duty).max() <= abs(step) * (1.0 + 1e-9)


def test_a_goal_that_is_changed_on_the_way_is_gone_to_from_the_speed_there_is() -> None:
    limit = 5.0
    told = replay(regulating(0.0, 1.0), goals([0.1, 0.3], [1.0, -0.2]), duration_s=2.0)
    one = having("acceleration_limit", limit_rad_s2=limit)
    way = regulated(one, told, np.zeros(len(told.samples)))
    changes = np.diff(way, 2) / TICK_S**2
    assert np.abs(changes).max() <= limit * (1.0 + 1e-6)
    assert way.max() == pytest.approx(0.5 * limit * 0.2**2 * 2.0, rel=0.02)  # up, and to a stop
    assert way[-1] == pytest.approx(-0.2)


def test_the_lesser_of_two_acceleration_limits_holds() -> None:
    told = replay(regulating(0.5, acceleration_limit_rad_s2=3.0), duration_s=0.2)
    still = np.zeros(201)
    own = regulated(having("gain_error"), told, still)
    assert own[-1] == pytest.approx(GAIN_PER_RAD * 0.5 * 3.0 * 0.2**2, rel=0.02)
    assert (regulated(having("acceleration_limit", limit_rad_s2=4.0), told, still) == own).all()
    assert regulated(having("acceleration_limit", limit_rad_s2=2.0), told, still)[-1] < own[-1]


def test_a_velocity_is_reached_with_no_more_than_the_acceleration_limit() -> None:
    limit, goal = 6.0, 1.5
    command = DriveCommand(
        torque_enable=True, operating_mode=OperatingMode.VELOCITY, goal_velocity_rad_s=goal
    )
    told = replay(command, duration_s=0.5)
    still = np.zeros(len(told.samples))
    jump = regulated(having("gain_error"), told, still)
    ramp = regulated(having("acceleration_limit", limit_rad_s2=limit), told, still)
    t = np.arange(1, len(ramp) + 1) * TICK_S
    assert ramp == pytest.approx(jump * np.minimum(1.0, limit * t / goal), abs=0.01 * jump[-1])
    assert ramp[-1] == jump[-1]


@pytest.mark.parametrize("error", [-1.0, 0.01, 1.0])
def test_torque_limit(error: float) -> None:
    wanted = min(0.3, max(-0.3, GAIN_PER_RAD * error))
    assert duties("torque_limit", error, duty=0.3) == pytest.approx(wanted)


def test_transport_delay() -> None:
    delay, at = 0.0235, 0.1
    told = replay(regulating(), goals([at], [0.1]), duration_s=0.3)
    duty = regulated(having("transport_delay", delay_s=delay), told, np.zeros(301))
    first = np.flatnonzero(duty)[0] * TICK_S
    assert at + delay <= first <= at + delay + 2.01 * TICK_S


def test_overload_shutdown() -> None:
    """Full push for a time, then the bridge opens for good, whatever the goal."""
    after = 0.25
    told = replay(regulating(1.0), goals([0.5], [0.0]), duration_s=0.8)
    one = having("overload_shutdown", level(HEAVY), duty=0.9, time_s=after)
    out = run(one, told)
    current = out[:, lanes.OUT_CURRENT]
    last = np.flatnonzero(current)[-1] * TICK_S
    assert last == pytest.approx(after, abs=2.01 * TICK_S)
    assert (out[np.arange(len(out)) * TICK_S > after + 3 * TICK_S, lanes.OUT_DUTY] == 0.0).all()


def test_an_overload_that_stops_in_time_shuts_nothing_down() -> None:
    """Pushes that are each shorter than the time do not add up."""
    t = np.arange(0.0, 1.0, 0.2)
    told = replay(regulating(), goals(t, np.where(np.arange(5) % 2, 0.0, 1.0)), duration_s=1.0)
    out = run(having("overload_shutdown", level(HEAVY), duty=0.9, time_s=0.25), told)
    assert out[-1, lanes.OUT_DUTY] == 1.0


# --- electrical and thermal


def stalled(one: Candidate, duty: float = 1.0, seconds: float = 0.2) -> np.ndarray:
    return run(replace(one, load=level(HEAVY)), replay(pushing(duty), duration_s=seconds))


@pytest.mark.parametrize("duty", [-1.0, -0.2, 0.2, 0.7])
def test_current_limit(duty: float) -> None:
    limit = 0.5
    current = stalled(having("current_limit", limit_a=limit), duty)[1:, lanes.OUT_CURRENT]
    wanted = math.copysign(min(limit, abs(duty) * STALL_A), duty)
    assert current == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("times", [0.1, 0.5, 1.0, -0.5])
def test_torque_droop(times: float) -> None:
    """Torque over current by its law, at a part of the stall current; as told at all of it."""
    droop, stall_a = 0.4, plain_drive().data_sheet.stall_current_a
    one = having("torque_droop", level(), droop=droop)
    pushed = run(one, replay(pushing(times * stall_a / STALL_A), duration_s=0.01))
    current, speed = pushed[1, lanes.OUT_CURRENT], pushed[1, lanes.OUT_VELOCITY]
    # at the first tick the joint begins to move: the current is the mean, and hardly less
    share = abs(current) / stall_a
    torque = TORQUE_CONSTANT * current * (1.0 + droop) / (1.0 + droop * share)
    assert speed * INERTIA / TICK_S == pytest.approx(torque, rel=1e-3)


def test_a_motor_whose_torque_droops_stalls_as_its_data_sheet_says() -> None:
    plain = base().joints[0].drive
    drooping = effect("torque_droop").apply(base(), (), {"droop": 0.4}).joints[0].drive
    sheet = plain.data_sheet
    volts = sheet.stall_current_a * plain.resistance_ohm
    assert drooping.stall_torque_nm(volts) == pytest.approx(plain.stall_torque_nm(volts))
    less, more = 0.5 * volts, 2.0 * volts
    assert drooping.stall_torque_nm(less) == pytest.approx(plain.stall_torque_nm(less) * 1.4 / 1.2)
    assert drooping.stall_torque_nm(more) == pytest.approx(plain.stall_torque_nm(more) * 1.4 / 1.8)


def test_droops_add_up() -> None:
    once = effect("torque_droop").apply(base(), (), {"droop": 0.5})
    twice = effect("torque_droop").apply(
        effect("torque_droop").apply(base(), (), {"droop": 0.2}), (), {"droop": 0.3}
    )
    one, other = (robot.joints[0].drive for robot in (once, twice))
    assert other.torque_constant_nm_a == pytest.approx(one.torque_constant_nm_a)
    assert other.torque_droop_per_a == pytest.approx(one.torque_droop_per_a)


@pytest.mark.parametrize("duty", [0.3, 1.0])
def test_voltage_sag(duty: float) -> None:
    ohm = 0.8
    out = stalled(having("voltage_sag", resistance_ohm=ohm), duty)[1:]
    wanted = VOLTAGE_V / (1.0 + ohm * duty**2 / plain_drive().resistance_ohm)
    assert out[:, lanes.OUT_VOLTAGE] == pytest.approx(wanted, rel=1e-4)
    drawn = duty * out[:, lanes.OUT_CURRENT]
    assert VOLTAGE_V - ohm * drawn == pytest.approx(out[:, lanes.OUT_VOLTAGE], rel=1e-4)


def test_supply_voltage() -> None:
    out = stalled(having("supply_voltage", scale=0.8))[1:]
    assert out[:, lanes.OUT_VOLTAGE] == pytest.approx(0.8 * VOLTAGE_V)
    assert out[:, lanes.OUT_CURRENT] == pytest.approx(0.8 * STALL_A, rel=1e-4)


@pytest.mark.parametrize("rise_per_k", [0.0, 0.0039])
def test_thermal_derating(rise_per_k: float) -> None:
    """A stalled winding: with no rise of resistance an exponential; with it, where they agree."""
    per_watt, time_s, seconds = 5.0, 0.4, 3.0
    drive = plain_drive(resistance_rise_per_k=rise_per_k, heat_resistance_k_w=0.0)
    one = having("thermal_derating", drive=drive, heat_resistance_k_w=per_watt, time_s=time_s)
    out = stalled(one, 0.5, seconds)
    t = np.arange(len(out)) * TICK_S
    heat, current = out[:, lanes.OUT_HEAT], out[:, lanes.OUT_CURRENT]
    if rise_per_k == 0.0:
        loss = plain_drive().resistance_ohm * (0.5 * STALL_A) ** 2
        wanted = per_watt * loss * (1.0 - np.exp(-t / time_s))
        assert heat == pytest.approx(wanted, abs=0.005 * per_watt * loss)
    else:
        rest, warm = heat[-1], plain_drive().resistance_ohm * (1.0 + rise_per_k * heat[-1])
        assert current[-1] == pytest.approx(0.5 * VOLTAGE_V / warm, rel=1e-3)
        assert rest == pytest.approx(per_watt * warm * current[-1] ** 2, rel=2e-3)
        assert current[-1] < 0.95 * current[1]


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_torque_constant(scale: float) -> None:
    """More torque at stall, less speed at no load, the same current."""
    seconds = 0.02
    pushed = run(
        having("torque_constant", level(), scale=scale), replay(pushing(0.1), duration_s=seconds)
    )
    begun = scale * TORQUE_CONSTANT * 0.1 * STALL_A / INERTIA
    assert pushed[1, lanes.OUT_VELOCITY] == pytest.approx(begun * TICK_S, rel=0.02)
    spun = run(
        having("torque_constant", level(), scale=scale), replay(pushing(0.1), duration_s=4.0)
    )
    free = 0.1 * VOLTAGE_V / (scale * plain_drive().back_emf_v_s_rad)
    assert spun[-1, lanes.OUT_VELOCITY] == pytest.approx(free, rel=1e-3)


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_back_emf(scale: float) -> None:
    """As much torque at stall, less speed at no load."""
    changed = having("back_emf", level(), scale=scale)
    pushed = run(changed, replay(pushing(0.1), duration_s=0.02))
    assert pushed[1, lanes.OUT_VELOCITY] == pytest.approx(
        TORQUE_CONSTANT * 0.1 * STALL_A / INERTIA * TICK_S, rel=0.02
    )
    spun = run(changed, replay(pushing(0.1), duration_s=4.0))
    free = 0.1 * VOLTAGE_V / (scale * plain_drive().back_emf_v_s_rad)
    assert spun[-1, lanes.OUT_VELOCITY] == pytest.approx(free, rel=1e-3)


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_stall_torque(scale: float) -> None:
    """More torque at stall, as much speed at no load."""
    changed = having("stall_torque", level(), scale=scale)
    pushed = run(changed, replay(pushing(0.1), duration_s=0.02))
    begun = scale * TORQUE_CONSTANT * 0.1 * STALL_A / INERTIA
    assert pushed[1, lanes.OUT_VELOCITY] == pytest.approx(begun * TICK_S, rel=0.02)
    spun = run(changed, replay(pushing(0.1), duration_s=4.0))
    free = 0.1 * VOLTAGE_V / plain_drive().back_emf_v_s_rad
    assert spun[-1, lanes.OUT_VELOCITY] == pytest.approx(free, rel=1e-3)


# --- friction


def deceleration(name: str, speed: float, **values: float) -> float:
    """Of a free joint that coasts, at its beginning [rad/s^2]."""
    out = run(having(name, level(), **values), replay(velocity_rad_s=speed, duration_s=0.01))
    return float(out[0, lanes.OUT_VELOCITY] - out[1, lanes.OUT_VELOCITY]) / TICK_S


def test_coulomb_friction() -> None:
    for speed in (0.5, 5.0):
        found = deceleration("coulomb_friction", speed, more_nm=0.03)
        assert found == pytest.approx(0.03 / INERTIA)


def test_friction_below_none_is_none() -> None:
    drive = plain_drive(friction=Friction(coulomb_nm=0.05, viscous_nm_s_rad=0.02))
    for name, parameter in (
        ("coulomb_friction", "more_nm"),
        ("viscous_friction", "more_nm_s_rad"),
    ):
        robot = effect(name).apply(base(drive), (), {parameter: -0.5})
        friction = robot.joints[0].drive.friction
        assert min(friction.coulomb_nm, friction.viscous_nm_s_rad) == 0.0
        assert max(friction.coulomb_nm, friction.viscous_nm_s_rad) > 0.0


def test_viscous_friction() -> None:
    more = 0.02
    out = run(
        having("viscous_friction", level(), more_nm_s_rad=more),
        replay(velocity_rad_s=4.0, duration_s=1.0),
    )
    t = np.arange(len(out)) * TICK_S
    wanted = 4.0 * np.exp(-more / INERTIA * t)
    assert out[:, lanes.OUT_VELOCITY] == pytest.approx(wanted, abs=0.002 * 4.0)


@pytest.mark.parametrize("speed", [0.05, 0.2, 1.0])
def test_stribeck_friction(speed: float) -> None:
    nm, at = 0.004, 0.3
    found = deceleration("stribeck_friction", speed, stribeck_nm=nm, velocity_rad_s=at)
    wanted = nm * math.exp(-speed / at) / INERTIA
    assert found == pytest.approx(wanted, rel=0.01)


def test_stribeck_friction_holds_what_breaks_away_above_it() -> None:
    nm = 0.03
    for pull, moves in ((0.95 * nm, False), (1.05 * nm, True)):
        load = pendulum(pull, centre_rad=0.5 * math.pi)
        out = run(having("stribeck_friction", load, stribeck_nm=nm), replay(duration_s=0.3))
        assert bool(position(out)[-1] != 0.0) is moves


def falling(name: str, **values: float) -> float:
    """How fast a weight at a right angle begins to fall [rad/s^2], torque off."""
    load = pendulum(GRAVITY_NM, centre_rad=0.5 * math.pi)
    out = run(having(name, load, **values), replay(duration_s=0.01))
    return float(out[1, lanes.OUT_VELOCITY]) / TICK_S


def driving(name: str, **values: float) -> float:
    """How fast a free joint begins to move under its motor [rad/s^2], over the ideal."""
    out = run(having(name, level(), **values), replay(pushing(0.2), duration_s=0.01))
    ideal = TORQUE_CONSTANT * 0.2 * STALL_A / INERTIA
    return float(out[1, lanes.OUT_VELOCITY]) / TICK_S / ideal


def test_load_friction() -> None:
    ratio = 0.25
    wanted = (1.0 - ratio) * GRAVITY_NM / INERTIA
    assert falling("load_friction", ratio=ratio) == pytest.approx(wanted, rel=1e-3)
    assert driving("load_friction", ratio=ratio) == pytest.approx(1.0 - ratio, rel=0.02)


def test_directional_load_friction() -> None:
    values = {"driving": 0.1, "backdriving": 0.6}
    wanted = (1.0 - 0.6) * GRAVITY_NM / INERTIA
    assert falling("directional_load_friction", **values) == pytest.approx(wanted, rel=1e-3)
    assert driving("directional_load_friction", **values) == pytest.approx(0.9, rel=0.02)


def test_a_gear_that_resists_being_driven_back_holds_any_load() -> None:
    assert falling("directional_load_friction", driving=0.0, backdriving=1.0) == 0.0


def test_cable_drag() -> None:
    stiffness, rest = 0.5, 0.4
    one = having("cable_drag", level(), stiffness_nm_rad=stiffness, rest_rad=rest)
    out = run(one, replay(position_rad=1.2, duration_s=4.0))
    assert np.mean(periods_s(position(out) - rest)) == pytest.approx(
        2.0 * math.pi * math.sqrt(INERTIA / stiffness), rel=1e-3
    )


# --- gear


@pytest.mark.parametrize("scale", [0.5, 4.0])
def test_rotor_inertia(scale: float) -> None:
    out = run(having("rotor_inertia", scale=scale), replay(position_rad=0.01, duration_s=5.0))
    wanted = 2.0 * math.pi * math.sqrt((INERTIA_KG_M2 + scale * ROTOR) / GRAVITY_NM)
    assert np.mean(periods_s(position(out))) == pytest.approx(wanted, rel=1e-3)


HELD = plain_drive(friction=Friction(coulomb_nm=5.0))  #: a rotor that nothing moves


def swaying(seconds: float = 4.0) -> tuple[Load, Any]:
    """Torque on a joint that goes slowly from one sense to the other."""
    pull = GRAVITY_NM * np.linspace(1.0, -1.0, 5)
    return Load(INERTIA_KG_M2, np.zeros(5), pull, GRAVITY_NM), replay(duration_s=seconds)


def test_joint_compliance() -> None:
    compliance = 0.05
    load, told = swaying()
    values = {"compliance_rad_nm": compliance, "damping_nm_s_rad": 0.02}
    out = run(having("joint_compliance", load, HELD, **values), told)
    t = np.arange(len(out)) * TICK_S
    twist = compliance * GRAVITY_NM * np.linspace(1.0, -1.0, len(t))
    slow = t > 1.5  # what the first pull set ringing is gone
    assert position(out)[slow] == pytest.approx(twist[slow], abs=0.02 * twist.max())


def test_joint_compliance_is_in_series_with_the_gears_own() -> None:
    drive = plain_drive(gear_stiffness_nm_rad=20.0)
    robot = effect("joint_compliance").apply(base(drive), (), {"compliance_rad_nm": 0.05})
    assert robot.joints[0].drive.gear_stiffness_nm_rad == pytest.approx(10.0)


def test_backlash() -> None:
    """Pushed one way and then the other, the shaft rests at both ends of the play."""
    width = 0.05
    load, told = swaying()
    drive = replace(HELD, gear_stiffness_nm_rad=200.0, gear_damping_nm_s_rad=0.2)
    angle = position(run(having("backlash", load, drive, width_rad=width), told))
    for k in (round(1.0 / TICK_S), -1):
        pull = GRAVITY_NM * np.linspace(1.0, -1.0, len(angle))[k]
        wanted = math.copysign(0.5 * width, pull) + pull / 200.0
        assert angle[k] == pytest.approx(wanted, abs=0.02 * width)


@pytest.mark.parametrize(
    ("twist_rad", "rate_rad_s", "expected_nm"),
    [
        (0.012, 0.0, 0.2),
        (0.012, 0.3, 0.5),  # damped as it is pressed,
        (0.012, -0.1, 0.1),  # and as it lets go,
        (0.012, -0.3, 0.0),  # but not held back
        (-0.012, 0.3, 0.0),
        (-0.012, -0.3, -0.5),
        (0.009, 5.0, 0.0),  # within the play
        (-0.009, -5.0, 0.0),
    ],
)
def test_a_flank_pushes_and_is_never_pulled_at(
    twist_rad: float, rate_rad_s: float, expected_nm: float
) -> None:
    none = dict.fromkeys(rotor.Train._fields, 0.0) | {"slow": False}
    teeth = rotor.Train(**none)._replace(stiffness=100.0, damping=1.0, half_backlash=0.01)
    torque_nm = rotor.gear_torque(teeth, twist_rad, rate_rad_s)
    assert torque_nm == pytest.approx(expected_nm, abs=1e-12)


def test_the_teeth_of_a_rigid_gear_touch() -> None:
    """Play needs teeth; a gear that is soft already keeps its stiffness."""
    stiff = effect("backlash").apply(base(), (), {"width_rad": 0.01}).joints[0].drive
    assert math.isfinite(stiff.gear_stiffness_nm_rad)
    soft = plain_drive(gear_stiffness_nm_rad=20.0, backlash_rad=0.003)
    played = effect("backlash").apply(base(soft), (), {"width_rad": 0.01}).joints[0].drive
    assert played.gear_stiffness_nm_rad == 20.0
    assert played.backlash_rad == pytest.approx(0.013)


# --- sensing


def test_zero_offset() -> None:
    """A joint held at what reads as its goal stands beside it, where gravity is another."""
    offset, goal = 0.2, 0.5
    drive = plain_drive(friction=Friction(viscous_nm_s_rad=0.3))
    told = replay(regulating(goal), position_rad=goal, duration_s=5.0)
    out = run(having("zero_offset", drive=drive, offset_rad=offset), told)
    seen = position(out)[-1]
    pull = GRAVITY_NM * math.sin(seen - offset)
    assert GAIN_PER_RAD * (goal - seen) * TORQUE_CONSTANT * STALL_A == pytest.approx(pull, rel=1e-4)


@pytest.mark.parametrize("periods", [1.0, 4.0])
def test_encoder_nonlinearity(periods: float) -> None:
    size, phase = 0.03, 0.6
    values = {"amplitude_rad": size, "periods": periods, "phase_rad": phase}
    told = replay(velocity_rad_s=1.0, duration_s=2.0)
    seen = position(run(having("encoder_nonlinearity", level(), **values), told))
    begun = brentq(lambda shaft: shaft + size * np.sin(periods * shaft + phase), -0.1, 0.1)
    true = position(run(having("encoder_nonlinearity", level()), replace(told, position_rad=begun)))
    assert seen == pytest.approx(true + size * np.sin(periods * true + phase), abs=1e-6)


def test_a_controller_goes_by_what_its_sensor_reads() -> None:
    size = 0.05
    drive = plain_drive(friction=Friction(viscous_nm_s_rad=0.5))
    one = having("encoder_nonlinearity", level(), drive, amplitude_rad=size)
    out = run(one, replay(regulating(0.9), duration_s=5.0))
    assert position(out)[-1] == pytest.approx(0.9, abs=1e-4)


@pytest.mark.parametrize("name", ["read_skew", "load_refresh"])
def test_how_a_bus_reads_is_in_the_candidate(name: str) -> None:
    values = effect(name).typical
    one = having(name, **values)
    (value,) = values.values()
    assert {"read_skew": one.skew_s, "load_refresh": one.load_refresh_s}[name] == value
