"""How much joints shake: what play does that means over the phase do not show."""

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from walking_robots import believed, marvin, walked, walked_by

from bench.diagnosis.result import Cause
from bench.diagnosis.robot import rattling as robot_rattling
from bench.diagnosis.robot.features import Features
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import NEEDED, RobotGain
from bench.diagnosis.robot.limits import seldom
from bench.diagnosis.robot.rattling import (
    HUNTING,
    SHAKEN_APART_NATS,
    Rattling,
    Shaker,
    ShakingSearch,
    is_spring,
    told,
    worsened,
)
from bench.diagnosis.robot.replay import play
from bench.diagnosis.robot.search import RobotSearch
from bench.diagnosis.robot.shaking import ENGINES_SHAKING, Shaking, by_kind
from bench.diagnosis.robot.sought import SPRINGS
from bench.diagnosis.robot.steps import BESIDE, HELD_OUT, PROMISED
from sim.effects import effect

PLAY_RAD = math.radians(3.0)
JOINTS = [joint.name for joint in believed().joints]


@cache
def modelled():
    return Features.of(walked(), marvin()).of_track(play(believed(), walked())).shaken


def more(recorded):
    return by_kind(JOINTS, Features.of(recorded, marvin()).shaken - modelled())


def touched(change):
    return replace(walked(), position_rad=tuple(change(x) for x in walked().position_rad))


def test_teeth_with_play_shake_legs_that_swing():
    loose = effect("backlash").apply(believed(), (), {"width_rad": PLAY_RAD})
    found = more(walked_by(loose, 31))
    assert max(found, key=found.__getitem__) == "coxa swing"
    assert found["coxa swing"] > 5.0 * ENGINES_SHAKING
    assert found["tibia swing"] > found["tibia stance"]


def test_a_robot_as_believed_shakes_no_more():
    found = more(walked_by(believed(), 32))
    assert max(map(abs, found.values())) < ENGINES_SHAKING


def test_noise_of_a_sensor_is_within_what_engines_differ_by():
    """A quarter of a count, before angles are rounded."""
    random = np.random.default_rng(5)
    track, told_s = play(believed(), walked()), walked().sample_s
    quantum = walked().quantum_rad
    noisy = tuple(
        quantum * np.round(track.at(j, t) / quantum + 0.25 * random.standard_normal(len(t)))
        for j, t in enumerate(told_s)
    )
    found = more(replace(walked(), position_rad=noisy))
    assert 0.0 < np.mean(list(found.values())) < ENGINES_SHAKING


def test_wrong_packets_are_no_shaking():
    """One sample in 200 is anything."""
    random = np.random.default_rng(6)

    def glitched(angle):
        return np.where(random.random(len(angle)) < 0.005, angle + 0.5, angle)

    found, plain = more(touched(glitched)), more(walked())
    assert max(abs(found[kind] - plain[kind]) for kind in plain) < ENGINES_SHAKING


def test_samples_after_a_gap_are_left_out():
    """What a joint has moved while nobody looked is no shaking."""
    gaps = np.arange(len(walked().sample_s[0])) % 9 != 0
    kept = replace(
        walked(),
        sample_s=tuple(t[gaps] for t in walked().sample_s),
        wait_s=tuple(w[gaps] for w in walked().wait_s),
        position_rad=tuple(x[gaps] for x in walked().position_rad),
    )
    features = Features.of(kept, marvin())
    full = Features.of(walked(), marvin())
    assert sum(p.size - (p < 0).sum() for p in features.shaking.phase) < 0.8 * sum(
        p.size - (p < 0).sum() for p in full.shaking.phase
    )
    apart = by_kind(JOINTS, features.shaken - full.shaken)
    assert max(map(abs, apart.values())) < 2.0 * ENGINES_SHAKING


def test_joints_that_are_read_seldom_show_none():
    """Nine samples a second: what differs from one to the next is how the robot moves."""
    kept = replace(
        walked(),
        sample_s=tuple(t[::9] for t in walked().sample_s),
        wait_s=tuple(w[::9] for w in walked().wait_s),
        position_rad=tuple(x[::9] for x in walked().position_rad),
    )
    few = Features.of(kept, marvin())
    assert np.isnan(few.shaken).all()
    (said,) = seldom(SimpleNamespace(features=[few]))
    assert said.startswith(f"joints of {kept.name} were read ")
    assert "ms apart" in said
    assert seldom(SimpleNamespace(features=[Features.of(walked(), marvin())])) == ()


@pytest.mark.parametrize(("recorded_rad", "modelled_rad"), [(0.9, 0.1), (0.1, 0.9)])
def test_recorded_and_modelled_shaking_are_told_of_the_same_instants(recorded_rad, modelled_rad):
    """A wide motion is no wrong packet, and what a model makes of a row is a number if that is."""
    t = np.arange(0.0, 6.0, 0.04)
    turning = np.sin(2.0 * np.pi * 1.5 * t)
    every = np.ones(len(t), bool)
    shaking = Shaking.of((t,), (recorded_rad * turning,), (~every,), (every,), 0.001)
    recorded, modelled = (
        shaking.rows((size * turning,))[0] for size in (recorded_rad, modelled_rad)
    )
    assert np.isfinite(recorded) == np.isfinite(modelled) == (recorded_rad < modelled_rad)


OFF = RobotFit((), np.zeros(0), {}, 0.0)
NAMED = RobotFit(("payload@all",), np.ones(1), {}, 0.0)
LOOSE = RobotFit(("backlash@all",), np.full(1, 5.0), {}, 0.0)
FITS, JUDGES = (0, 1), (2,)


def rattling(monkeypatch, left, name="backlash"):
    """Of a search that takes an effect; ``left`` are nats by fit, and fitted or judging."""
    gain = SimpleNamespace(name=f"{name}@all", fit=LOOSE)
    found = SimpleNamespace(taken=(gain,), fit=LOOSE)
    model = SimpleNamespace(
        nuisances=(),
        placed={
            f"{one}@all": SimpleNamespace(effect=SimpleNamespace(name=one))
            for one in (name, "payload")
        },
        recentre=lambda *_: 0.0,
    )
    made = Rattling.__new__(Rattling)
    made.model, made.which, made.judges = model, FITS, JUDGES
    made.search = SimpleNamespace(
        run=lambda **_: found, sight=SimpleNamespace(fit=lambda: RobotFit((), np.zeros(0), {}, 0.0))
    )
    monkeypatch.setattr(Rattling, "left", lambda _, fit, which: left[fit is LOOSE, which])
    monkeypatch.setattr(
        robot_rattling,
        "cause_of",
        lambda search, found, gain, after, share, nats: Cause(gain.name, (), {}, nats, share, 1.0),
    )
    return made


def nats(fitted, judged, fitted_with=0.0, judged_with=0.0):
    before = {(False, FITS): fitted, (False, JUDGES): judged}
    return before | {(True, FITS): fitted_with, (True, JUDGES): judged_with}


def test_play_that_explains_shaking_is_named(monkeypatch):
    play = rattling(monkeypatch, nats(60.0, 40.0, 2.0, 4.0)).named(OFF)
    assert (play.cause.explained_share, play.cause.held_out_gain_nats) == (0.9, 36.0)  # of judges
    assert play.cause.shown_by == "how much joints shake"
    assert play.knob == 5.0


@pytest.mark.parametrize(
    ("left", "name"),
    [
        (nats(0.9 * NEEDED, 40.0), "backlash"),  # joints shake no more than engines differ
        (nats(60.0, 40.0, 55.0), "backlash"),  # what is named explains as much
        (nats(60.0, 40.0, 2.0, 40.0 - 0.9 * HELD_OUT), "backlash"),
        (nats(60.0, 40.0), "punch"),  # of which means over the phase say more
    ],
)
def test_what_shaking_does_not_show_is_not_named(monkeypatch, left, name):
    assert rattling(monkeypatch, left, name).named(OFF) is None


@pytest.mark.parametrize(
    ("after", "judged", "judged_with", "denied"),
    [
        (LOOSE, 1.0, 1.0 + 1.1 * NEEDED, True),
        (LOOSE, 1.0, 1.0 + 0.9 * NEEDED, False),
        (NAMED, 1.0, 99.0, False),  # no play was named
    ],
)
def test_joints_that_shake_less_than_with_play_deny_it(
    monkeypatch, after, judged, judged_with, denied
):
    made = rattling(monkeypatch, nats(0.0, judged, 0.0, judged_with))
    assert made.denies(after) is denied


@pytest.mark.parametrize(
    ("beside", "gained", "borne_out"),
    [
        ((), 1.1 * NEEDED, True),
        ((), 0.9 * NEEDED, False),
        (("payload@all",), 1.1 * BESIDE, True),
        (("payload@all",), 0.5 * (NEEDED + BESIDE), False),
    ],
)
def test_play_must_be_needed_beside_what_else_is_named(monkeypatch, beside, gained, borne_out):
    made = rattling(monkeypatch, {})
    loose = RobotFit((*LOOSE.names, *beside), np.ones(1 + len(beside)), {}, 0.0)
    left = {frozenset(loose.names): 3.0, frozenset(beside): 3.0 + gained}
    monkeypatch.setattr(Rattling, "left", lambda _, fit, which: left[frozenset(fit.names)])
    assert made.bears_out(loose) is borne_out


def test_springs_that_explain_shaking_are_named_where_they_are_asked_for(monkeypatch):
    left = nats(60.0, 40.0, 2.0, 4.0)
    springs = rattling(monkeypatch, left, HUNTING)
    assert springs.named(OFF) is None
    assert springs.named(OFF, asked=is_spring).cause.held_out_gain_nats == 36.0
    assert springs.search.asked is is_spring
    assert rattling(monkeypatch, left).named(OFF, asked=is_spring) is None


def test_samples_do_not_speak_against_what_shaking_has_named():
    cause, beside = (SimpleNamespace(effect=name) for name in (HUNTING, "payload"))
    fit = SimpleNamespace(before=0.004, after=0.006, noise_floor=0.002)
    shaker = Shaker(SimpleNamespace(name=f"{HUNTING}@all"), cause)
    assert worsened([cause], fit)
    assert not worsened([cause], fit, shaker)
    assert worsened([cause, beside], fit, shaker)


def test_where_joints_shake_for_no_reason_the_report_says_so():
    kinds = {"coxa stance": 0.1, "coxa swing": math.log(2.0), "tibia swing": -0.2}
    (sentence,) = told(None, 1.1 * NEEDED, 1.1 * NEEDED, kinds)
    assert "coxa joints shake 2.00 times as much" in sentence
    assert told(None, 0.9 * NEEDED, 0.9 * NEEDED, kinds) == ()
    for name, does in (("backlash", "legs rattle"), (HUNTING, "a robot hunts")):
        shaker = Shaker(SimpleNamespace(name=f"{name}@all"), SimpleNamespace(effect=name))
        (named,) = told(shaker, 1.1 * NEEDED, 12.0 * NEEDED, kinds)
        assert named.startswith(f"{name} was named by how much joints shake")
        assert f"when {does}" in named


def test_a_search_on_shaking_is_a_search_but_for_springs_and_whole_recordings():
    own = {name for name in vars(ShakingSearch) if not name.startswith("__")}
    assert own == {"asked", "_sought", "_step", "_most", "_from_far", "_whole_square"}
    assert all(callable(getattr(RobotSearch, name)) for name in own - {"asked"})
    search = object.__new__(ShakingSearch)
    search.sight = None
    assert search._sought(SPRINGS).at == {}


@pytest.mark.parametrize(
    ("play", "tried"), [(PROMISED * NEEDED, True), (1.9 * NEEDED, False), (0.9 * NEEDED, False)]
)
def test_where_play_is_not_of_what_promises_most_nothing_is_tried(monkeypatch, play, tried):
    names = ["backlash@all", *(f"other{k}@all" for k in range(PROMISED))]
    nats = [play, *((2.0 + k) * NEEDED for k in range(PROMISED))]
    if play < NEEDED:
        names, nats = names[:2], nats[:2]
    gains = [RobotGain(n, LOOSE, x, 1.0, None) for n, x in zip(names, nats, strict=True)]
    monkeypatch.setattr(RobotSearch, "_step", lambda *_: gains)
    search = object.__new__(ShakingSearch)
    assert [gain.name for gain in search._step([], LOOSE, 0)] == (names if tried else [])
    search.asked = is_spring
    assert search._step([], LOOSE, 0) == []


def test_fits_to_shaking_end_closer_to_each_other_than_fits_to_means(monkeypatch):
    gain = RobotGain("backlash@all", LOOSE, 60.0, 1.0, None)
    monkeypatch.setattr(RobotSearch, "_step", lambda *_: [gain])
    (own,) = object.__new__(ShakingSearch)._step([], LOOSE, 0)
    other = RobotGain("b@all", LOOSE, 50.0, 1.0, None)
    assert gain.ahead_of(other) == 0.0
    assert own.ahead_of(other) == 10.0 - SHAKEN_APART_NATS > 0.0
