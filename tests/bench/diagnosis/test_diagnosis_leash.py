"""Joints that hunt: replays on a leash, and what is named by them."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import CONDITION, JOINT, MOTIONS, POSITION, logs, model_of, robot

from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.fit import fit
from bench.diagnosis.joint.leash import LEASH_RAD_S, path
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.remaining import block_rms
from bench.diagnosis.joint.settling import Settled
from bench.diagnosis.joint.views import View, Views
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import Channel, observe
from bench.diagnosis.watch import Watch
from sim.effects import effect
from sim.model import read_model
from sim.stepped import TICK_S

WIDTH_RAD = 0.05
PLAY = {"backlash": {"width_rad": WIDTH_RAD}}
#: a weight near the axis, play, and a gain five times the factory's: the arm swings at every stop
HUNTING = {
    "condition": CONDITION | {"payload_at_m": 0.02},
    "settings": {"position_p_gain": 2000},
    "registers": (POSITION,),
    "pace_s": 0.005,
}


def hunting(truth=None, **more):
    return logs(truth or PLAY, sprung=True, **(HUNTING | more))


def left_mrad(model, width_rad):
    """What play of a width leaves of recordings, all else as believed."""
    knobs = effect_knobs(effect("backlash"))
    z = np.append(np.zeros(len(model.nuisances)), knobs[0].at(width_rad))
    return 1e3 * block_rms(model.residuals(Hypothesis(knobs), [z])[0], Kind.POSITION)


def test_a_path_is_what_was_recorded_at_every_tick_and_how_fast_it_went():
    (one,) = observe(logs(motions=("fast",)), robot(), JOINT)
    way = path(one)
    t_s = np.arange(len(way)) * TICK_S
    assert t_s[-1] >= one.replay.end_s
    good = one.position.good
    shown = np.interp(t_s, one.position.t_s[good], one.position.value[good])
    assert way[:, 0] == pytest.approx(shown, abs=0.01)
    speed = np.gradient(way[:, 0], TICK_S)
    assert way[1:-1, 1] == pytest.approx(speed[1:-1], abs=0.02 * np.abs(speed).max())


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_samples_and_two_of_one_instant_have_a_path_as_well(count):
    (one,) = observe(logs(motions=("fast",)), robot(), JOINT)
    good = np.flatnonzero(one.position.good)[: count + 1]
    t_s = one.position.t_s[good]
    t_s[-1] = t_s[-2]
    few = replace(
        one.position, t_s=t_s, value=one.position.value[good], good=np.ones(len(good), bool)
    )
    way = path(replace(one, channels=dict(one.channels) | {Channel.POSITION: few}))
    assert np.isfinite(way).all()
    assert way[0, 0] == pytest.approx(few.value[0])


def test_a_leash_pulls_at_nothing_where_nothing_is_missing():
    """For two seconds: later the last digit of a width may take two free replays apart."""
    model = model_of(hunting(duration_s=2.0))
    free, led = (left_mrad(m, WIDTH_RAD) for m in (model, model.led(LEASH_RAD_S)))
    assert free < 0.6
    assert led < 1.5  # between samples nobody knows the way


def test_a_size_that_is_a_little_off_is_near_on_a_leash_and_lost_without():
    model = model_of(hunting())
    without, free, led = (
        left_mrad(model, 0.0),
        left_mrad(model, 1.1 * WIDTH_RAD),
        left_mrad(model.led(LEASH_RAD_S), 1.1 * WIDTH_RAD),
    )
    assert free > without  # samples compared one by one say that play is wrong
    assert led < 0.4 * free


def test_a_leash_goes_along_to_other_recordings_and_can_be_let_go():
    model = model_of(hunting(motions=("slow",))).led(LEASH_RAD_S)
    assert model.of(model.observed).leash_rad_s == LEASH_RAD_S
    assert model.led(0.0).leash_rad_s == 0.0
    assert model.key != model.led(0.0).key


@pytest.mark.parametrize(
    ("recordings", "hunts"),
    [(hunting, True), (lambda: logs({"gain_error": {"scale": 0.7}}), False)],
)
def test_a_joint_hunts_if_a_cause_follows_it_on_a_leash_and_loses_its_way_without(
    recordings, hunts
):
    """Not one whose cause follows it without a leash as well."""
    names = ("backlash", "gain_error")
    model = model_of(recordings())
    led = model.led(LEASH_RAD_S)
    before = fit(led, Hypothesis(), np.zeros(len(led.nuisances)), rounds=2)
    effects = {name: effect(name) for name in names}
    views = Views(read_model(robot()), robot(), effects, None, None, Watch(print))
    assert views._hunts(model, led, before) is hunts


@pytest.mark.slow
def test_play_of_a_joint_that_hunts_is_named_with_its_size():
    observed = observe(hunting(), robot(), JOINT)
    effects = {n: effect(n) for n in ("backlash", "coulomb_friction", "joint_compliance")}
    found = diagnose_joint(read_model(robot()), robot(), observed, effects=effects).diagnosis
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.effect == "backlash"
    assert cause.parameters["width_rad"].value == pytest.approx(WIDTH_RAD, rel=0.05)


def repeated(*widths_rad, motions=tuple(MOTIONS)):
    """Repeats of motions whose swings fall out of step, as play is a little more each time."""
    return [
        replace(one, name=f"{one.name}-{k}")
        for k, width_rad in enumerate(widths_rad)
        for one in observe(
            hunting({"backlash": {"width_rad": width_rad}}, motions=motions), robot(), JOINT
        )
    ]


def as_believed(observed):
    """A view of recordings in which nothing was found, and nothing is left but what is noise."""
    model = JointModel(read_model(robot()), robot(), observed, sprung=True)
    nothing = fit(model, Hypothesis(), np.zeros(len(model.nuisances)), rounds=1)
    settled = Settled(nothing, (), (), {}, (), 0.0)
    view = View(model, nothing, model, {}, 0.0, {}, settled)
    view.__dict__["structured"] = False
    return view


@pytest.mark.parametrize(("widths_rad", "asked"), [((0.05, 0.0515), True), ((0.05, 0.05), False)])
def test_where_repeats_differ_and_nothing_is_left_a_leash_is_asked(monkeypatch, widths_rad, asked):
    free, led = as_believed(repeated(*widths_rad, motions=("slow", "fast"))), object()
    assert free.restless is asked
    monkeypatch.setattr(Views, "_free", lambda self, observed, judged: free)
    monkeypatch.setattr(Views, "_led", lambda self, view: led)
    views = Views(read_model(robot()), robot(), {}, None, None, Watch(print))
    assert views.look((), ()) is (led if asked else free)


@pytest.mark.slow
def test_play_that_makes_repeats_differ_is_no_noise():
    effects = {n: effect(n) for n in ("backlash", "coulomb_friction", "joint_compliance")}
    observed = repeated(WIDTH_RAD, 1.03 * WIDTH_RAD)
    found = diagnose_joint(read_model(robot()), robot(), observed, effects=effects).diagnosis
    (cause,) = found.causes
    assert cause.effect == "backlash"
    assert cause.parameters["width_rad"].value == pytest.approx(WIDTH_RAD, rel=0.05)
    assert found.fit.after < 0.25 * found.fit.before
    assert found.fit.noise_floor < found.fit.after
