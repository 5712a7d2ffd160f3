"""Recordings of a whole robot that read only some of its joints, or in which a servo shut down."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from functools import partial
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from walking_robots import believed, but, marvin, recorded_walk, walked, walked_with

from bench.diagnosis.robot import running as robot_running
from bench.diagnosis.robot.features import Features, shown_by
from bench.diagnosis.robot.judging import Judgement, traces
from bench.diagnosis.robot.limits import unread, without_gait
from bench.diagnosis.robot.model import RobotKind, RobotModel
from bench.diagnosis.robot.overload import before_overload
from bench.diagnosis.robot.pool import Job
from bench.diagnosis.robot.replay import course, play
from bench.diagnosis.robot.running import run_robot
from bench.diagnosis.running import Split
from bench.diagnosis.sense import DiagnosisError
from bench.diagnosis.watch import OutOfTimeError, Watch
from bench.recording import Recording, RecordingError, joint_track

READ = ("leg1", "leg4")
JOINTS = [mount.joint for mount in marvin().servos]
SILENT = [j for j, joint in enumerate(JOINTS) if joint.partition(".")[0] not in READ]
SPOKEN = [j for j in range(len(JOINTS)) if j not in SILENT]


def of_rows(recording, keep):
    """The recording with the rows that a mask keeps."""
    return Recording.checked(recording.table.filter(keep), recording.metadata)


def without_reads(recording, servo_ids):
    table = recording.table
    own = pc.is_in(
        table.column("servo_id"), pa.array(servo_ids, table.schema.field("servo_id").type)
    )
    read = pc.equal(table.column("op").cast(pa.string()), "read")
    return of_rows(recording, pc.invert(pc.and_(own, read)))


def ids(joints):
    return [marvin().by_joint[JOINTS[j]].servo_id for j in joints]


@pytest.fixture(scope="module")
def partly():
    return without_reads(recorded_walk(), ids(SILENT))


def test_joints_that_nobody_read_are_replayed_as_told_and_compared_nowhere(partly):
    told, whole = course(partly, marvin()), walked()
    assert [j for j, t in enumerate(told.sample_s) if not len(t)] == SILENT
    for j in SPOKEN:
        assert np.array_equal(told.position_rad[j], whole.position_rad[j])
    goals = [joint_track(partly, JOINTS[j], marvin()).goal_rad[0] for j in SILENT]
    assert told.first_rad[SILENT] == pytest.approx(goals)
    features = Features.of(told, marvin())
    assert sorted(set(features.joint_row.tolist())) == SPOKEN
    track = play(believed(), told)
    means = features.of_track(track)
    assert np.isfinite(means.angle_rad).all()
    assert np.sqrt(np.mean((means.angle_rad - features.position_rad) ** 2)) < 0.002
    assert np.isfinite(features.scatter(track)).all()


def test_where_a_replay_begins_in_the_middle_unread_joints_are_at_their_goals(partly):
    told = course(partly, marvin())
    at = told.at(2.0)
    assert at[SPOKEN] == pytest.approx(walked().at(2.0)[SPOKEN], abs=0.002)
    for j in SILENT:
        goal_t, goal = told.goals[JOINTS[j]]
        assert at[j] == goal[goal_t <= 2.0][-1]


def test_a_joint_that_was_neither_read_nor_told_is_an_error(partly):
    table = partly.table
    (silent,) = ids(SILENT[:1])
    with pytest.raises(RecordingError, match=f"{JOINTS[SILENT[0]]} was neither read nor told"):
        course(of_rows(partly, pc.not_equal(table.column("servo_id"), silent)), marvin())


def test_a_recording_that_reads_no_positions_is_an_error():
    with pytest.raises(RecordingError, match="fewer than 20 positions of every joint"):
        course(without_reads(recorded_walk(), ids(range(len(JOINTS)))), marvin())


def test_pictures_are_of_joints_that_were_read(partly):
    told = course(partly, marvin())
    one = Judgement(told, told.position_rad)
    assert [trace.joint for trace in traces(marvin(), [one], [one])] == [JOINTS[j] for j in SPOKEN]


def test_a_diagnosis_says_which_joints_nobody_read(partly):
    every = [Features.of(c, marvin()) for c in (course(partly, marvin()), walked())]
    model = SimpleNamespace(features=every, base=believed())
    assert unread(model, [1]) == ()
    (told,) = unread(model, [0, 1])
    assert told.startswith("nobody read 12 of 18 joints in walk-1 (leg2.coxa,")


def test_a_diagnosis_says_where_a_robot_does_not_walk():
    walk = Features.of(walked(), marvin())
    assert without_gait(SimpleNamespace(features=[walk])) == ()
    chance = {0: 1.0, 1: 0.003}
    model = SimpleNamespace(
        features=[walk, replace(walk, phase=None)],
        chance=lambda r: np.full(4, chance[r] ** 2),
        floors=dict,
    )
    (told,) = without_gait(model)
    assert told.startswith("no gait in walk-1: ")
    assert "here 3.0 mrad within tolerances" in told


@pytest.mark.slow
def test_residuals_and_what_tolerances_do_are_of_joints_that_were_read():
    blank = [np.empty(0) if j in SILENT else None for j in range(len(JOINTS))]
    one = walked_with({"gain_error@leg4": 2.0}, 21)
    told = replace(
        one,
        **{
            name: tuple(
                own if gone is None else gone
                for own, gone in zip(getattr(one, name), blank, strict=True)
            )
            for name in ("sample_s", "wait_s", "position_rad")
        },
    )
    known = but("gain", "torque", "late")
    with RobotModel(believed(), marvin(), [told], without=known, processes=1) as model:
        nothing = np.zeros(len(model.nuisances))
        assert np.isfinite(model.traces[0][RobotKind.JOINTS]).all()
        block = model.residuals((), nothing, [0])[0, RobotKind.JOINTS]
        assert len(block.value) == len(model.features[0].bin)
        squares = [
            float(np.mean(block.value[model.features[0].joint_row == j] ** 2)) for j in SPOKEN
        ]
        off = {JOINTS[j] for j, x in zip(SPOKEN, squares, strict=True) if x > 4.0 * min(squares)}
        assert "leg4.femur" in off
        assert not any(joint.startswith("leg1") for joint in off)


def with_torque_reads(values, written=()):
    """The walk with reads of ``torque_enable`` of servo 5 every second; and writes [s, value]."""
    walk = recorded_walk()
    first = float(walk.t_s[0])
    rows = [
        {"t_s": first + 1.0 + k, "op": "read", "raw": float(value), "t_reply_s": first + 1.001 + k}
        for k, value in enumerate(values)
    ] + [
        {"t_s": first + t, "op": "write", "raw": float(x), "t_reply_s": float("nan")}
        for t, x in written
    ]
    own = [row | {"servo_id": 5, "register": "torque_enable"} for row in rows]
    schema = walk.table.schema
    more = pa.Table.from_pylist([dict.fromkeys(schema.names) | row for row in own])
    plain = {
        name: walk.table.column(name).cast(more.schema.field(name).type)
        for name in ("op", "register")
    }
    table = walk.table
    for name, column in plain.items():
        table = table.set_column(table.schema.get_field_index(name), name, column)
    both = pa.concat_tables([table, more.cast(table.schema)]).sort_by("t_s")
    return Recording.checked(both, walk.metadata), first


def test_what_follows_where_a_servo_shut_itself_down_is_left_out():
    walk, first = with_torque_reads([1, 1, 1, 0])
    (kept,), (told,) = before_overload(marvin(), [walk])
    assert float(kept.t_s[-1]) == pytest.approx(first + 2.0, abs=0.05)
    assert float(kept.t_s[-1]) <= first + 2.0 + 1e-9  # rounding
    assert len(kept) == np.sum(walk.t_s <= kept.t_s[-1])
    assert float(walk.t_s[-1]) > first + 4.0
    joint = marvin().by_id[5].joint
    assert told == (
        f"walk-1: {joint} shut itself down after {first + 3.0:.2f} s; what follows "
        f"{first + 2.0:.2f} s is not compared"
    )


@pytest.mark.parametrize(
    ("values", "written"),
    [
        ([1, 1, 1], []),
        ([0, 0, 1, 1], []),  # it was off, and was switched on
        ([1, 1, 0], [(2.5, 0)]),  # somebody switched it off
    ],
)
def test_what_nobody_but_the_host_switched_is_kept(values, written):
    walk, _ = with_torque_reads(values, written)
    assert before_overload(marvin(), [walk]) == ((walk,), ())


def standing(error_rad, walks=False, begin_s=0.0):
    """A robot that is told to stand (or walks, in its goals), read at 50 Hz for four seconds.

    The first joint is ``error_rad`` of the time from its goal.
    """
    walk, mounts = recorded_walk(), marvin().servos
    rows = []
    for k in range(200):
        t = 0.02 * k
        for j, mount in enumerate(mounts):
            goal = 0.3 * np.sin(2.0 * np.pi * t) if walks else 0.2
            if walks or not k:
                rows.append(row(begin_s + t, mount, "write", "goal_position", goal))
            off = error_rad(t) if j == 0 else 0.0
            read_s = begin_s + t + 0.002
            rows.append(row(read_s, mount, "read", "present_position", goal - off))
    schema = walk.table.schema
    every = sorted(rows, key=lambda one: one["t_s"])
    return Recording.checked(pa.Table.from_pylist(every, schema), walk.metadata)


def row(t_s, mount, op, register, joint_rad):
    column = marvin().tables[mount.servo_id][register]
    raw = float(round(mount.to_servo(joint_rad) / column.si_scale + 512))
    spoken = {"servo_id": mount.servo_id, "op": op, "register": register, "raw": raw}
    return {"t_s": t_s, "t_reply_s": t_s + 0.001 if op == "read" else None, **spoken}


def held_off(rad, from_s, to_s):
    return lambda t: rad if from_s <= t < to_s else 0.0


@pytest.mark.parametrize(
    ("error_rad", "walks", "last_s"),
    [
        (held_off(0.17, 1.5, 3.9), False, 1.5),  # nine tenths of what brings full duty
        (held_off(-0.17, 1.5, 3.9), False, 1.5),
        (held_off(0.10, 1.0, 3.5), False, None),
        (held_off(0.17, 1.0, 2.5), False, None),  # for a moment, as it stands up
        (held_off(0.17, 1.0, 3.5), True, None),
    ],
)
def test_a_standing_robot_is_compared_until_a_servo_is_near_its_limit(error_rad, walks, last_s):
    recording = standing(error_rad, walks)
    (kept,), told = before_overload(marvin(), [recording])
    if last_s is None:
        assert (kept, told) == (recording, ())
        return
    assert float(kept.t_s[-1]) == pytest.approx(last_s, abs=0.03)
    (sentence,) = told
    assert sentence.startswith(f"walk-1: {JOINTS[0]} is near its stall torque for long; what")


def test_a_recording_without_a_window_before_its_limit_is_left_out_and_named():
    good = standing(held_off(0.0, 0.0, 0.0))
    for first_s in (0.2, 1.2):
        short = standing(held_off(0.17, first_s, 3.5), begin_s=0.7)
        kept, (sentence,) = before_overload(marvin(), [short, good])
        assert kept == (good,)
        assert sentence.startswith(
            f"walk-1 was left out: {JOINTS[0]} is near its stall torque for long, from {first_s}"
        )
        assert "what is before that is too short to compare; record it with less load" in sentence
    enough = standing(held_off(0.17, 1.4, 3.9), begin_s=0.7)
    (kept,), _ = before_overload(marvin(), [enough])
    assert len(Features.of(course(kept, marvin()), marvin()).bin) == 2 * len(JOINTS)  # windows


def test_where_nothing_is_left_to_fit_it_is_refused_and_where_nothing_judges_it_is_told(
    tmp_path, monkeypatch
):
    short, good = standing(held_off(0.17, 0.5, 3.5)), standing(held_off(0.0, 0.0, 0.0))
    asked = []

    def diagnose(robot, fitted, judging, **_):
        asked.append((fitted, judging))
        raise OutOfTimeError("that")

    monkeypatch.setattr(robot_running, "diagnose_robot", diagnose)
    run = partial(run_robot, marvin(), out=tmp_path, on=date(2026, 1, 2), watch=Watch(print))
    with pytest.raises(RecordingError, match=r"nothing is left to fit: walk-1 was left out: .*"):
        run(Split((short,), (good,)))
    with pytest.raises(DiagnosisError):
        run(Split((good,), (short,)))
    assert asked == [((good,), ())]


@pytest.mark.slow
def test_rounding_of_a_joint_that_stands_is_in_its_means():
    moving = Features.of(course(standing(lambda t: 0.1 * t), marvin()), marvin())
    assert moving.phase is None
    rounding, first = moving.rounding_rad2, moving.joint_row == 0
    assert (rounding[first] == 0.0).all()
    assert rounding[~first] == pytest.approx(moving.course.quantum_rad**2 / 12.0)
    assert not Features.of(walked(), marvin()).rounding_rad2.any()
    courses = [moving.course]
    known = but("gain", "late")
    with RobotModel(believed(), marvin(), courses, without=known, processes=1) as model:
        block = model.residuals((), np.zeros(len(model.nuisances)), [0])[0, RobotKind.JOINTS]
        (outcome,) = model.replays.run([Job(0)])
        others = outcome.scatter_rad2 + model.spread[0][RobotKind.JOINTS]
        # of what is chance, what lasts is one number a joint and no scatter of its windows
        assert block.scatter - others == pytest.approx(rounding)
        lasting = np.sum(block.sways**2, axis=1)
        assert block.extra + lasting - others == pytest.approx(rounding)
        assert 0.0 < np.sqrt(lasting.mean()) < 0.02
        assert np.count_nonzero(block.sways, axis=1).max() == 1
        assert model.chance(0) == pytest.approx(model.chance(0).clip(min=lasting))
        # robots within tolerances start a little otherwise: that is not scatter once more
        assert model.spread[0][RobotKind.JOINTS] == pytest.approx(model.chance(0))


def like(walks, rows, told):
    """Features of so many rows and of a kind of goals, which walk or do not."""
    one = SimpleNamespace(phase=object() if walks else None, size=rows, told=told)
    one.shows = lambda other: (
        one.size >= other.size and ((walks and other.phase is not None) or one.told == other.told)
    )
    return one


def test_where_there_is_no_gait_one_motion_stands_for_all_loads():
    lying = [like(False, 9, "a"), like(False, 9, "a"), like(False, 9, "b"), like(False, 8, "a")]
    assert shown_by(lying, (0, 1, 2, 3), ()) == (0, 0, 2, 0)
    assert shown_by(lying[::-1], (0, 1, 2, 3), ()) == (2, 1, 2, 2)
    walking = [like(True, 9, "a"), like(True, 9, "a"), like(True, 9, "b")]
    assert shown_by(walking, (0, 1, 2), ()) == (0, 1, 2)
    assert shown_by(walking, (0, 1, 2), (2,)) == (0, 1, 0)


def test_another_motion_does_not_stand_for_one_that_only_judges():
    lying = [like(False, 9, "a"), like(False, 9, "b")]
    assert shown_by(lying, (0, 1), (1,)) == (0, 1)


def test_where_there_is_no_gait_only_the_same_motion_shows_what_changes_do():
    one = replace(Features.of(walked(), marvin()), phase=None)
    heavy = replace(one, course=replace(one.course, condition={"payload_kg": 0.1}))
    other = replace(one, goal_rad=one.goal_rad + 0.1)
    assert one.shows(heavy)
    assert not one.like(heavy)
    assert not one.shows(other)
    walk = Features.of(walked(), marvin())
    assert walk.shows(replace(walk, goal_rad=walk.goal_rad + 0.1))


def until(end_s):
    """The walk's beginning, in which there is no gait yet."""
    one = walked()
    keep = [t <= end_s for t in one.sample_s]
    cut = {
        name: tuple(value[k] for value, k in zip(getattr(one, name), keep, strict=True))
        for name in ("sample_s", "wait_s", "position_rad")
    }
    goals = {joint: (t[t <= end_s], goal[t <= end_s]) for joint, (t, goal) in one.goals.items()}
    return replace(one, events=one.events[one.events[:, 0] <= end_s], goals=goals, **cut)


def test_a_longer_recording_has_the_rows_of_a_shorter_one():
    longer, shorter = (Features.of(until(end_s), marvin()) for end_s in (2.6, 2.0))
    assert shorter.phase is None
    assert longer.shows(shorter)
    assert not shorter.shows(longer)
    assert not longer.like(shorter)
    rows = longer.rows_of(shorter)[RobotKind.JOINTS]
    assert np.array_equal(longer.joint_row[rows], shorter.joint_row)
    assert np.array_equal(longer.bin[rows], shorter.bin)
    assert len(rows) < longer.size
    assert not longer.shows(replace(shorter, goal_rad=shorter.goal_rad + 0.1))
    seen = replace(shorter, voltage_v=np.full(3, 7.4))
    assert shorter.rows_of(longer) is None
    assert longer.rows_of(seen) is None  # nobody read a voltage in the longer one
    assert replace(longer, voltage_v=np.full(5, 7.4)).rows_of(shorter) is None
    assert replace(longer, voltage_v=np.full(2, 7.4)).rows_of(seen) is None
    assert list(replace(longer, voltage_v=np.full(5, 7.4)).rows_of(seen)[RobotKind.VOLTAGE]) == [
        0,
        1,
        2,
    ]


@pytest.mark.slow
def test_what_changes_a_shorter_recording_is_that_of_a_longer_one():
    courses = [until(2.0), until(2.6)]
    known = but("gain", "late")
    with RobotModel(believed(), marvin(), courses, without=known, processes=1) as model:
        assert model.like == (1, 1)
        rows = model.features[1].rows_of(model.features[0])[RobotKind.JOINTS]
        shared = [k for k, n in enumerate(model.nuisances) if n.trial]
        one, other = (traces[RobotKind.JOINTS][:, shared] for traces in model.traces)
        assert np.array_equal(one, other[rows])
        z = np.zeros(len(model.nuisances))
        moved = [
            model.modelled((("gain_error@all", 2.0),), z, r)[RobotKind.JOINTS]
            - model.centre[r][RobotKind.JOINTS]
            for r in (0, 1)
        ]
        assert moved[0] == pytest.approx(moved[1][rows])
        assert np.abs(moved[0]).max() > 0.001
        told = model.trace_at("gain_error@all", 1.0, 0)
        assert len(told[RobotKind.JOINTS]) == len(rows)
