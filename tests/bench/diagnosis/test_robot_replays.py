import math
from dataclasses import replace

import numpy as np
import pytest
from walking_robots import believed, marvin, recorded_walk, walked

from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import Features
from bench.diagnosis.robot.nuisances import (
    LATE,
    READ,
    later,
    nuisances,
    replayable,
    trials,
    with_nuisances,
)
from bench.diagnosis.robot.replay import LATE_S, Jitter, _acts_s, _events, course, loaded, play
from bench.recording import Recording, RecordingError
from sim.drive import fields
from sim.stepped import TICK_S

ENGINES_RAD = 0.5e-3  #: that PyBullet and replays differ by in a walk; measured: 0.3 mrad


@pytest.fixture(scope="module")
def plain():
    return play(believed(), walked())


def on_points(robot):
    """The robot as PyBullet has it, whose feet turn freely."""
    feet = [replace(leg.foot, turning_m=0.0) for leg in robot.legs]
    legs = [replace(leg, foot=foot) for leg, foot in zip(robot.legs, feet, strict=True)]
    return replace(robot, legs=tuple(legs))


def test_a_replay_of_the_same_robot_leaves_little_more_than_rounding():
    told = walked()
    plain = play(on_points(believed()), told)
    seen = list(enumerate(told.sample_s))
    apart = np.concatenate([told.position_rad[j] - plain.at(j, t) for j, t in seen])
    # what is not told is when within its turn a servo looked: as far as the nuisance allows
    (instant,) = (n.deviation for n in nuisances(believed(), 0.0) if n.name == "sampling")
    moved = np.concatenate([plain.at(j, t + instant) - plain.at(j, t) for j, t in seen])
    rounding = told.quantum_rad / math.sqrt(12.0)
    # PyBullet walked, and the compiled bodies replay: feet slip a little otherwise
    assert np.std(apart) < math.hypot(rounding, np.std(moved), ENGINES_RAD)


def test_a_replay_is_the_same_again_and_another_start_changes_it_little(plain):
    told = walked()
    assert (play(believed(), told).angle_rad == plain.angle_rad).all()
    features = Features.of(told, marvin())
    other = play(believed(), told, Jitter(1))
    assert (other.angle_rad != plain.angle_rad).any()
    moved = features.of_track(other)[0] - features.of_track(plain)[0]
    assert np.sqrt(np.mean(moved**2)) < 0.1 * told.quantum_rad


def test_feet_press_where_legs_are_told_to_stand_and_not_in_the_air(plain):
    features = Features.of(walked(), marvin())
    pressed = features.pressed(plain, believed())
    assert ((pressed >= 0.0) & (pressed <= 1.0)).all()
    told = features.stance
    assert pressed[told].mean() > 0.8
    assert pressed[~told].mean() < 0.2
    legs = [joint.leg for joint in believed().joints]
    of_leg = [pressed[features.joint_row == j] for j in range(len(legs))]
    by_leg = {
        leg: np.array([r for r, own in zip(of_leg, legs, strict=True) if own == leg])
        for leg in legs
    }
    # joints of a leg are read at instants of their own, but stand together
    assert all(np.ptp(rows, axis=0).mean() < 0.1 for rows in by_leg.values())
    assert np.ptp([rows.mean(axis=0) for rows in by_leg.values()], axis=0).max() > 0.5


def test_a_sensor_turned_on_its_shaft_is_read_turned(plain):
    offset = 0.05
    turned = placed_zero(believed(), "leg1.femur", offset)
    track = play(turned, walked())
    joint = [j.name for j in believed().joints].index("leg1.femur")
    # the controller brings what the sensor reads to the goal: what is read hardly moves
    features = Features.of(walked(), marvin())
    moved = features.of_track(track)[0] - features.of_track(plain)[0]
    assert abs(moved[features.joint_row == joint].mean()) < 0.5 * offset


def placed_zero(robot, joint, offset):
    from sim.effects import effect  # noqa: PLC0415

    return effect("zero_offset").apply(robot, (joint,), {"offset_rad": offset})


def test_a_recording_without_some_joint_is_refused():
    whole = recorded_walk()
    ids = whole.table.column("servo_id").to_pylist()
    some = whole.table.filter([i != 7 for i in ids])
    cut = Recording.checked(some, whole.metadata)
    with pytest.raises(RecordingError, match=marvin().by_id[7].joint):
        course(cut, marvin())


def test_a_weight_in_the_condition_is_on_the_trunk():
    heavier = loaded(marvin(), {"payload_kg": 0.092})
    assert heavier.mass_kg == pytest.approx(believed().mass_kg + 0.092)
    assert loaded(marvin(), {}) == believed()


def test_every_placed_effect_is_off_at_zero_and_something_at_its_first_try():
    robot = believed()
    for name, placed in placed_effects(robot).items():
        assert placed.name == name
        assert placed.apply(robot, placed.knob.value(0.0)) == robot, name
        assert placed.apply(robot, placed.knob.value(placed.first_z)) != robot, name


def test_every_nuisance_has_its_trial():
    robot = believed()
    known = {trial.name for trial in trials(robot)}
    for nuisance in nuisances(robot, 0.005):
        assert not nuisance.trial or nuisance.trial in known, nuisance.name
        assert nuisance.deviation > 0.0
    for trial in trials(robot):
        assert trial.change(robot, trial.size) != robot


def test_a_replay_from_the_middle_is_soon_where_the_whole_one_is(plain):
    features = Features.of(walked(), marvin())
    short = play(believed(), walked(), span=features.span)
    assert short.from_s == features.span[0] > 0.0
    apart = features.of_track(short)[0] - features.of_track(plain)[0]
    assert np.sqrt(np.mean(apart**2)) < 0.5 * walked().quantum_rad


def test_nuisances_of_a_replay_are_those_it_can_have():
    every = nuisances(believed(), 0.005)
    ones = np.ones(len(every))
    able = {n.name.split()[0] for n, x in zip(every, replayable(every, ones), strict=True) if x}
    assert able == {n.name.split()[0] for n in every} - READ
    assert with_nuisances(believed(), every, np.zeros(len(every)).tolist()) == believed()


def test_a_joints_own_nuisance_is_on_that_joint_alone():
    every = nuisances(believed(), 0.005)
    z = [float(n.name == "torque leg2.femur") for n in every]
    changed = with_nuisances(believed(), every, z)
    own = [j.name for j, k in zip(changed.joints, believed().joints, strict=True) if j != k]
    assert own == ["leg2.femur"]


@pytest.mark.parametrize("late_s", [0.01, -0.001, 0.0004])
def test_a_goal_that_comes_late_moves_a_robot_later_and_one_that_comes_soon_sooner(plain, late_s):
    track = play(later(believed(), late_s), walked())
    features = Features.of(walked(), marvin())
    moved = features.of_track(track)[0] - features.of_track(plain)[0]
    speed, _ = features.speeds(plain)
    assert -(speed @ moved) / (speed @ speed) == pytest.approx(late_s, rel=0.3)


@pytest.mark.parametrize("late_s", [0.0, 0.0002, 0.0007, 0.0031])
def test_laws_have_a_goal_half_a_tick_late_on_a_mean_whenever_it_acts(late_s):
    robot, told = later(believed(), late_s), walked()
    events = _events(robot, told, 0.0)
    for j, goal in ((0, fields.GOAL_POSITION), (7, fields.GOAL_POSITION)):
        own = told.events[(told.events[:, 1] == j) & (told.events[:, 2] == goal)]
        seen = events[(events[:, 1] == j) & (events[:, 2] == goal)]
        ticks = np.arange(own[-1, 0] / TICK_S + 10)
        held = np.searchsorted(seen[:, 0], ticks, side="right") - 1
        wanted = np.where(held < 0, told.start[goal, j], seen[np.maximum(held, 0), 3])
        # what a law has had of its goal in all, and what it has of one that acts at its time
        acts = (_acts_s(own, [late_s] * len(robot.joints)) + LATE_S) / TICK_S + 0.5
        steps = np.diff(np.concatenate([[told.start[goal, j]], own[:, 3]]))
        whole = ticks[-1] + 1.0 - acts
        start = told.start[goal, j] * len(ticks)
        assert wanted.sum() == pytest.approx(start + steps @ whole, abs=1e-6)
        assert wanted[-1] == own[-1, 3]


def test_no_goal_acts_before_it_is_sent():
    (late,) = (n for n in nuisances(believed(), 0.005) if n.name == LATE)
    # of replays' goals, which act at the next tick after that: half a tick later on average
    assert -late.ends[0] * late.deviation <= LATE_S + 0.5 * TICK_S


def test_goals_are_late_until_their_joint_is_switched_on():
    on, goal, limit = fields.ENABLED, fields.GOAL_POSITION, fields.VELOCITY_LIMIT
    events = np.array(
        [
            [0.100, 0, goal, 0.1],  # before it is switched on, which tells it at once
            [0.100, 1, goal, 0.1],
            [0.103, 0, on, 1.0],
            [0.103, 0, goal, 0.2],
            [0.104, 0, goal, 0.3],
            [0.105, 0, limit, 2.0],
            [0.106, 0, on, 0.0],
        ]
    )
    late = [0.103, 0.105, 0.103, 0.103, 0.114, 0.105, 0.106]
    assert _acts_s(events, [0.01, 0.005]).tolist() == pytest.approx(late)
    assert (_acts_s(events, [0.0, 0.0]) == events[:, 0]).all()
