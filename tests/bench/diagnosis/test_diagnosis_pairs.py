"""Two effects that look most like a third: the pair is found that does not begin with it."""

import numpy as np
import pytest
from pendulum_logs import POSITION, logs, model_of

from bench.diagnosis.joint import settling
from bench.diagnosis.joint.fit import fit
from bench.diagnosis.joint.floor import noise_floor, tolerance
from bench.diagnosis.joint.growing import grow, paired
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.screening import screen
from bench.diagnosis.joint.search import confirm
from bench.diagnosis.watch import OutOfTimeError, Watch
from sim.effects import effect

TRUTH = {"load_friction": {"ratio": 0.3}, "dead_zone": {"margin_rad": 0.03}}
DECOY = "transport_delay"
EFFECTS = {name: effect(name) for name in (*TRUTH, DECOY, "torque_limit")}


def quiet(_):
    pass


@pytest.fixture(scope="module")
def looked():
    """A model, its fit without an effect, and gains of a search that began with a wrong one."""
    model = model_of(logs(TRUTH, registers=(POSITION,)))
    base = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))

    def confirmed(over, names):
        tries = {name: z for _, name, z in screen(model, over, [EFFECTS[n] for n in names])}
        return [confirm(model, over, EFFECTS[name], tries[name]) for name in names]

    singles = confirmed(base, (DECOY, *TRUTH))
    return model, base, [*singles, *confirmed(singles[0].fit, ("torque_limit",))]


def test_a_pair_is_found_that_begins_otherwise(looked):
    model, _, confirmed = looked
    found, gains = paired(model, confirmed, EFFECTS, quiet)
    assert set(found.hypothesis.effects) == set(TRUTH) == {g.effect for g in gains}
    assert found.cost < min(g.fit.cost for g in confirmed)
    ratio = next(k for k in range(2) if found.hypothesis.knobs[k].effect == "load_friction")
    size = found.hypothesis.knobs[ratio].value(found.z[len(model.nuisances) + ratio])
    assert size == pytest.approx(0.3, rel=0.1)


def test_there_is_no_pair_without_time_or_another_beginning(looked):
    model, _, confirmed = looked

    def late(_):
        raise OutOfTimeError

    assert paired(model, confirmed, EFFECTS, late) is None
    only = [g for g in confirmed if DECOY in g.fit.hypothesis.effects]
    assert paired(model, only, EFFECTS, quiet) is None


@pytest.mark.slow
def test_a_search_that_begins_with_a_wrong_name_ends_with_the_right_ones(looked, monkeypatch):
    model, base, confirmed = looked
    floor = noise_floor(model.observed, model.residuals(Hypothesis(), [base.z])[0])
    floors = {kind: noise.total for kind, noise in base.noise.items()}
    floors |= {Kind.POSITION: tolerance(floor)}

    def misled(model, base, effects, *known, begun, ask):
        if DECOY not in effects:
            return base, [], confirmed
        if begun:
            return grow(model, base, effects, *known, begun=begun, ask=ask)
        return confirmed[0].fit, confirmed[:1], confirmed

    monkeypatch.setattr(settling, "grow", misled)
    known = (model, None, base, EFFECTS, floor, floors, Watch(quiet))
    found = settling.settle(*known)
    assert {gain.effect for gain in found.taken} == set(TRUTH)
    assert all(gain.outside > 0.0 for gain in found.taken)  # those it was begun with, too
    monkeypatch.setattr(settling, "paired", lambda *_: None)
    assert not settling.settle(*known).taken


@pytest.mark.slow
def test_what_gains_beside_the_others_is_looked_for_once_more(looked, monkeypatch):
    """What hid behind a name that is taken back comes out when that is gone."""
    model, base, confirmed = looked
    one = next(g for g in confirmed if g.effect == "load_friction")
    both = confirm(model, one.fit, EFFECTS[DECOY], np.append(one.fit.z, 0.1))
    floors = {kind: noise.total for kind, noise in base.noise.items()}
    denied = iter([settling.Denied(both, settling.NOTHING, again=False)])
    monkeypatch.setattr(settling._Settling, "_denied", lambda *_: next(denied, None))
    how = settling._Settling(model, None, base, 1e-3, floors, Watch(quiet), quiet)
    found = how.settled(EFFECTS, (both.fit, [one, both], confirmed))
    assert {gain.effect for gain in found.taken} == set(TRUTH)
    assert [row["effect"] for row in found.rejected] == [DECOY]
