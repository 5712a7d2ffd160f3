"""What shows as a robot stands up and hardly as it walks: sources that give way, feet that slip."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from walking_robots import believed, but, marvin, recorded_walk, walked, walked_by

from bench.diagnosis.robot import rising as robot_rising
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import Features
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gait import WINDOW_S
from bench.diagnosis.robot.model import RobotModel
from bench.diagnosis.robot.nuisances import nuisances
from bench.diagnosis.robot.pool import Job, Replays
from bench.diagnosis.robot.replay import course, play
from bench.diagnosis.robot.rise import LONGEST_S, Rise
from bench.diagnosis.robot.rising import Rising, Sized, at_best, peak, risen
from bench.diagnosis.robot.search import RobotSearch
from bench.diagnosis.robot.steps import BESIDE, HELD_OUT
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import read_model

SAG, SLIP = "voltage_sag@all", "foot_slip@all"
QUANTUM_RAD = 0.005


@pytest.fixture(scope="module")
def features():
    return Features.of(walked(), marvin())


SEEN_S = np.arange(0.0, 9.0, 0.02)


def walks_from(begins_s, sample_s=(SEEN_S,)):
    phase = SimpleNamespace(t_s=np.array([0.0, begins_s]), cycles=np.array([np.nan, 0.0]))
    course = SimpleNamespace(sample_s=sample_s, position_rad=[2.0 * t for t in sample_s])
    return SimpleNamespace(phase=phase, course=course)


# --- windows


def test_windows_are_means_until_a_robot_walks():
    rise = Rise.of(walks_from(2.1))
    assert rise.end_s == 2.0
    t_s = np.arange(0.0, 2.0, 0.02)
    windows = [t_s[(t_s >= a) & (t_s < a + WINDOW_S)] for a in np.arange(0.0, 2.0, WINDOW_S)]
    inner = slice(0, -1)  # the last one has the sample at its end
    assert rise.recorded[inner] == pytest.approx([2.0 * w.mean() for w in windows][inner])
    assert rise.t_s == pytest.approx((np.arange(8) + 0.5) * WINDOW_S)


def test_of_a_long_wait_only_the_beginning_is_compared():
    assert Rise.of(walks_from(7.0)).end_s == LONGEST_S


@pytest.mark.parametrize("seen", [walks_from(0.9), SimpleNamespace(phase=None)])
def test_a_robot_that_walks_at_once_or_never_does_not_rise(seen):
    assert Rise.of(seen) is None


def test_a_joint_that_nobody_read_has_no_windows():
    seen = (SEEN_S, np.empty(0))
    told = Rise.of(walks_from(2.1, seen)).recorded.reshape(2, -1)
    assert np.isfinite(told[0]).all()
    assert np.isnan(told[1]).all()


def test_a_replay_of_the_rise_alone_is_the_beginning_of_a_whole_one(features):
    rise = Rise.of(features)
    assert rise.end_s >= 1.0
    whole = play(believed(), features.course)
    told = rise.rows([whole.at(j, t) for j, t in enumerate(rise.sample_s)])
    with Replays(marvin(), [features], (), processes=1) as replays:
        (alone,) = replays.run([Job(0, rise=True)])
    assert alone.risen_rad == pytest.approx(told, abs=1e-12, nan_ok=True)
    assert alone.angle_rad.size == 0


@pytest.mark.parametrize(("likes", "size"), [(1.0, 2.0), (0.86, 1.72), (0.93, 1.86), (2.0, 2.2)])
def test_a_size_is_what_judges_like_best_as_far_as_engines_differ(monkeypatch, likes, size):
    search = search_on(replayed=None)
    search.replayed = lambda fit: replace(fit, cost=3.0)
    rising = Rising(search, [0], [1], lambda _: None)
    most = 2.0 * likes
    monkeypatch.setattr(rising, "_cost", lambda fit, which: abs(fit.z[-1] - most) + which[0])
    found = RobotFit((SAG,), np.array([0.5, 2.0]), {}, 5.0)
    best, cost = rising._resized(found)
    assert best.z == pytest.approx([0.5, size])
    assert cost == pytest.approx(1.0 + abs(size - most))
    assert (best is found) is (likes == 1.0)
    assert best.cost == (5.0 if likes == 1.0 else 3.0)


@pytest.mark.parametrize(("outside", "left", "sized", "named"), [
    (HELD_OUT + 0.1, 0.0, 0, True),
    (HELD_OUT - 0.1, 399.0 - HELD_OUT, 1, True),
    (HELD_OUT - 0.1, 401.0 - HELD_OUT, 1, False),
])  # fmt: skip
def test_other_sizes_are_asked_where_judges_are_no_better(monkeypatch, outside, left, sized, named):
    asks = []
    monkeypatch.setattr(Rising, "_resized", lambda _, found: asks.append(found) or (found, left))
    _, found = asked(monkeypatch, [of(SAG, 60.0)], outside=outside)
    assert len(asks) == sized
    assert (found is not None) is named


# --- which names are given


def search_on(**more):
    every = placed_effects(believed())
    model = SimpleNamespace(
        base=believed(),
        nuisances=nuisances(believed(), QUANTUM_RAD),
        placed=every,
        features=[walks_from(2.1)] * 2,
        **more,
    )
    sight = SimpleNamespace(held={}, box=lambda names: (np.zeros(2), np.array([9.0, 2.2])))
    return SimpleNamespace(
        model=model,
        sight=sight,
        fitted=lambda names, z, _: RobotFit(names, z, {}, 5.0),
        settle=lambda fit: fit,
        around=lambda _: None,
    )


AFTER = RobotFit((), np.zeros(1), {}, 10.0)


def asked(monkeypatch, sized, *, nats=100.0, outside=50.0, without=()):
    """What is named where windows say ``sized``, and exact replays so much."""
    plain = Sized("", 0.0, np.zeros(1))
    stand = SimpleNamespace(
        plain=plain,
        sized=lambda names: [one for one in sized if one.name in names],
        fit=lambda one: RobotFit((one.name,), one.z, {}, 10.0),
    )
    monkeypatch.setattr(robot_rising, "_Stand", lambda *_: stand)
    rising = Rising(search_on(), [0], [1], lambda _: None)
    costs = {("", 0): 500.0, ("", 1): 400.0}
    there = {0: 500.0 - nats, 1: 400.0 - outside}
    monkeypatch.setattr(
        rising, "_cost", lambda fit, which: costs.get((fit.names[0], which[0]), there[which[0]])
    )
    return rising, rising.named(AFTER, without)


def of(name, nats, knob=1.0):
    return Sized(name, nats, np.array([0.0, knob]))


def test_what_explains_most_of_it_is_named_with_its_size_and_the_gait_is_fitted_beside_it(
    monkeypatch,
):
    every = [of(SAG, 60.0), of("supply_voltage@all", 57.0), of("payload@all", 3.0)]
    rising, found = asked(monkeypatch, every)
    value = rising.model.placed[SAG].knob.value(1.0)
    number = found.cause.parameters["resistance_ohm"]
    assert (found.cause.effect, number.value) == ("voltage_sag", value)
    assert number.ci95[0] < value < number.ci95[1]
    assert [rival.effect for rival in found.cause.indistinguishable_from] == ["supply_voltage"]
    assert found.cause.held_out_gain_nats == 50.0
    noise = 0.5 * 8.0  # nats of so many windows
    assert found.cause.explained_share == pytest.approx(50.0 / (400.0 - noise))
    assert found.gain.fit.settings == ((SAG, 1.0),)
    assert found.gain.fit.cost == 5.0  # fitted again, and better
    assert rising.search.sight.held == {SAG: 1.0}
    assert found.cause.shown_by == "how the robot stands up"
    assert "stands up" in risen(found)[0]
    assert risen(None) == ()


@pytest.mark.parametrize(
    ("sized", "more"),
    [
        ([], {}),
        ([of("gain_error@all", 90.0), of(SAG, 60.0)], {}),  # of that the gait says more
        ([of(SAG, BESIDE - 0.1)], {}),
        ([of(SAG, 60.0)], {"nats": BESIDE - 0.1}),
        ([of(SAG, 60.0)], {"outside": HELD_OUT - 0.1}),
        ([of(SAG, 60.0)], {"without": ("voltage_sag",)}),
        ([of(SLIP, 60.0, 0.3)], {}),  # no less friction than that of another floor
    ],
)
def test_what_is_nothing_of_the_kind_or_too_little_has_no_name(monkeypatch, sized, more):
    _, found = asked(monkeypatch, sized, **more)
    assert found is None


def test_feet_that_slip_more_than_on_another_floor_have_a_name(monkeypatch):
    _, found = asked(monkeypatch, [of(SLIP, 60.0, 1.6)])
    assert found.cause.effect == "foot_slip"


def test_a_size_is_at_the_peak_of_what_it_gains():
    gains = [of(SAG, 50.0 - 100.0 * (knob - 0.87) ** 2, knob) for knob in (1.2, 0.6, 0.8, 1.0)]
    assert peak(gains) == pytest.approx(0.87)
    assert peak(gains[:3:2]) == 0.8  # at an end that one
    others = [of(SLIP, 49.0), of(SLIP, 60.0, 2.0)]
    assert [(one.name, one.knob) for one in at_best([*gains, *others])] == [(SLIP, 2.0), (SAG, 0.8)]


def test_where_nobody_stands_up_nothing_is_asked():
    search = search_on()
    search.model.features = [SimpleNamespace(phase=None)] * 2
    assert Rising(search, [0], [1], lambda _: None).named(AFTER) is None


# --- on replays


def phantomx(ohm):
    """Two walks of a PhantomX whose source has so much more resistance, and a model of it."""
    robot = load_robot("phantomx")
    base = read_model(robot)
    told = course(recorded_walk("phantomx"), robot)
    weak = effect("voltage_sag").apply(base, (), {"resistance_ohm": ohm}) if ohm else base
    courses = [walked_by(weak, seed, told) for seed in (3, 4)]
    known = but("supply", "gain", "motors", "gears")
    return RobotModel(base, robot, courses, without=known, processes=1)


@pytest.mark.slow
@pytest.mark.parametrize("ohm", [0.3, 0.0])
def test_a_source_that_gives_way_is_found_by_how_a_robot_stands_up(ohm):
    with phantomx(ohm) as model:
        search = RobotSearch(model, [0])
        found = Rising(search, [0], [1], lambda _: None).named(search.sight.fit())
    assert (found is not None) == (ohm > 0.0)
    if found is not None:
        assert found.cause.effect == "voltage_sag"
        number = found.cause.parameters["resistance_ohm"]
        low, high = number.ci95
        assert low < ohm < high < 2.0 * low
