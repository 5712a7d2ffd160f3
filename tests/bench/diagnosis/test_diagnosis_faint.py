"""How much a name must change, on squares that are given."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import logs, model_of

from bench.diagnosis.joint.diagnosis import channels_of, far_off
from bench.diagnosis.joint.faint import (
    BY_CHANCE,
    ONCE,
    READ,
    SHARE,
    SHARED,
    SURE_ONCE,
    SURE_SHARED,
    SURELY,
    changes_little,
    contradicted,
    faint,
    group_squares,
    strained,
    within_ticks,
)
from bench.diagnosis.joint.fit import Fit
from bench.diagnosis.joint.floor import engines_rad
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.nuisances import FARTHEST, WITHIN
from bench.diagnosis.joint.remaining import while_driven
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.noise import Block, Noise
from bench.diagnosis.observed import Channel
from sim.drive import fields
from sim.effects import effect

FLOOR, NOISE = 1e-3, 1e-6


@pytest.mark.parametrize(
    ("positions", "duty", "much", "expected"),
    [
        ([1.1 * ONCE, 0.0], 0.0, 0.0, False),
        ([0.9 * ONCE, 0.9 * ONCE], 0.0, 0.0, True),  # nowhere much more than engines differ by
        ([1.1 * ONCE, *[0.0] * 9], 0.0, 0.0, True),  # in one motion of ten alone
        ([1.1 * SHARED * 10, *[0.0] * 9], 0.0, 0.0, False),  # the same, but there it is much
        ([0.0, 0.0], 1.1 * READ, 0.0, False),  # the controller's own register shows it
        ([0.0, 0.0], 0.9 * READ, 0.0, True),
        ([0.0, 0.0], 1.1 * READ, 1.1 * READ / SHARE, True),  # little of what that leaves anyway
    ],
    ids=["seen", "engines", "one motion", "much in one", "duty", "faint duty", "little of it"],
)
def test_a_name_that_changes_less_than_engines_differ_by_is_none(positions, duty, much, expected):
    before = {
        Kind.POSITION: [NOISE * (p + 1.0) for p in positions],
        Kind.DUTY: [1e-4, (duty + much + 1.0) * 1e-4],
    }
    now = {
        Kind.POSITION: [NOISE for _ in positions],
        Kind.DUTY: [1e-4, (much + 1.0) * 1e-4],
    }
    assert faint(before, now, NOISE, {Kind.POSITION: FLOOR, Kind.DUTY: 1e-2}) == expected


@pytest.mark.parametrize(("nats", "named"), [(0.9 * SURELY, False), (1.1 * SURELY, True)])
@pytest.mark.parametrize(("share", "there"), [(1.2, True), (0.8, False)])
def test_a_name_that_is_sure_may_leave_a_small_trace(share, there, nats, named, monkeypatch):
    """Not none: what gains without any trace is noise that was estimated otherwise."""
    model = model_of(logs(motions=["slow"]))
    engines = engines_rad(model) ** 2
    falls = np.array([SURE_ONCE, SURE_SHARED * 3.0 - SURE_ONCE, 0.0]) * share * engines
    squares = {"without": 3e-6 + falls, "with": 3e-6 + 0.0 * falls}
    monkeypatch.setattr(
        "bench.diagnosis.joint.faint.group_squares",
        lambda _, found: {Kind.POSITION: squares[found]},
    )
    monkeypatch.setattr("bench.diagnosis.joint.faint.within_ticks", lambda *_: False)
    monkeypatch.setattr("bench.diagnosis.joint.faint.strained", lambda *_: False)
    monkeypatch.setattr("bench.diagnosis.joint.faint.contradicted", lambda *_: False)
    assert changes_little([model], "without", "with", "punch", nats) is not (named and there)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("read_skew", -0.0018, True),
        ("read_skew", 0.0026, False),
        ("transport_delay", 0.0024, True),
        ("dead_zone", 0.0001, False),  # no time at all
        ("thermal_derating", 0.0005, False),  # its time only shapes it
    ],
)
def test_a_time_that_ticks_may_make_is_no_name(name, value, expected):
    knobs = effect_knobs(effect(name))
    z = np.append(np.zeros(2), [knobs[0].at(value), *[0.0] * (len(knobs) - 1)])
    assert within_ticks(Fit(Hypothesis(knobs), z, {}, 0.0), 2, name) is expected


def test_what_takes_a_strain_off_tolerances_is_no_faint_name(monkeypatch):
    """Recordings are followed as well without it, but only by tolerances that nobody believes."""
    model = model_of(logs(motions=("slow",), duration_s=0.3))
    ends = np.array([n.ends[1] for n in model.nuisances])
    idle = np.array([n.name in model.idle(Hypothesis()) for n in model.nuisances])
    far, usual = np.where(idle, 0.0, 0.9 * ends), np.where(idle, 0.0, 0.2 * ends)
    knobs = effect_knobs(effect("gain_error"))
    noise = {kind: Noise(1e-3, 0.0, 0.1) for kind in Kind}
    stretched, eased = (Fit(Hypothesis(), z, noise, 0.0) for z in (far, usual))
    named, named_far = (Fit(Hypothesis(knobs), np.append(z, 0.0), noise, 0.0) for z in (usual, far))
    assert strained(model, stretched)
    assert not strained(model, eased)
    monkeypatch.setattr("bench.diagnosis.joint.faint.hardly_better", lambda *_, sure: True)
    assert not changes_little([model], stretched, named, "gain_error")
    assert changes_little([model], eased, named, "gain_error")
    assert changes_little([model], stretched, named_far, "gain_error")


@pytest.mark.parametrize(("share", "denied"), [(0.9, False), (1.1, True), (-5.0, False)])
def test_what_the_motion_is_farther_off_with_is_no_name(share, denied, monkeypatch):
    """However much nearer another register is: firmware filters it at its own instants."""
    model = model_of(logs(motions=["slow"]))
    worse = share * SHARED * engines_rad(model) ** 2
    squares = {"without": [3e-6, 3e-6], "with": [3e-6, 3e-6 + 2.0 * worse]}
    monkeypatch.setattr(
        "bench.diagnosis.joint.faint.group_squares",
        lambda _, found: {Kind.POSITION: squares[found]},
    )
    monkeypatch.setattr("bench.diagnosis.joint.faint.shown", lambda *_: False)
    assert contradicted([model], "without", "with") is denied


@pytest.mark.parametrize(("share", "denied"), [(0.9, False), (1.1, True)])
@pytest.mark.parametrize("engines", [1.0, 100.0])
def test_the_motion_may_be_a_little_farther_off_with_what_a_register_shows(
    share, denied, engines, monkeypatch
):
    """By chance, where much is left of the motion."""
    model = model_of(logs(motions=["slow"]))
    left = engines * engines_rad(model) ** 2
    worse = share * max(SHARED * engines_rad(model) ** 2, BY_CHANCE * left)
    monkeypatch.setattr(
        "bench.diagnosis.joint.faint.group_squares",
        lambda _, found: {Kind.POSITION: [left + worse if found == "with" else left]},
    )
    monkeypatch.setattr("bench.diagnosis.joint.faint.shown", lambda *_: True)
    assert contradicted([model], "without", "with") is denied


def test_where_a_joint_that_was_let_go_came_to_rest_counts_for_nothing():
    """It may stick anywhere; only what the torque was on for tells two fits apart."""
    model = model_of(logs(motions=["slow"], limp_s=2.0))
    (one,) = model.observed
    assert one.driven(np.array([0.0, 1.9, 2.1, 3.0])).tolist() == [True, True, False, False]
    noise = {Kind.POSITION: Noise(1e-3, 0.0, 0.1), Kind.DUTY: Noise(1e-3, 0.0, 0.1)}
    found = Fit(Hypothesis(), np.zeros(len(model.nuisances)), noise, 0.0)
    (before,) = group_squares([model], found)[Kind.POSITION]
    samples = one.position
    moved = replace(samples, value=samples.value + 0.1 * ~one.driven(samples.t_s))
    elsewhere = model.of([replace(one, channels={**one.channels, Channel.POSITION: moved})])
    assert group_squares([elsewhere], found)[Kind.POSITION] == [pytest.approx(before, rel=0.01)]
    (blocks,) = elsewhere.residuals(found.hypothesis, [found.z])
    assert np.abs(blocks[0, Kind.POSITION].value).max() > 0.05
    told = channels_of(elsewhere, blocks, blocks)[0]
    assert told["channel"] == "position"
    assert told["rms_after"] < 0.02


def test_a_joint_that_never_had_torque_counts_all_the_same():
    model = model_of(logs(motions=["slow"], limp_s=2.0))
    (one,) = model.observed
    start = one.replay.start.copy()
    start[fields.ENABLED] = 0.0
    limp = replace(one, replay=replace(one.replay, start=start))
    assert not limp.driven(limp.position.t_s).any()
    block = Block(limp.position.t_s, limp.position.value, 0.0 * limp.position.value)
    assert while_driven(limp, block) is block


def test_a_number_that_is_further_off_than_its_file_doubts_is_told():
    nuisances = model_of(logs(motions=["slow"])).nuisances
    doubted = replace(nuisances[0], deviation=0.1, reach=FARTHEST)
    z = np.zeros(len(nuisances))
    z[:2] = -2.1, WITHIN
    (told,) = far_off([doubted, *nuisances[1:]], z)
    assert told.endswith("torque constant by -21% (2.1 deviations)")
    z[0] = -1.9
    assert far_off([doubted, *nuisances[1:]], z) == ()
