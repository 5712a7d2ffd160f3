"""From recorded writes and reads to what a controller was told and what was seen."""

import math

import numpy as np
import pytest
from pendulum_logs import (
    CONDITION,
    DUTY,
    JOINT,
    POSITION,
    ROBOT,
    SERVO,
    VOLTS,
    access,
    logs,
    raw_access,
    recorded,
    robot,
)

from bench.diagnosis.commands import drive_commands, recording_baud_rate, supply_events
from bench.diagnosis.observed import LEAST_SAMPLES, Channel, lonely, observe, unwrapped
from bench.recording import Recording, RecordingError
from busemu.tables import load_robot
from sim.drive import fields, lanes

COUNTS_A_TURN = 4096


def told(rows, settings=None, origin_s=0.0):
    table = robot().tables[SERVO]
    metadata = {"name": "w", "robot": ROBOT, "source": "simulation", "condition": dict(CONDITION)}
    if settings:
        metadata["servo"] = {str(SERVO): {"registers": settings}}
    reads = [access(table, 0.001 + 0.1 * k, "read", POSITION, 0.2) for k in range(3)]
    recording = Recording.of(sorted([*rows, *reads], key=lambda row: row.t_s), metadata)
    none = np.zeros(0)
    return drive_commands(recording, robot().by_joint[JOINT], table, none, none, origin_s)


def write(t_s, name, raw):
    return raw_access(t_s, "write", name, raw)


def gain_of(raw):
    """Duty per rad of a P gain register."""
    return raw * float(robot().tables[SERVO].drive["position_p_gain_duty_per_rad"])


@pytest.mark.parametrize("raw", [100, 400, 900])
def test_the_gain_register_of_the_metadata_is_the_position_laws_gain(raw):
    start, _ = told([write(0.5, "goal_position", 2048)], {"position_p_gain": raw})
    assert start[fields.GAIN_CW] == pytest.approx(gain_of(raw), rel=1e-3)
    assert start[fields.GAIN_CCW] == start[fields.GAIN_CW]


@pytest.mark.parametrize(
    ("rows", "on"),
    [
        ([], True),
        ([write(0.1, "goal_position", 3000), write(0.2, "torque_enable", 0)], True),
        ([write(0.1, "torque_enable", 0), write(0.2, "goal_position", 3000)], False),
        ([write(0.1, "torque_enable", 1), write(0.2, "goal_position", 3000)], False),
        ([write(0.1, "goal_position", 3000), write(0.2, "torque_enable", 1)], False),
    ],
    ids=["never told", "goals, then off", "off, then goals", "on, then goals", "goals, then on"],
)
def test_a_servo_that_was_given_goals_and_then_switched_off_was_on(rows, on):
    start, _ = told(rows)
    assert bool(start[fields.ENABLED]) == on


def test_a_written_gain_comes_when_it_was_written():
    rows = [write(0.3, "position_p_gain", 800), write(0.4, "goal_position", 3000)]
    start, changes = told(rows)
    assert start[fields.GAIN_CW] == pytest.approx(gain_of(400), rel=1e-3)
    gains = changes[changes[:, 1] == fields.GAIN_CW]
    assert gains[:, 0] == pytest.approx([0.3])
    assert gains[:, 2] == pytest.approx(gain_of(800), rel=1e-3)


def test_goals_are_in_rad_from_the_centre_of_the_range():
    rows = [write(0.2 * (k + 1), "goal_position", 2048 + 100 * k) for k in range(3)]
    _, changes = told(rows)
    goals = changes[changes[:, 1] == fields.GOAL_POSITION]
    at = {round(t, 6): value for t, _, value in goals.tolist()}
    assert at[0.4] == pytest.approx(100 * 2.0 * math.pi / COUNTS_A_TURN)
    assert at[0.6] == pytest.approx(200 * 2.0 * math.pi / COUNTS_A_TURN)


def test_torque_off_and_on_are_events():
    rows = [
        write(0.1, "torque_enable", 1),
        write(0.3, "torque_enable", 0),
        write(0.5, "torque_enable", 1),
    ]
    start, changes = told(rows)
    assert start[fields.ENABLED] == 0.0
    enabled = changes[changes[:, 1] == fields.ENABLED]
    assert enabled[:, 0] == pytest.approx([0.1, 0.3, 0.5])
    assert enabled[:, 2].tolist() == [1.0, 0.0, 1.0]


def test_a_servo_of_which_nothing_is_told_was_switched_on_before():
    start, _ = told([write(0.5, "goal_position", 2048)])
    assert start[fields.ENABLED] == 1.0


def test_what_was_written_before_the_beginning_is_in_the_start():
    rows = [write(0.1, "goal_position", 2500), write(0.9, "goal_position", 2600)]
    start, changes = told(rows, origin_s=0.5)
    assert start[fields.GOAL_POSITION] == pytest.approx(452 * 2.0 * math.pi / COUNTS_A_TURN)
    assert changes[:, 0] == pytest.approx([0.4])


def test_a_write_that_changes_nothing_is_no_event():
    rows = [write(0.1 * k, "goal_position", 2100) for k in range(1, 6)]
    _, changes = told(rows)
    assert len(changes) == 1


def test_registers_that_only_read_are_not_written():
    rows = [write(0.2, POSITION, 3000), write(0.3, "goal_position", 2100)]
    _, changes = told(rows)
    assert (changes[:, 0] == 0.3).all()


def test_a_recorded_voltage_is_the_supply():
    rows = supply_events(np.array([0.1, 0.2]), np.array([5.0, 4.8]))
    assert rows.tolist() == [
        [0.1, lanes.SUPPLY_EVENT + fields.SUPPLY_VOLTAGE, 5.0],
        [0.2, lanes.SUPPLY_EVENT + fields.SUPPLY_VOLTAGE, 4.8],
    ]


def test_the_baud_rate_is_the_robots_unless_the_recording_tells():
    (recording,) = logs(motions=["slow"], duration_s=0.5)
    assert recording_baud_rate(recording) == robot().baud_rate
    told = Recording.of([write(0.0, "goal_position", 2048)], {"name": "b", "robot": ROBOT})
    other = {"name": "b", "robot": ROBOT, "bus": {"baud_rate": 57600}}
    assert recording_baud_rate(told) == robot().baud_rate
    assert recording_baud_rate(Recording.of([write(0.0, "goal_position", 2048)], other)) == 57600


# --- what was seen


def test_every_channel_finds_its_samples_among_the_replays():
    (recording,) = logs(motions=["slow"], registers=(POSITION, DUTY, VOLTS))
    (one,) = observe([recording], robot(), JOINT)
    for channel in Channel:
        samples = one.channels[channel]
        assert (one.replay.samples[samples.index] == samples.t_s).all()
        assert samples.good.all()
    assert (np.diff(one.replay.samples) > 0.0).all()
    assert (np.diff(one.replay.events[:, 0]) >= 0.0).all()


def under_volts(*values, supply_from_register=True):
    """Recordings whose voltage register reads so [V], each over and over, observed."""
    told = [
        recorded("slow", {POSITION: None, VOLTS: np.resize(some, 300)}, 3.0, CONDITION, "one")
        for some in values
    ]
    return observe(told, robot(), JOINT, supply_from_register=supply_from_register)


def supplies(one):
    return one.replay.events[one.replay.events[:, 1] >= lanes.SUPPLY_EVENT]


def test_a_voltage_that_was_read_feeds_the_replay_from_the_start():
    (one,) = under_volts([5.0, 4.9, 4.7])
    volts = supplies(one)
    assert one.supplied
    assert volts[0, 0] == 0.0
    assert volts[:, 2] == pytest.approx(one.channels[Channel.VOLTAGE].value)
    (without,) = under_volts([5.0, 4.9, 4.7], supply_from_register=False)
    assert not len(supplies(without))


def test_a_voltage_that_hardly_changes_but_for_its_rounding_is_its_mean():
    some = under_volts([5.0, 4.9], [4.9, 4.8])
    assert not any(one.supplied or one.seldom for one in some)
    for one in some:  # of one supply
        ((t_s, _, volts),) = supplies(one)
        assert (t_s, volts) == (0.0, pytest.approx(4.9))


def test_supplies_that_are_more_than_a_step_apart_are_two():
    some = under_volts([5.0, 4.9], [4.7, 4.6])
    assert [one.supplied for one in some] == [False, False]
    assert [supplies(one)[0, 2] for one in some] == pytest.approx([4.95, 4.65])


def test_a_voltage_that_dips_now_and_then_is_taken_as_read():
    dips = np.where(np.arange(300) % 100 < 3, 4.0, 5.0)
    glitch = np.where(np.arange(300) == 150, 0.0, 5.0)
    assert [one.supplied for one in under_volts(dips)] == [True]
    assert [one.supplied for one in under_volts(glitch)] == [False]


def test_a_voltage_that_changes_in_one_recording_is_taken_as_read_in_all():
    assert [one.supplied for one in under_volts([5.0, 4.9], [5.0, 4.9, 4.7])] == [True, True]


def test_a_recording_of_too_few_positions_is_left_out_and_of_none_refused():
    few = recorded("slow", {POSITION: None}, 0.01 * (LEAST_SAMPLES - 1), CONDITION, "few")
    enough = recorded("slow", {POSITION: None}, 0.01 * LEAST_SAMPLES, CONDITION, "enough")
    assert [o.group for o in observe([few, enough], robot(), JOINT)] == ["enough"]
    with pytest.raises(RecordingError, match=f"no recording has {LEAST_SAMPLES} positions"):
        observe([few], robot(), JOINT)


def test_the_goal_is_what_the_controller_got():
    (recording,) = logs(motions=["steps"])
    (one,) = observe([recording], robot(), JOINT)
    t_s, goal = one.goal
    assert t_s[0] == 0.0
    assert np.ptp(goal) == pytest.approx(1.6, abs=2e-3)


def test_a_joint_that_moves_at_the_beginning_has_its_speed():
    table = robot().tables[SERVO]
    rows = []
    for k in range(60):
        rows.append(access(table, 0.02 * k, "write", "goal_position", 0.0))
        rows.append(access(table, 0.02 * k + 0.004, "read", POSITION, 1.5 * 0.02 * k))
    metadata = {"name": "m", "robot": ROBOT, "condition": dict(CONDITION)}
    (one,) = observe([Recording.of(rows, metadata)], robot(), JOINT)
    assert one.replay.velocity_rad_s == pytest.approx(1.5, rel=0.02)
    (still,) = observe(logs(motions=["slow"]), robot(), JOINT)
    assert still.replay.velocity_rad_s == 0.0


# --- values that stand alone

QUANTUM = 2.0 * math.pi / COUNTS_A_TURN


def counted(values):
    return np.round(values / QUANTUM) * QUANTUM


@pytest.mark.parametrize("size", [-2.0, 0.1, 0.5, 3.0])
def test_glitches_are_found_and_nothing_else(size):
    values = counted(0.3 * np.sin(np.linspace(0.0, 6.0, 300)))
    planted = [40, 111, 250]
    values[planted] += size
    assert np.flatnonzero(~lonely(values, QUANTUM)).tolist() == planted


def test_a_failed_read_that_was_logged_as_a_constant_is_found():
    values = counted(1.0 + 0.3 * np.sin(np.linspace(0.0, 6.0, 300)))
    values[::60] = 0.0
    assert set(np.flatnonzero(~lonely(values, QUANTUM))) >= set(range(60, 300, 60))


@pytest.mark.parametrize("height", [0.1, 1.0, 3.0])
def test_steps_stay(height):
    values = np.zeros(200)
    values[77:] = height
    values[150:] = -height
    assert lonely(values, QUANTUM).all()


@pytest.mark.parametrize("length", [2, 3])
def test_values_that_are_not_alone_stay(length):
    values = np.zeros(100)
    values[40 : 40 + length] = 0.5
    assert lonely(values, QUANTUM).all()


def test_motion_stays_however_fast():
    t = np.linspace(0.0, 3.0, 300)
    for omega in (1.0, 10.0, 30.0):
        assert lonely(counted(np.sin(omega * t)), QUANTUM).all()


def test_noise_of_some_counts_stays():
    noise = QUANTUM * np.round(2.0 * np.random.default_rng(1).normal(size=2000))
    assert lonely(noise, QUANTUM).mean() > 0.999


def test_a_handful_of_values_are_all_good():
    assert lonely(np.array([0.0, 9.0, 0.0]), QUANTUM).all()


# --- firmware that applies a duty, encoders without ends


def tracked(raw, duty, step_s=0.001, unseen=0, settings=None, servo=SERVO, name=ROBOT):
    """A duty that no register holds, and the positions it made but for the first ``unseen``."""
    rows = []
    for k, (count, share) in enumerate(zip(raw, duty, strict=True)):
        rows.append(raw_access(step_s * k, "read", "foreign/goal_duty", share, 0))
        if k >= unseen:
            rows.append(raw_access(step_s * k, "read", POSITION, count % COUNTS_A_TURN, servo))
    told = {"servo": {str(servo): {"registers": settings}}} if settings else {}
    return Recording.of(rows, {"name": "t", "robot": name, "condition": dict(CONDITION)} | told)


def test_a_duty_that_no_register_holds_is_the_command():
    duty = np.repeat([0.5, -0.25], 20)
    (one,) = observe([tracked(2048 + np.arange(40), duty)], robot(), JOINT)
    start, events = one.replay.start, one.replay.events
    assert start[fields.MODE] == fields.MODE_PWM
    assert start[fields.ENABLED] == 1.0
    assert start[fields.GOAL_DUTY] == 0.5
    changes = events[events[:, 1] == fields.GOAL_DUTY]
    assert changes[:, 2].tolist() == [-0.25]
    assert changes[0, 0] == pytest.approx(0.021)  # the replay begins 1 ms before the first sample


def test_a_duty_acts_whatever_the_torque_register_says():
    duty = np.full(40, 0.5)
    one = tracked(2048 + np.arange(40), duty, settings={"torque_enable": 0})
    assert observe([one], robot(), JOINT)[0].replay.start[fields.ENABLED] == 1.0


def test_a_duty_from_before_the_first_position_is_in_force_and_no_event():
    duty = np.repeat([0.5, 0.25, -0.25], [10, 30, 20])
    (one,) = observe([tracked(2048 + np.arange(60), duty, unseen=20)], robot(), JOINT)
    assert one.replay.start[fields.GOAL_DUTY] == 0.25
    changes = one.replay.events[one.replay.events[:, 1] == fields.GOAL_DUTY]
    assert changes[:, [0, 2]].tolist() == [[pytest.approx(0.021), -0.25]]


def test_a_duty_of_no_servo_moves_no_joint_of_several():
    rig = load_robot("sts3215-lever")
    assert len(rig.servos) > 1
    one = tracked(2048 + np.arange(40), np.full(40, 0.5), servo=5, name=rig.name)
    start = observe([one], rig, "lever")[0].replay.start
    assert start[fields.MODE] == fields.MODE_POSITION
    assert start[fields.GOAL_DUTY] == 0.0


@pytest.mark.parametrize(("counts", "goes_on"), [(4096, True), (1024, False), (4096.3, False)])
def test_only_an_encoder_without_ends_goes_on_beyond_its_turn(counts, goes_on):
    quantum = 2.0 * math.pi / counts
    angles = quantum * ((np.arange(40) * 0.03 * counts) % counts // 1)
    assert bool(unwrapped(angles, quantum)[-1] > 2.0 * math.pi) is goes_on


def test_an_encoder_without_ends_goes_on_beyond_its_turn():
    raw = 4000 + 30 * np.arange(40)
    (one,) = observe([tracked(raw, np.full(40, 0.5))], robot(), JOINT)
    turned = one.position.value - one.position.value[0]
    assert turned == pytest.approx((raw - raw[0]) * 2.0 * math.pi / COUNTS_A_TURN)
    assert one.position.good.all()


def test_a_joint_that_gathers_speed_begins_with_what_it_has():
    """1 kHz: five samples are too few to tell a slow joint from one at rest."""
    t = 0.001 * np.arange(40)
    steady = np.round(0.6e3 * t)
    gathering = np.round(0.5 * 2e5 * t**2)
    for raw, wanted in ((steady, 0.6e3), (gathering, 0.0)):
        (one,) = observe([tracked(2048 + raw, np.full(40, 0.5))], robot(), JOINT)
        counts_s = one.replay.velocity_rad_s * COUNTS_A_TURN / (2.0 * math.pi)
        assert counts_s == pytest.approx(wanted, abs=150.0)


def test_a_joint_that_trembles_by_a_count_or_two_begins_at_rest():
    raw = 2048 + np.array([0, 1, 2] * 14)[:40]
    (one,) = observe([tracked(raw, np.zeros(40))], robot(), JOINT)
    assert one.replay.velocity_rad_s == 0.0


def test_a_load_register_whose_sign_is_exchanged_is_the_duty_all_the_same():
    """An STS3215 on its way up: the public logs show its load negative then."""
    rig = load_robot("sts3215-lever")
    table = rig.tables[5]
    rows = []
    for k in range(30):
        rows.append(raw_access(0.1 * k, "read", POSITION, 2000 + 5 * k, 5))
        raw = table["present_load"].encode(-76)
        rows.append(raw_access(0.1 * k, "read", "present_load", raw, 5))
    (one,) = observe([Recording.of(rows, {"name": "up", "robot": "sts3215-lever"})], rig, "lever")
    assert one.channels[Channel.DUTY].value == pytest.approx(0.076)
    assert (np.diff(one.position.value) > 0.0).all()  # no other register's is
