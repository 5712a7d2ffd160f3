"""Causes of a whole robot from what a search found: chances, rivals, the next walk."""

from dataclasses import replace
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pytest
from walking_robots import believed, walked

from bench.diagnosis.joint.rivals import AS_GOOD, CLOSE, TEMPER
from bench.diagnosis.result import Cause, Rival
from bench.diagnosis.robot import next as walks
from bench.diagnosis.robot.causes import (
    ENDS_SHARE,
    ENGINES_SHARE,
    as_measured,
    cause_of,
    close_rivals,
    number_of,
)
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import APART_NATS, RobotGain, levelled
from bench.diagnosis.robot.limits import in_series
from bench.diagnosis.robot.next import HEAVIER, WATCH_S, menu

OWN = "foot_compliance@all"
NEAR, FAR, SAME = "joint_compliance@all", "backlash@tibia", "foot_compliance@leg1"
NATS = {OWN: 60.0, NEAR: 60.0 - APART_NATS - 0.5 * CLOSE, FAR: 10.0, SAME: 59.0}


def gain(name, nats):
    return RobotGain(name, RobotFit((name,), np.ones(1), {}, 0.0), nats, 1.0, None)


def found(alike=()):
    step = tuple(gain(name, nats) for name, nats in NATS.items())
    return SimpleNamespace(tried=(step,), taken=step[:1], alike={OWN: alike})


def search():
    model = SimpleNamespace(base=believed(), placed=placed_effects(believed()), nuisances=())
    spread = np.array([[0.01]])
    sight = SimpleNamespace(covariances=lambda fit: (spread, 4.0 * spread))
    return SimpleNamespace(model=model, sight=sight)


def cause(alike=()):
    told = found(alike)
    return cause_of(search(), told, told.taken[0], told.taken[0].fit, 0.8, 12.0)


def test_a_cause_has_its_place_and_an_interval_of_scatter_and_of_what_engines_differ_by():
    told = cause()
    knob = placed_effects(believed())[OWN].knob
    assert (told.effect, told.kind) == ("foot_compliance", "missing")
    assert told.scope == tuple(f"leg{n}" for n in range(1, 7))
    (estimate,) = told.parameters.values()
    assert estimate.value == pytest.approx(knob.value(1.0))
    deviation = np.hypot(2.0 * 0.1, ENGINES_SHARE)
    ends = sorted(knob.value(1.0 + side * 1.96 * deviation) for side in (-1, 1))
    assert estimate.ci95 == pytest.approx(ends)
    assert estimate.state == "pinned"


@pytest.mark.parametrize(
    ("name", "read", "wide"),
    [
        ("gain_error@all", (), True),
        ("gain_error@all", (RobotKind.VOLTAGE,), False),
        ("gain_error@all", (RobotKind.DUTY,), False),
        ("supply_voltage@all", (RobotKind.DUTY,), True),
        ("supply_voltage@all", (RobotKind.VOLTAGE,), False),
        ("joint_compliance@all", (), False),
    ],
)
def test_what_multiplies_all_torques_is_less_sure_where_no_register_shows_it(name, read, wide):
    made = search()
    made.model.floors = lambda: dict.fromkeys(read, 0.1)
    fit = SimpleNamespace(names=(name,), z=np.array([2.0]), nuisances=np.empty(0))
    told = number_of(made, fit, name)
    knob = placed_effects(believed())[name].knob
    knobs = np.hypot(2.0 * 0.1, 2.0 * ENGINES_SHARE)
    ends = sorted(knob.value(2.0 + side * 1.96 * knobs) for side in (-1, 1))
    if not wide:
        assert told.ci95 == pytest.approx(ends)
        return
    own, plain = 0.5 * np.subtract(*told.ci95[::-1]), 0.5 * np.subtract(*ends[::-1])
    assert own == pytest.approx(np.hypot(plain, 1.96 * ENDS_SHARE * told.value), rel=0.05)


def test_rivals_are_other_effects_that_came_close():
    (rival,) = cause().indistinguishable_from
    assert rival.effect == "joint_compliance"
    assert rival.behind_nats == pytest.approx(0.5 * CLOSE)
    assert 0.0 < rival.probability < cause().probability < 1.0


def test_what_looks_the_same_and_was_not_fitted_is_a_rival_too():
    effects = [r.effect for r in cause((("payload@all", 0.999),)).indistinguishable_from]
    assert effects == ["payload", "joint_compliance"]


@pytest.mark.parametrize(("nats", "ahead"), [(90.0, -2.5), (65.0, 0.0), (45.0, 0.0), (30.0, 2.5)])
def test_what_beginnings_make_of_fits_puts_none_ahead_of_another(nats, ahead):
    one = RobotGain(OWN, gain(OWN, 0.0).fit, 60.0, 4.0, None)
    assert APART_NATS == 20.0
    assert one.ahead_of(gain(FAR, nats)) == ahead


def test_what_looks_the_same_but_was_fitted_and_is_far_behind_is_none():
    effects = [r.effect for r in cause(((FAR, 0.999),)).indistinguishable_from]
    assert effects == ["joint_compliance"]


GROUND = "ground_compliance@all"


@pytest.mark.parametrize(
    ("own", "told"), [(0.25, 0.7), (0.575, 0.8), (0.9, 0.9), (0.96, 0.96), (1.0, 1.0), (0.1, 0.28)]
)
def test_a_probability_is_how_often_names_with_so_much_are_true_and_rivals_share_the_rest(
    own, told
):
    rivals = tuple(
        Rival(name, (), share * (1.0 - own), 1.0) for name, share in (("a", 0.5), ("b", 0.3))
    )
    found = as_measured(Cause("c", (), {}, 9.0, 0.5, own, rivals))
    assert found.probability == pytest.approx(told)
    shares = [rival.probability for rival in found.indistinguishable_from]
    assert shares == pytest.approx([0.5 * (1.0 - told), 0.3 * (1.0 - told)])


@pytest.mark.parametrize("names", [(OWN, GROUND), (GROUND, OWN)])
def test_springs_in_series_are_told_together_however_far_a_fit_prefers_one(names):
    step = tuple(gain(name, nats) for name, nats in zip(names, (600.0, 400.0), strict=True))
    told = SimpleNamespace(tried=(step,), taken=step[:1], alike={})
    one = cause_of(search(), told, step[0], step[0].fit, 0.8, 12.0)
    (rival,) = one.indistinguishable_from
    assert rival.effect == names[1].partition("@")[0]
    assert rival.behind_nats == AS_GOOD
    assert rival.probability == pytest.approx(np.exp(-TEMPER * AS_GOOD) * one.probability)
    assert close_rivals(search().model, told, step[0]) == []  # no experiment of ours tells them


def test_springs_in_series_are_told_where_both_may_be_named():
    step = (gain(OWN, 600.0), gain(FAR, 10.0))
    told = SimpleNamespace(tried=(step,), taken=step[:1], alike={})
    assert not cause_of(search(), told, step[0], step[0].fit, 0.8, 12.0).indistinguishable_from
    told.alike = {OWN: ((GROUND, 0.96),)}
    (rival,) = cause_of(search(), told, step[0], step[0].fit, 0.8, 12.0).indistinguishable_from
    assert (rival.effect, rival.behind_nats) == ("ground_compliance", AS_GOOD)


def test_the_tip_of_one_leg_is_no_ground():
    step = (gain(SAME, 600.0), gain(GROUND, 400.0))
    told = SimpleNamespace(tried=(step,), taken=step[:1], alike={})
    assert not cause_of(search(), told, step[0], step[0].fit, 0.8, 12.0).indistinguishable_from


def test_what_tells_springs_in_series_is_said_where_they_stand_beside_each_other():
    def named(*alike):
        step = (gain(OWN, 600.0), gain(NEAR, 600.0))
        told = SimpleNamespace(tried=(step,), taken=step[:1], alike={OWN: alike})
        return cause_of(search(), told, step[0], step[0].fit, 0.8, 12.0)

    assert "walk on another ground" in in_series([named(), named((GROUND, 0.96))])[0]
    assert in_series([named(), named()]) == ()
    assert in_series([]) == ()


def test_the_next_experiment_is_sought_against_rivals_that_were_fitted():
    told = found()
    rivals = close_rivals(search().model, told, told.taken[0])
    assert [rival.name for rival in rivals] == [NEAR]


def test_gains_of_a_step_are_divided_by_one_inflation():
    some = [gain(OWN, 20.0), gain(NEAR, 30.0)]
    some[0] = RobotGain(OWN, some[0].fit, 20.0, 1.0, None)
    some[1] = RobotGain(NEAR, some[1].fit, 30.0, 4.0, None)
    ordered = levelled(some)
    assert [g.name for g in ordered] == [NEAR, OWN]
    assert [g.inflation for g in ordered] == [pytest.approx(2.0)] * 2
    none_gains = [replace(one, nats=-one.nats) for one in some]
    assert [g.inflation for g in levelled(none_gains)] == [pytest.approx(2.0)] * 2
    assert [g.inflation for g in levelled(some, 1.5)] == [1.5] * 2
    assert [g.inflation for g in levelled(some, 2.5)] == [pytest.approx(2.0)] * 2


def test_the_menu_is_the_recorded_walk_heavier_held_watched_and_with_registers_read():
    features = [SimpleNamespace(course=walked())]
    choices = menu(SimpleNamespace(features=features, base=believed()))
    heavier, held, watched, sensed, read, loads = choices
    assert heavier.course.condition["trunk_load_kg"] == pytest.approx(
        HEAVIER * believed().mass_kg, abs=1e-3
    )
    assert held.course.condition["support"] == "suspended"
    assert watched.course.height is not None
    assert sensed.arguments == {"observe": "imu/roll_rad, imu/pitch_rad"}
    assert sensed.course.lean[1].shape == (len(watched.course.height[0]), 2)
    assert [c.course.lean is None for c in choices] == [c is not sensed for c in choices]
    assert read.course.voltage is not None
    assert read.arguments == {"read": "present_voltage"}
    assert loads.arguments == {"read": "present_load"}
    every = np.sort(np.concatenate([t_s for t_s, _ in loads.course.duty]))
    assert np.diff(every) == pytest.approx(WATCH_S)  # one servo after another
    assert len(loads.course.duty) == len(walked().sample_s)
    assert every[-1] <= walked().end_s
    assert all((c.course.events == walked().events).all() for c in choices)


def test_nobody_is_told_to_read_a_register_that_was_read():
    nothing = np.empty(0), np.empty(0)
    duty = (nothing, (np.arange(3.0), np.full(3, 0.1)), *[nothing] * 16)
    seen = replace(walked(), voltage=(np.arange(3.0), np.full(3, 7.4)), duty=duty)
    choices = menu(SimpleNamespace(features=[SimpleNamespace(course=seen)], base=believed()))
    assert sum("observe" in choice.arguments for choice in choices) == 2
    leant = replace(seen, height=(np.arange(3.0),) * 2, lean=(np.arange(3.0), np.zeros((3, 2))))
    others = menu(SimpleNamespace(features=[SimpleNamespace(course=leant)], base=believed()))
    assert not any("observe" in choice.arguments for choice in others)
    assert all(choice.course.lean is None for choice in others)
    assert not any("read" in choice.arguments for choice in choices)
    assert all(choice.course.voltage is seen.voltage for choice in choices)
    assert all(choice.course.duty is duty for choice in choices)


def test_walks_are_proposed_that_tell_a_name_from_rivals_that_follow_as_recordings_let_them(
    monkeypatch,
):
    """Six walks of two rows: joints can follow in the first, and no more where they are held."""
    apart = {NEAR: [(9.0, 0.0), (0.0, 2.0), *[(0.0, 0.0)] * 4], FAR: [(0.0, 6.0)] * 6}

    class Seen:
        def __init__(self, model, which, kinds):
            (self.r,) = which

        def linearised(self, names, z, noise):
            rows = apart[names[0]][self.r] if names[0] in apart else (0.0, 0.0)
            return np.array(rows), np.array([[1.0], [0.0]])

    class Imagined:
        def __init__(self, base, robot, courses):
            self.courses = courses

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    monkeypatch.setattr(walks, "RobotModel", Imagined)
    monkeypatch.setattr(walks, "Sight", Seen)
    monkeypatch.setattr(walks, "voltage_noise", lambda *_: None)
    model = SimpleNamespace(base=believed(), features=[SimpleNamespace(course=walked())])
    named, near, far = (RobotFit((n,), np.ones(1), {}, 0.0) for n in (OWN, NEAR, FAR))

    def proposed(spread, rivals, inflation=4.0):
        sight = SimpleNamespace(model=model, covariances=lambda _: (np.array([[spread]]), None))
        return walks.next_experiments(sight, None, named, rivals, inflation)

    free, *_ = proposed(1e9, {NEAR: near, FAR: far})
    assert free.arguments == {"support": "suspended"}  # there it cannot follow
    assert free.power == pytest.approx(NormalDist().cdf(0.5))  # two deviations, deflated
    assert free.separates == ("backlash", "foot_compliance", "joint_compliance")
    held, *_ = proposed(1e-9, {NEAR: near})
    assert "trunk_load_kg" in held.arguments
    assert held.power == pytest.approx(NormalDist().cdf(0.5 * 4.5))
    assert proposed(1.0, {}) == []
