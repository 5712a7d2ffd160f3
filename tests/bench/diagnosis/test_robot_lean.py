"""How the trunk leans, by a sensor of which nobody says which way it sits."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from walking_robots import believed, but, marvin, recorded_walk, walked, walked_by

from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import Features, RobotKind
from bench.diagnosis.robot.fit import Sight
from bench.diagnosis.robot.leaning import TURNS, nearest, rows_of, turned
from bench.diagnosis.robot.limits import limits
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.replay import LEANS, LEAST_SAMPLES, Jitter, course, play
from bench.recording import Recording

TIPS = "foot_compliance@all"
SOFT = 3.0  #: a knob
LEVEL_RAD = 0.02  #: how far from level the sensor sits


@cache
def times_s():
    """Instants of the sensor's samples; a walk is recorded when a test needs them, no earlier."""
    return np.arange(0.0, walked().end_s - 0.01, 0.02)


def leaning(robot, turn, seed=2, noise_rad=0.0):
    """The walk of a robot, with what a sensor that sits turned about says of its trunk."""
    told = replace(walked(), lean=(times_s(), np.zeros((len(times_s()), 2))))
    track = play(robot, told, Jitter(seed))
    own = np.stack([np.interp(times_s(), track.look_t_s, a) for a in track.lean_rad.T], axis=1)
    shown = np.empty_like(own)
    for k, (axis, sign) in enumerate(turn):
        shown[:, axis] = sign * own[:, k]
    random = np.random.default_rng(seed)
    shown += LEVEL_RAD + noise_rad * random.standard_normal(shown.shape)
    return replace(walked_by(robot, seed), lean=(times_s(), shown), name=f"lean-{seed}")


def with_tips():
    placed = placed_effects(believed())[TIPS]
    return placed.apply(believed(), placed.knob.value(SOFT))


def test_a_sensor_can_sit_in_eight_ways_and_each_is_found():
    assert len(set(TURNS)) == 8
    assert {tuple(sorted(axis for axis, _ in turn)) for turn in TURNS} == {(0, 1)}
    random = np.random.default_rng(1)
    own = [random.standard_normal(2 * n) for n in (24, 24, 30)]
    for turn in TURNS:
        (back,) = (t for t in TURNS if np.array_equal(turned(turned(own[0], turn), t), own[0]))
        shown = [turned(rows, back) + 0.1 * random.standard_normal(len(rows)) for rows in own]
        shown[0][3] = np.nan
        assert nearest(shown, own) == turn


def test_rows_are_about_the_mean_of_each_angle():
    rows = rows_of([np.array([1.0, 2.0, np.nan, 3.0]), np.array([5.0, 5.0, 5.0, 9.0])])
    assert rows == pytest.approx([-1.0, 0.0, np.nan, 1.0, -1.0, -1.0, -1.0, 3.0], nan_ok=True)


def observed(*names, samples=LEAST_SAMPLES):
    """A recorded walk with so many samples of some channels beside the servos."""
    told = recorded_walk()
    count = samples * len(names)
    times = np.repeat(np.linspace(1.0, 3.0, samples), len(names))
    beside = {
        "t_s": times,
        "t_reply_s": times,
        "servo_id": np.zeros(count, np.int16),
        "op": ["read"] * count,
        "register": list(names) * samples,
        "raw": np.tile(np.arange(1.0, 1.0 + len(names)), samples),
    }
    own = {}
    for name, values in beside.items():
        there = told.table.column(name)
        kind = pa.string() if name in ("op", "register") else there.type
        own[name] = pa.concat_arrays([there.cast(kind).combine_chunks(), pa.array(values, kind)])
    return Recording.checked(pa.table(own).sort_by("t_s"), told.metadata)


def test_an_inertial_sensor_comes_before_motion_capture_and_two_angles_are_needed():
    assert course(recorded_walk(), marvin()).lean is None
    both = course(observed(*LEANS[1], *LEANS[0]), marvin()).lean
    assert both[1] == pytest.approx(np.tile([3.0, 4.0], (LEAST_SAMPLES, 1)))
    capture = course(observed(*LEANS[1]), marvin()).lean
    assert capture[1] == pytest.approx(np.tile([1.0, 2.0], (LEAST_SAMPLES, 1)))
    assert course(observed(LEANS[0][0], LEANS[1][0]), marvin()).lean is None
    assert course(observed(*LEANS[0], samples=LEAST_SAMPLES - 1), marvin()).lean is None


@pytest.fixture(scope="module")
def model():
    turn = TURNS[6]
    assert turn != TURNS[0]
    courses = [leaning(believed(), turn, 2), leaning(with_tips(), turn, 3)]
    with RobotModel(
        believed(), marvin(), courses, without=but("tilt", "centre"), processes=1
    ) as made:
        yield made


def left_rad(model, r):
    """What is left of a recording's lean [rad]."""
    kind = RobotKind.LEAN
    return float(np.sqrt(np.nanmean((model.recorded(r, kind) - model.centre[r][kind]) ** 2)))


@pytest.mark.slow
def test_recorded_angles_are_those_that_replays_come_nearest_to(model):
    zero = np.zeros(len(model.nuisances))
    plain, tips = (), ((TIPS, SOFT),)
    model.recentre(plain, zero, [0])
    sound = left_rad(model, 0)
    assert sound < 0.6e-3  # chance of where it starts; neither turned, nor level
    assert np.sqrt(np.nanmean(model.recorded(0, RobotKind.LEAN) ** 2)) > 2.0 * sound
    model.recentre(plain, zero, [1])
    without = left_rad(model, 1)
    # where a fit begins another way may have seemed nearer
    other = turned(model.features[1].lean_rad, TURNS[0])
    model._data[1][RobotKind.LEAN] = other
    model.recentre(tips, zero, [1])
    assert left_rad(model, 1) < 0.5 * without
    assert not np.array_equal(model.recorded(1, RobotKind.LEAN), other)


@pytest.mark.slow
def test_a_lean_speaks_for_tips_that_give(model):
    model.recentre((), np.zeros(len(model.nuisances)))
    costs = {}
    for kinds in ((RobotKind.JOINTS,), (RobotKind.JOINTS, RobotKind.LEAN)):
        sight = Sight(model, [1], kinds)
        costs[kinds] = sight.fit().cost - sight.fit((TIPS,), None).cost
    alone, both = costs.values()
    assert both > alone + 10.0


def test_rows_of_both_angles_are_those_of_a_shorter_recording():
    long, short = (
        Features.of(replace(walked(), lean=(t, np.zeros((len(t), 2)))), marvin())
        for t in (times_s(), times_s())
    )
    bins = len(long.lean_rad) // 2
    less = replace(short, lean_rad=short.lean_rad[: 2 * (bins - 3)])
    rows = long.rows_of(less)[RobotKind.LEAN]
    assert rows.tolist() == [*range(bins - 3), *range(bins, 2 * bins - 3)]
    assert less.rows_of(long) is None
    without = Features.of(walked(), marvin())
    assert without.rows_of(long) is None
    assert long.rows_of(without) is None


@pytest.mark.parametrize("kind", [RobotKind.HEIGHT, RobotKind.LEAN, None])
def test_the_report_says_that_nobody_watched_the_trunk(kind):
    floors = {kind: 1.0}
    told = SimpleNamespace(condition={}, sample_s=())
    features = [SimpleNamespace(course=told, phase=object(), shaken=np.zeros(1))]
    base = SimpleNamespace(joints=())
    model = SimpleNamespace(floors=lambda: floors, features=features, nuisances=(), base=base)
    said = " ".join(limits(model, SimpleNamespace(nuisances=np.empty(0)), [0], held_out=True))
    assert ("imu/roll_rad and imu/pitch_rad" in said) is (kind is None)
