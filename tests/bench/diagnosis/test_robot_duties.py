"""Loads of a robot that stands: they tell a low gain from all that makes a joint give way."""

from dataclasses import replace
from functools import cache
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest
from walking_robots import but

from bench.diagnosis.noise import Block
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import Features, RobotKind
from bench.diagnosis.robot.fit import Sight
from bench.diagnosis.robot.limits import other_duties, without_gait
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.regulated import DUTY_FLOOR, LEAST_READS, LEVELS, Regulated, most_off
from bench.diagnosis.robot.replay import _duty, course
from bench.running import in_process
from busemu.tables import load_robot
from busemu.tables.robots import parse_robot
from busemu.timing import load_profile
from hal.robot_control import RobotControl
from sim.drive import fields
from sim.model import read_model
from sim.world import BulletPlant

SECONDS = 8.0
LESS = 0.8  #: of the gain
#: of an XL-320, as it leaves the works [duty, duty/rad]
PUNCH, GAIN = 32 / 1023, 32 * 0.158
FEMURS = tuple(f"leg{k}.femur" for k in range(1, 7))
#: one after another: legs that lift the trunk, and legs in the air
POSTURES = (
    {"coxa": 0.0, "femur": -0.9, "tibia": -0.6},
    {"coxa": 0.0, "femur": 0.4, "tibia": -0.6},
)


def robot_with(name, effect="", **values):
    robot = load_robot(name)
    if not effect:
        return robot
    parameters = {key: {"value": value, "source": "assumed"} for key, value in values.items()}
    told = [{"name": effect, "where": list(FEMURS), "parameters": parameters}]
    return parse_robot({**robot.document, "effect": told}, robot.path)


@cache
def stood(name, effect="", sway_rad=0.0, **values):
    """A robot that rises, lies down, and whose program reads loads by turns.

    All its joints sway about that.
    """
    robot = robot_with(name, effect, **values)
    plant = BulletPlant(robot)
    session = in_process(robot, plant, load_profile(robot.timing))
    control = RobotControl(robot, session.client)
    first = np.nan_to_num(control.read_positions())
    goals = [np.array([p[j.partition(".")[2]] for j in control.joints]) for p in POSTURES]
    ends = [first, *goals]
    control.set_goals(first)
    control.torque_on()
    ids = cycle(robot.by_id)
    while session.clock.now_s() < SECONDS:
        k, part = divmod(session.clock.now_s(), SECONDS / len(goals))
        begin, end = ends[int(k)], ends[int(k) + 1]
        sway = sway_rad * np.sin(1.5 * session.clock.now_s())
        control.set_goals(begin + min(1.0, part) * (end - begin) + sway)
        control.read_positions()
        for _ in range(3):
            session.client.read(next(ids), "present_load")
    plant.close()
    return session.recording("stand", "stand", **{"effect": effect or "none"})


def seen(name="marvin", effect="", **values):
    robot = load_robot(name)
    return course(stood(name, effect, **values), robot)


def laws(told, name="marvin"):
    robot = load_robot(name)
    return Regulated.of(told, robot, read_model(robot))


def changed(effect, value, name="marvin"):
    robot = read_model(load_robot(name))
    return placed_effects(robot)[effect].apply(robot, value)


@pytest.mark.parametrize("sway_rad", [0.0, 0.14])
@pytest.mark.parametrize("name", ["marvin", "phantomx"])
def test_laws_make_of_recorded_angles_what_the_servos_loads_showed(name, sway_rad):
    told = laws(seen(name, sway_rad=sway_rad), name)
    known = np.isfinite(told.recorded)
    assert known.sum() >= 9
    modelled = told.rows(read_model(load_robot(name)))
    off = (told.recorded - modelled)[known] / np.sqrt(told.extra + DUTY_FLOOR**2)[known]
    assert np.abs(off).max() < 4.0
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert told.recorded[known].min() > 0.0


def test_a_gain_shows_in_loads_as_large_as_it_is():
    told = laws(seen("marvin", "gain_error", scale=LESS))
    low_ones = [j for j, m in enumerate(load_robot("marvin").servos) if m.joint in FEMURS]
    femurs = [LEVELS * j for j in low_ones if np.isfinite(told.recorded[LEVELS * j])]
    assert len(femurs) >= 4
    plain, low = (
        told.rows(robot)
        for robot in (read_model(load_robot("marvin")), changed("gain_error@femur", LESS))
    )
    sigma = np.sqrt(np.mean(told.extra[femurs]) / len(femurs) + DUTY_FLOOR**2)
    assert np.mean((told.recorded - low)[femurs]) == pytest.approx(0.0, abs=3.0 * sigma)
    assert np.mean((told.recorded - plain)[femurs]) < -5.0 * sigma
    others = ~np.isin(np.arange(LEVELS * 18) // LEVELS, low_ones)
    assert (plain[others] == low[others]).all()


def test_no_engine_and_no_motor_plays_a_part_in_it():
    told = laws(seen())
    plain = told.rows(read_model(load_robot("marvin")))
    for effect, value in (
        ("supply_voltage@all", 0.7),
        ("torque_constant@all", 0.8),
        ("payload@all", 0.3),
        ("coulomb_friction@all", 0.1),
    ):
        assert (told.rows(changed(effect, value)) == plain).all()
    assert not (told.rows(changed("dead_zone@all", 0.01)) == plain).all()


def test_a_joint_that_moves_tells_nothing_nor_one_that_was_read_too_seldom():
    told = seen()
    full = laws(told).recorded
    row = int(np.flatnonzero(np.isfinite(full))[0])
    joint = row // LEVELS

    def kept(choice):
        duty = list(told.duty)
        duty[joint] = tuple(part[choice(told.duty[joint][0])] for part in duty[joint])
        return laws(replace(told, duty=tuple(duty))).recorded

    assert np.isnan(kept(lambda t: t < 1.0)[joint])  # it rises
    few = np.flatnonzero(told.duty[joint][0] > 2.0)
    assert np.isnan(kept(lambda t: few[: LEAST_READS - 1])[row])
    assert np.isfinite(kept(lambda t: few[:LEAST_READS])[row])
    moving = list(told.position_rad)
    moving[joint] = moving[joint] + 0.1 * np.sin(12.0 * told.sample_s[joint])
    assert np.isnan(laws(replace(told, position_rad=tuple(moving))).recorded[row])


def test_without_loads_and_without_positions_there_are_no_such_rows():
    told = seen()
    none = laws(replace(told, duty=()))
    assert np.isnan(none.recorded).all()
    assert (none.rows(read_model(load_robot("marvin"))) > 0.0).any()  # for repeats that have them
    lost = replace(
        told,
        sample_s=(np.empty(0), *told.sample_s[1:]),
        position_rad=(np.empty(0), *told.position_rad[1:]),
    )
    found = laws(lost)
    assert np.isnan(found.recorded[0])
    assert (found.rows(read_model(load_robot("marvin")))[:LEVELS] == 0.0).all()


J = 4  #: leg2.femur
ROWS = [LEVELS * J, LEVELS * J + 1]


def held(goals, angle_rad, sample_s, loads):
    """A recording in which a joint is told goals (times, angles), and shows these angles."""
    told = seen()
    mount = load_robot("marvin").servos[J]
    others = told.events[told.events[:, 1] != J]
    own = [(t, J, fields.GOAL_POSITION, mount.to_servo(goal)) for t, goal in goals]
    events = np.array(sorted([*map(tuple, others), *own]))
    start = told.start.copy()
    start[fields.GOAL_POSITION, J], start[fields.ENABLED, J] = mount.to_servo(goals[0][1]), 1.0
    sampled, angles, duty = list(told.sample_s), list(told.position_rad), list(told.duty)
    sampled[J], angles[J] = sample_s, angle_rad
    duty[J] = loads[0], loads[1] * mount.direction
    return replace(
        told,
        events=events,
        start=start,
        sample_s=tuple(sampled),
        position_rad=tuple(angles),
        duty=tuple(duty),
    )


def test_small_and_large_duties_are_rows_of_their_own():
    """A joint that is held out by steps: what is added to its duty is told from its gain."""
    robot, count, half_s = read_model(load_robot("marvin")), seen().quantum_rad, 0.5 * SECONDS
    times, reads = seen().sample_s[J], np.arange(0.02, SECONDS - 0.2, 0.1)
    out = np.where(times < half_s, 0.04, np.where(times < 6.0, 0.12, 0.12 + count))
    loads = reads, np.where(reads < half_s, 0.3, 0.7)
    found = laws(held([(0.0, 0.1)], 0.1 - out, times, loads))
    assert found.recorded[ROWS] == pytest.approx([0.3, 0.7])
    one, two = found.extra[ROWS]  # as many numbers as counts were shown, one after another
    assert one == pytest.approx((GAIN * count) ** 2 / 12.0, rel=0.1)
    assert two == pytest.approx(one / 2.0, rel=0.02)
    small, large = found.rows(robot)[ROWS]
    assert large > 2.0 * small > 0.0
    low = found.rows(changed("gain_error@femur", LESS))[ROWS]
    assert (np.array([small, large]) - low) == pytest.approx(
        (1.0 - LESS) * (np.array([small, large]) - PUNCH), abs=1e-3
    )


@pytest.mark.parametrize(("counts", "counted"), [(2.0, False), (3.0, True)])
def test_joints_that_show_hardly_a_push_are_left_out(counts, counted):
    times, reads = seen().sample_s[J], np.arange(0.22, SECONDS - 0.2, 0.1)
    angles = np.full(len(times), 0.1 - counts * seen().quantum_rad)
    found = laws(held([(0.0, 0.1)], angles, times, (reads, np.full(len(reads), 0.1))))
    assert np.isfinite(found.recorded[ROWS[0]]) == counted


def test_loads_that_were_read_at_once_tell_nothing():
    """Nobody knows for how long the joint has stood so."""
    times, reads = seen().sample_s[J], np.array([0.02, 0.06, 0.1, 0.14])
    angles = np.full(len(times), 0.05)
    found = laws(held([(0.0, 0.1)], angles, times, (reads, np.full(4, 0.3))))
    assert np.isnan(found.recorded[ROWS]).all()


@pytest.mark.filterwarnings("error")
def test_a_joint_whose_positions_are_of_one_instant_tells_nothing():
    reads = np.arange(0.22, SECONDS - 0.2, 0.1)
    told = held(
        [(0.0, 0.1)], np.full(30, 0.05), np.full(30, 2.0), (reads, np.full(len(reads), 0.3))
    )
    assert np.isnan(laws(told).recorded[ROWS]).all()


def test_a_goal_that_moves_by_steps_is_ahead_for_a_while_only():
    """Angles are read when a goal has just come, and is ahead by all of its step."""
    step, cycle_s, lag = 4.0 * seen().quantum_rad, 0.03, 0.08
    begun = 0.01 + np.arange(0.0, SECONDS, cycle_s)
    goals = [(0.0, 0.0), *((t, (k + 1) * step) for k, t in enumerate(begun.tolist()))]
    times = begun + 0.001
    angles = step * times / cycle_s - lag
    reads = np.arange(0.5, SECONDS - 0.5, 0.1)
    found = laws(held(goals, angles, times, (reads, np.full(len(reads), 0.5))))
    ahead = lag + step * (0.5 - begun[0] / cycle_s)  # on the mean
    law = found.rows(read_model(load_robot("marvin")))[ROWS[0]]
    assert law == pytest.approx(PUNCH + GAIN * ahead, abs=0.02 * GAIN * ahead)
    shaken = (GAIN * step) ** 2 / 12.0  # what a load may be of the mean, each of them alike
    assert found.extra[ROWS[0]] > 0.8 * shaken


def test_a_load_whose_sign_is_exchanged_is_the_duty_all_the_same():
    told = stood("marvin")
    times, plain = course(told, load_robot("marvin")).duty[J]
    assert np.abs(plain).max() > 0.05
    robot = load_robot("marvin")
    tables = {
        number: replace(table, drive={**table.drive, "load_sign": -1.0})
        for number, table in robot.tables.items()
    }
    turned = SimpleNamespace(servos=robot.servos, tables=tables)
    again_s, other = _duty(told, turned, robot.servos[J], 0.0)
    assert (other == -plain).all()
    assert np.ptp(again_s - times) == pytest.approx(0.0, abs=1e-9)


@pytest.fixture(scope="module")
def model():
    robot = load_robot("marvin")
    unread = replace(seen(), duty=(), name="unread", group="unread")
    courses = [seen(), seen("marvin", "gain_error", scale=LESS), unread]
    known = but("supply", "gain", "motors")
    with RobotModel(read_model(robot), robot, courses, without=known, processes=1) as made:
        yield made


@pytest.mark.slow
def test_loads_tell_a_gain_from_a_supply_and_whose_gain_it_is(model):
    both = RobotKind.JOINTS, RobotKind.DUTY

    def cost(name, kinds):
        return Sight(model, [1], kinds).fit((name,)).cost

    names = "gain_error@femur", "supply_voltage@all", "gain_error@tibia"
    joints = [cost(name, (RobotKind.JOINTS,)) for name in names]
    with_loads = [cost(name, both) for name in names]
    assert with_loads[0] < min(with_loads[1:]) - 5.0
    assert with_loads[1] - with_loads[0] > joints[1] - joints[0] + 10.0
    found = Sight(model, [1], both).fit(("gain_error@femur",))
    size = model.placed["gain_error@femur"].knob.value(found.knobs[0])
    assert size == pytest.approx(LESS, abs=0.04)
    duties = Sight(model, [1], (RobotKind.DUTY,))
    own = duties.cost(duties.blocks(found.names, found.z), found.noise)
    assert found.once == pytest.approx(own)


@pytest.mark.slow
def test_a_recording_without_loads_is_fitted_beside_those_with_them(model):
    kinds = RobotKind.JOINTS, RobotKind.DUTY
    zero = np.zeros(len(model.nuisances))
    blocks = Sight(model, [0, 2], kinds).blocks((), zero)
    assert len(blocks[2, RobotKind.DUTY].value) == 0
    both, one = (Sight(model, which, (RobotKind.DUTY,)) for which in ([0, 2], [0]))
    noise = one.noise(one.blocks((), zero))
    assert both.cost(both.blocks((), zero), noise) == one.cost(one.blocks((), zero), noise)
    assert both.linearised((), zero, noise)[1].shape == one.linearised((), zero, noise)[1].shape
    assert np.isfinite(Sight(model, [0, 2], kinds).fit().cost)


@pytest.mark.slow
def test_the_noise_of_duties_is_that_of_rounding(model):
    sight = Sight(model, [0, 1], [RobotKind.DUTY])
    blocks = sight.blocks((), np.zeros(len(model.nuisances)))
    assert sight.noise(blocks)[RobotKind.DUTY].total == DUTY_FLOOR
    known = np.isfinite(model.recorded(0, RobotKind.DUTY))
    own = Features.of(seen(), load_robot("marvin")).regulated.extra
    # two of three repeats have loads, and rounding is the same in both
    assert blocks[0, RobotKind.DUTY].extra == pytest.approx(2.0 * own[known])
    assert (own[known] > 0.0).all()


def test_rows_of_duties_belong_to_their_joints():
    features = Features.of(seen(), load_robot("marvin"))
    for joint in (0, J, 17):
        own = np.flatnonzero(features.of_joint(joint, RobotKind.DUTY))
        assert own.tolist() == [LEVELS * joint, LEVELS * joint + 1]


def told_of(recorded):
    joints = [SimpleNamespace(name=name) for name in ("leg1.femur", "leg1.tibia", "leg2.femur")]
    rows = np.array([recorded, [np.nan] * len(recorded)]).T.ravel()
    features = [SimpleNamespace(regulated=SimpleNamespace(recorded=rows))]
    return SimpleNamespace(base=SimpleNamespace(joints=joints), features=features)


@pytest.mark.parametrize(
    ("value", "off", "where"),
    [
        ([0.03, 0.0, 0.0], 3.0, "leg1.femur"),
        ([0.03, 0.0, 0.03], 3.0 * np.sqrt(2.0), "femur"),
        ([0.03, 0.03, 0.0], 3.0 * np.sqrt(2.0), "leg1"),
        ([0.03, 0.03, 0.03], 3.0 * np.sqrt(3.0), ""),
        ([0.01, -0.03, 0.0], 3.0, "tibia"),
        ([0.0, 0.0, 0.0], 0.0, ""),
    ],
)
def test_duties_are_off_where_they_are_so_together(value, off, where):
    block = Block(np.arange(3.0), np.array(value), np.full(3, 0.01**2 - DUTY_FLOOR**2))
    found, place = most_off(told_of([1.0, 1.0, 1.0]), {0: block})
    assert (found, place) == (pytest.approx(off), where)


def test_rows_are_those_of_joints_whose_loads_were_read():
    block = Block(np.arange(2.0), np.array([0.03, 0.03]), np.full(2, 0.01**2 - DUTY_FLOOR**2))
    found, _ = most_off(told_of([1.0, np.nan, 1.0]), {0: block})
    assert found == pytest.approx(3.0 * np.sqrt(2.0))


def test_the_answer_says_how_far_duties_are_off_and_what_shows_a_gain():
    assert other_duties(0.0, "leg1") == ()
    assert "loads of leg2 are 7 deviations from" in other_duties(7.2, "leg2")[0]
    assert "loads of all joints are 5 deviations from" in other_duties(5.0, "")[0]
    features = SimpleNamespace(phase=None, course=SimpleNamespace(name="stand-1"))
    for floors, asked in (({}, True), ({RobotKind.DUTY: DUTY_FLOOR}, False)):
        model = SimpleNamespace(
            features=[features], chance=lambda r: np.ones(3), floors=lambda f=floors: f
        )
        assert ("present_load of one servo" in without_gait(model)[0]) is asked
        assert ("a low gain" in without_gait(model)[0]) is asked
