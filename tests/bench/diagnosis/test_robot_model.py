from dataclasses import replace

import numpy as np
import pytest
from walking_robots import believed, but, marvin, walked_with

from bench.diagnosis.robot.curves import FARTHER, GRID, LARGER, LEAST_RAD
from bench.diagnosis.robot.effects import LEVELS
from bench.diagnosis.robot.exact import ExactFits
from bench.diagnosis.robot.features import MEANS, RobotKind
from bench.diagnosis.robot.fit import RobotFit, Sight
from bench.diagnosis.robot.gains import NEEDED
from bench.diagnosis.robot.model import RATTLES, RobotModel
from bench.diagnosis.robot.nuisances import replayable
from bench.diagnosis.robot.pool import Job
from bench.diagnosis.robot.screen import Screen
from bench.diagnosis.robot.shaking import ENGINES_SHAKING

#: recordings of one model: nulls, and one effect each
NULL, TIPS, SOFT = 0, 1, 2
TRUE_Z = {"foot_compliance@all": 3.0, "joint_compliance@all": 4.0}
TRIED = [
    "foot_compliance@all",
    "joint_compliance@all",
    "gain_error@femur",
    "backlash@tibia",
    "payload@all",
]


@pytest.fixture(scope="module")
def model():
    courses = [
        walked_with({}, 11),
        walked_with({"foot_compliance@all": 3.0}, 12),
        walked_with({"joint_compliance@all": 4.0}, 13),
    ]
    known = but("torque", "mass", "gain", "late", "sampling", "turn")
    with RobotModel(believed(), marvin(), courses, without=known, processes=1) as made:
        made.curves.prepare(TRIED, sorted(set(made.motion)))
        yield made


def base_fit(model, r):
    return Sight(model, [r], MEANS).fit()


def screened(model, r):
    found = base_fit(model, r)
    left = [
        {kind: model.recorded(q, kind) - rows for kind, rows in model.centre[q].items()}
        for q in range(len(model.features))
    ]
    return Screen(model, dict(found.noise), left, which=[r])


def test_a_curve_goes_farther_where_a_fit_has_come_to_its_end(model):
    name = "payload@all"
    end = GRID[-1] * model.curves.first_z(name)
    assert not model.curves.widen(name, 0.9 * end)
    assert model.curves.widen(name, end)
    assert not model.curves.widen(name, end)
    assert model.curves.widen(name, FARTHER * end)


def test_a_curve_ends_where_its_parameter_does(model):
    name = "ground_tilt.roll@all"
    high = model.placed[name].knob.bounds[1]
    while model.curves.widen(name, high):
        pass
    assert not model.curves.widen(name, high)
    assert model.curves.widen(name, 3.0 * -model.curves.first_z(name))


def test_a_first_try_that_moves_nothing_is_made_larger_and_others_are_not(model):
    moves, moves_nothing = "payload@all", "current_limit@coxa"
    before = model.curves.first_z(moves_nothing)
    rows = model.curves.trace_at(moves_nothing, before, 0)[RobotKind.JOINTS]
    assert np.sqrt(np.mean((before * rows) ** 2)) < LEAST_RAD
    model.curves.enlarge([moves, moves_nothing], [0])
    assert model.curves.first_z(moves_nothing) == LARGER * before
    assert model.curves.first_z(moves) == model.placed[moves].first_z


def test_a_limit_of_duty_is_screened_and_replayed_at_several_levels(model):
    name = "torque_limit@tibia"
    few = [1.0, *LEVELS["duty"]]
    model.curves.enlarge([name], [0])
    *first, large = model.curves.tries(name)
    assert first == few
    assert large == model.placed[name].knob.bounds[1]
    assert set(few) < set(model.curves._grid(name))
    caps = [model.placed[name].knob.value(z) for z in few]
    assert caps == pytest.approx([0.6, 0.5, 0.4, 0.3])


def test_what_has_one_sign_is_screened_at_a_large_size_too_and_the_better_is_told(model):
    name = "joint_compliance@all"
    first = model.curves.first_z(name)
    assert model.curves.tries(name) == [first, GRID[-1] * first]
    assert model.curves.tries("ground_tilt.roll@all") == [
        model.curves.first_z("ground_tilt.roll@all")
    ]
    screen = screened(model, SOFT)
    small, large = (screen._one(name, at) for at in model.curves.tries(name))
    told = screen.one(name)
    assert told.gain_nats == max(small.gain_nats, large.gain_nats)
    assert small.gain_nats != large.gain_nats
    assert told.floor_z == min(small.floor_z, large.floor_z)


def test_recordings_of_one_motion_share_their_replays(model):
    assert model.motion == (0, 0, 0)


def test_meanwhile_repeats_move_as_the_first_of_their_motion_does(model):
    zero, heavy = np.zeros(len(model.nuisances)), (("payload@all", 2.0),)
    model.recentre((), zero)
    begun = [rows[RobotKind.JOINTS] for rows in model.centre]
    model.curves.effects(NULL, heavy)
    count = model.replays.count
    with model.following():
        model.recentre(heavy, zero)
    assert model.replays.count == count + 1
    moved = [rows[RobotKind.JOINTS] - own for rows, own in zip(model.centre, begun, strict=True)]
    assert np.abs(moved[NULL]).max() > model.quantum_rad
    assert moved[TIPS] == pytest.approx(moved[NULL])
    model.recentre(heavy, zero)
    assert model.replays.count == count + len(model.features)
    exact = model.centre[TIPS][RobotKind.JOINTS] - begun[TIPS]
    assert np.std(exact - moved[TIPS]) < 0.2 * np.std(moved[TIPS])
    model.recentre((), zero)


def test_a_repeat_keeps_its_row_where_the_first_of_its_motion_has_none(model, monkeypatch):
    """One joint shook by damaged packets alone in the first, and so nobody asks how it did."""
    zero, heavy, row = np.zeros(len(model.nuisances)), (("payload@all", 2.0),), 5
    model.recentre((), zero)
    begun = [rows[RobotKind.SHAKING].copy() for rows in model.centre]
    run = model._run

    def without_a_row(jobs):
        found = run(jobs)
        lost = [rows[RobotKind.SHAKING].copy() for rows in found]
        for shaken in lost:
            shaken[row] = np.nan
        return [rows | {RobotKind.SHAKING: own} for rows, own in zip(found, lost, strict=True)]

    monkeypatch.setattr(model, "_run", without_a_row)
    with model.following():
        model.recentre(heavy, zero)
    assert np.isnan(model.centre[NULL][RobotKind.SHAKING][row])
    assert np.isfinite(model.centre[TIPS][RobotKind.SHAKING]).all()
    assert model.centre[TIPS][RobotKind.SHAKING][row] == begun[TIPS][row]
    monkeypatch.undo()
    model.recentre((), zero)


@pytest.mark.parametrize(("which", "run"), [([NULL], 2), ([NULL, TIPS], 0)])
def test_robots_are_replayed_beside_each_other_where_a_process_would_wait(
    model, monkeypatch, which, run
):
    zero = np.zeros(len(model.nuisances))
    some = [((("payload@all", 1.0 + 0.1 * k + 0.01 * len(which)),), zero) for k in range(2)]
    count = model.replays.count
    model.ahead(some, which)
    assert model.replays.count == count  # one process never waits
    monkeypatch.setattr(model.replays, "processes", 2)
    model.ahead(some, which)
    assert model.replays.count == count + run
    for settings, z in some:
        model.recentre(settings, z, which)
    assert model.replays.count == count + 2 * len(which)
    model.recentre((), zero)


def test_what_a_later_reading_does_is_known_of_each_recordings_own_replay(model):
    zero, heavy = np.zeros(len(model.nuisances)), (("payload@all", 2.0),)
    names = [n.name for n in model.nuisances]
    for settings in (heavy, ()):
        model.recentre(settings, zero)
        own = model.replays.run([Job(r, settings) for r in range(len(model.features))])
        for name, rows in (
            ("sampling", [one.speed_rad_s for one in own]),
            ("turn", [one.turn_rad for one in own]),
        ):
            k = names.index(name)
            for traces, expected in zip(model.traces, rows, strict=True):
                moved = traces[RobotKind.JOINTS][:, k] / model.nuisances[k].deviation
                assert moved == pytest.approx(np.nan_to_num(expected))


def test_another_walk_is_no_repeat(model):
    first = model.features[NULL]
    other = replace(first, goal_rad=first.goal_rad + 0.05)
    assert first.like(other)
    assert not first.repeats(other)
    assert first.repeats(model.features[TIPS])


def test_a_robot_as_believed_is_consistent(model):
    assert max(one.gain_nats for one in screened(model, NULL).rank(TRIED)) < NEEDED


@pytest.mark.parametrize(
    ("r", "name"), [(TIPS, "foot_compliance@all"), (SOFT, "joint_compliance@all")]
)
def test_an_effect_gains_the_most_under_its_own_name(model, r, name):
    ranking = screened(model, r).rank(TRIED)
    assert ranking[0].name == name
    assert ranking[0].gain_nats > NEEDED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("r", "name"), [(TIPS, "foot_compliance@all"), (SOFT, "joint_compliance@all")]
)
def test_a_fit_finds_the_size_of_an_effect(model, r, name):
    """By exact replays it is as likely as the true robot, which has no tolerances."""
    exact = ExactFits(model, [r], MEANS)
    found = exact.thoroughly((name,), np.ones(1))
    true = np.append(np.zeros(len(model.nuisances)), TRUE_Z[name])
    truth = exact.replayed(RobotFit((name,), true, found.noise, np.inf))
    model.recentre((), np.zeros(len(model.nuisances)))
    model.retrace((), np.zeros(len(model.nuisances)))
    assert found.z[-1] == pytest.approx(TRUE_Z[name], rel=0.25)
    assert found.cost < truth.cost + NEEDED


def test_effects_that_look_alike_are_told_and_others_are_not(model):
    screen = screened(model, NULL)
    assert screen.cosine("joint_compliance@all", "joint_compliance@all") == pytest.approx(1.0)
    assert abs(screen.cosine("joint_compliance@all", "foot_compliance@all")) < 0.95
    assert screen.alike("gain_error@femur", TRIED) == []


def test_without_knobs_the_residual_is_recorded_less_replayed(model):
    blocks = model.residuals((), np.zeros(len(model.nuisances)), [NULL])
    block = blocks[NULL, RobotKind.JOINTS]
    plain = model.recorded(NULL, RobotKind.JOINTS) - model.centre[NULL][RobotKind.JOINTS]
    assert (block.value == plain).all()
    assert (np.diff(block.t_s) > 0.0).all()
    assert (block.extra > 0.0).all()


def test_where_legs_rattle_means_of_some_replays_count(model):
    loose = (("backlash@tibia", GRID[-1] * model.curves.first_z("backlash@tibia")),)
    (rows,) = model._run([Job(0, loose, short=True)])
    every = model.replays.run([Job(0, loose, jitter=j, short=True) for j in range(RATTLES)])
    assert (rows[RobotKind.JOINTS] == np.mean([one.angle_rad for one in every], axis=0)).all()
    assert np.ptp([one.angle_rad for one in every], axis=0).max() > model.quantum_rad
    (sound,) = model._run([Job(0, (("payload@all", 1.0),), short=True)])
    (one,) = model.replays.run([Job(0, (("payload@all", 1.0),), short=True)])
    assert (sound[RobotKind.JOINTS] == one.angle_rad).all()


@pytest.mark.parametrize("which", [[NULL], [NULL, TIPS, SOFT]])
def test_all_recordings_and_legs_tell_once_what_shaking_engines_differ_by(model, which):
    sight = Sight(model, which, (RobotKind.SHAKING,))
    zero = np.zeros(len(model.nuisances))
    noise = sight.noise(sight.blocks((), zero))[RobotKind.SHAKING]
    assert noise.total == pytest.approx(ENGINES_SHAKING * np.sqrt(len(which) * 6))


def test_tolerances_shake_nothing(model):
    assert not any(traces[RobotKind.SHAKING].any() for traces in model.traces)


def joints_of(traces):
    return [rows[RobotKind.JOINTS] for rows in traces]


@pytest.mark.slow
def test_what_nuisances_do_is_taken_where_a_fit_has_led(model):
    zero = np.zeros(len(model.nuisances))
    model.retrace((), zero)
    first = joints_of(model.traces)
    heavy = (("payload@all", 8.0),)
    model.retrace(heavy, zero)
    there = joints_of(model.traces)
    model.retrace((*heavy, ("backlash@tibia", 1.0)), zero)
    loose = joints_of(model.traces)
    assert all((a == b).all() for a, b in zip(loose, there, strict=True))
    model.retrace((), zero)
    back = joints_of(model.traces)
    assert all((a == b).all() for a, b in zip(back, first, strict=True))
    # robots with tolerances and such a weight: what those do there foretells them better
    random = np.random.default_rng(8)
    low, high = np.array([n.ends for n in model.nuisances if n.trial and not n.joint]).T
    some = np.zeros((6, len(zero)))
    some[:, whole_robots(model)] = np.clip(0.5 * random.standard_normal((6, len(low))), low, high)
    some = [replayable(model.nuisances, z) for z in some]
    jobs = [Job(model.like[NULL], heavy, nuisances=tuple(z.tolist()), short=True) for z in some]
    rows = np.array(joints_of(model._run(jobs)))
    left = []
    for traces in (there[NULL], first[NULL]):
        apart = rows - [traces @ z for z in some]
        left.append(np.std(apart - apart.mean(axis=0)))
    assert left[0] < 0.8 * left[1]
    assert left[0] < 0.6 * np.std(rows - rows.mean(axis=0))


def whole_robots(model):
    """Nuisances that replays show, of no joint alone."""
    return np.array([bool(n.trial) and not n.joint for n in model.nuisances])


def test_where_what_nuisances_do_is_asked_so_is_what_knobs_do_but_for_play(model, monkeypatch):
    asked, traces = [], model.traces
    monkeypatch.setattr(model, "_traces", lambda *_: traces)
    monkeypatch.setattr(model.curves, "bend", lambda *told: asked.append(told))
    heavy, loose = ("payload@all", 2.0), ("backlash@tibia", 1.0)
    z = np.full(len(model.nuisances), 0.5)
    able = tuple(replayable(model.nuisances, z).tolist())
    model.retrace((heavy, loose), z)
    model.retrace((heavy,), 0.0 * z)
    assert asked == [((heavy,), able, [0]), ((heavy,), (), [0])]
    monkeypatch.setattr(model, "_traces", None)  # where a fit begins they stay as they are
    model.bend((heavy, loose), z)
    assert asked[2:] == asked[:1]
