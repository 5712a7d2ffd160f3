"""What small things do, weighed together."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.nuisances import Trial
from bench.diagnosis.robot.weighing import FEW, HOLDS, LEVEL, Weighing, levels, unforetold, weighed

KIND = RobotKind.JOINTS
ROWS = 300


def trials(count, one_way=()):
    return [Trial(f"thing {k}", 1.0, lambda robot, x: robot, k in one_way) for k in range(count)]


def replays(weights, traces, rough, seed=1, kind=KIND):
    """Rows of robots of which traces are true, but for roughness of its own in every replay."""
    random = np.random.default_rng(seed)
    plain = random.standard_normal(ROWS)
    return [{kind: plain + w @ traces + rough * random.standard_normal(ROWS)} for w in weights]


def true_traces(count):
    return np.random.default_rng(7).standard_normal((count, ROWS))


@pytest.mark.parametrize("count", [1, 3, 17, 42, 43])
def test_half_of_the_replays_have_a_thing_one_way_and_no_two_things_go_together(count):
    found = levels(trials(count))
    assert set(np.unique(found)) == {-LEVEL, LEVEL}
    assert 2 * count < len(found) <= 2 * max(4, count + 8)
    assert np.unique(-found, axis=0) == pytest.approx(np.unique(found, axis=0))  # opposites
    assert found.sum(axis=0) == pytest.approx(0.0)
    assert found.T @ found == pytest.approx(len(found) * LEVEL**2 * np.eye(count))


def test_what_goes_one_way_is_there_or_not():
    found = levels(trials(5, one_way=(2,)))
    assert set(np.unique(found[:, 2])) == {0.0, LEVEL}
    assert found[:, 2].mean() == 0.5 * LEVEL
    assert set(np.unique(np.delete(found, 2, axis=1))) == {-LEVEL, LEVEL}


def test_things_that_are_weighed_together_are_told_better_than_one_by_one():
    """With twice as many replays: the roughness of two is half of what each thing does."""
    weights, true = levels(trials(42)), true_traces(42)
    told = weighed(weights, replays(weights, true, 0.35))
    together = np.array([trace[KIND] for trace in told])
    one_by_one = np.array([r[KIND] for r in replays(np.eye(42), true, 0.35, seed=2)])
    one_by_one -= replays(np.zeros((1, 42)), 0.0 * true, 0.35, seed=2)[0][KIND]
    apart, alone = (np.std(found - true) for found in (together, one_by_one))
    assert apart < 0.4 * alone
    assert np.corrcoef(together.ravel(), true.ravel())[0, 1] > 0.97


def test_what_two_things_do_together_is_neither_of_them():
    weights, true = levels(trials(20)), true_traces(20)
    some = replays(weights, true, 0.0)
    for w, rows in zip(weights, some, strict=True):
        rows[KIND] = rows[KIND] + 9.0 * w[2] * w[5] * true[0]
    told = np.array([trace[KIND] for trace in weighed(weights, some)])
    assert told == pytest.approx(true, abs=1e-9)


def test_replays_that_the_engine_could_not_run_are_left_out():
    weights, true = levels(trials(42)), true_traces(42)
    whole = replays(weights, true, 0.05)
    some = [dict(rows) for rows in whole]
    some[4] = {KIND: np.full(ROWS, np.nan)}
    for rows in some:
        rows[KIND][9] = np.nan  # in no replay
    told = np.array([trace[KIND] for trace in weighed(weights, some)])
    assert (told[:, 9] == 0.0).all()
    kept = np.arange(ROWS) != 9
    assert np.std(told[:, kept] - true[:, kept]) < 0.2
    assert unforetold(weights, some, weighed(weights, some)) < 0.05
    none = [{KIND: np.full(ROWS, np.nan)} for _ in weights]
    assert not np.any([trace[KIND] for trace in weighed(weights, none)])


def test_a_kind_that_nobody_saw_has_no_rows():
    weights = levels(trials(3))
    told = weighed(
        weights, [{KIND: np.zeros(ROWS), RobotKind.HEIGHT: np.empty(0)} for _ in weights]
    )
    assert all(trace[RobotKind.HEIGHT].shape == (0,) for trace in told)


def test_how_far_replays_are_from_what_was_foretold():
    weights, true = levels(trials(42)), true_traces(42)
    few = replays(weights, true, 0.0)[:8]
    assert unforetold(weights[:8], few, [{KIND: row} for row in true]) == pytest.approx(0.0)
    assert unforetold(weights[:8], few, [{KIND: 0.0 * row} for row in true]) == pytest.approx(1.0)
    half = [{KIND: 0.5 * row} for row in true]
    assert unforetold(weights[:8], few, half) == pytest.approx(0.25)
    for rows in few:
        rows[KIND][: ROWS // 2] = np.nan  # where this motion shows nothing
    assert unforetold(weights[:8], few, half) == pytest.approx(0.25)


class Motions:
    """Motions that trials move by ``size`` of what they do to the first; names of jobs that ran.

    The last has half of the rows of the others.
    """

    OWN = (np.arange(ROWS), np.arange(ROWS), np.arange(0, ROWS, 2))

    def __init__(self, sizes):
        self.sizes, self.asked = sizes, []
        self.true, self.plain = true_traces(12), np.random.default_rng(3).standard_normal(ROWS)
        motions = [SimpleNamespace(k=k, rows_of=partial(self.rows_of, k)) for k in range(3)]
        self.weighing = Weighing(trials(12), motions, self.run)

    def rows_of(self, k, other):
        if k == 2:
            return {KIND: np.arange(ROWS // 2)} if other.k == 2 else None
        return {KIND: self.OWN[other.k]}

    def run(self, jobs):
        self.asked.append(len(jobs))
        names = [trial.name for trial in trials(12)]
        found = []
        for job in jobs:
            assert job.short
            told = dict(job.trials)
            moved = np.array([told.get(name, 0.0) for name in names]) @ self.true
            rows = self.plain + self.sizes[job.recording, job.effects] * moved
            found.append({KIND: rows[self.OWN[job.recording]]})
        return found


WEIGHED = len(levels(trials(12)))
HERE, THERE = (), (("payload@all", 2.0),)


def told(motions, m, settings):
    shown = motions.weighing.known(m, settings, ())
    return np.array([shown[trial.name][KIND] for trial in trials(12)])


def test_what_is_known_holds_where_a_few_replays_say_so():
    """Elsewhere, and of another motion."""
    little = 1.0 + 0.9 * np.sqrt(HOLDS)
    motions = Motions({(0, HERE): 1.0, (0, THERE): little, (1, THERE): 1.0 / little})
    assert told(motions, 0, HERE) == pytest.approx(motions.true)
    assert told(motions, 0, THERE) == pytest.approx(motions.true)
    assert told(motions, 1, THERE) == pytest.approx(motions.true)
    assert motions.asked == [WEIGHED, FEW, FEW]


def test_where_it_does_not_hold_all_is_weighed_anew_and_the_best_of_both_is_known():
    much = 1.2 / (1.0 - np.sqrt(HOLDS))
    motions = Motions({(0, HERE): 1.0, (0, THERE): much, (1, HERE): 1.02, (1, THERE): 0.95 * much})
    told(motions, 0, HERE)
    assert told(motions, 0, THERE) == pytest.approx(much * motions.true)
    assert told(motions, 1, THERE) == pytest.approx(much * motions.true)
    assert told(motions, 1, HERE) == pytest.approx(motions.true)
    assert motions.asked == [WEIGHED, FEW, WEIGHED, FEW, FEW]


def test_a_motion_with_fewer_rows_has_its_own_of_them_and_tells_nothing_of_the_others():
    motions = Motions({(k, HERE): 1.0 for k in range(3)})
    own = told(motions, 2, HERE)
    assert own == pytest.approx(motions.true[:, ::2])
    assert told(motions, 0, HERE) == pytest.approx(motions.true)
    assert told(motions, 2, HERE) == pytest.approx(own)
    assert motions.asked == [WEIGHED, WEIGHED, FEW]


def test_what_is_told_is_for_one_unit_of_a_trial():
    """Whatever its size is."""
    (whole,) = levels(trials(1)).T
    motion = SimpleNamespace(rows_of=lambda other: None)

    def run(jobs):
        return [{KIND: np.full(4, 3.0 * dict(job.trials)["thing 0"])} for job in jobs]

    large = Trial("thing 0", 5.0, lambda robot, x: robot)
    assert len(whole) == 8
    shown = Weighing([large], [motion], run).known(0, HERE, ())
    assert shown["thing 0"][KIND] == pytest.approx(3.0 / 5.0)
