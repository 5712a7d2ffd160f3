"""What a run of a whole robot's diagnosis adds to what was found."""

from datetime import date
from types import SimpleNamespace

import pytest

from bench.diagnosis.report.telling import cautions, unfinished
from bench.diagnosis.result import Diagnosis, FitSummary
from bench.diagnosis.robot import running as robot_running
from bench.diagnosis.robot.diagnosis import RobotDiagnosis, Work
from bench.diagnosis.robot.gains import RobotFindings
from bench.diagnosis.running import Split
from bench.diagnosis.watch import OutOfTimeError, Watch
from busemu.tables import load_robot
from sim.effects import effect


@pytest.mark.parametrize("stopped", [None, "step 1: fitting dead_zone@all"])
def test_a_search_that_time_cut_short_says_so_on_top(stopped, tmp_path, monkeypatch):
    plain = Diagnosis(
        verdict="unexplained",
        mismatch=(),
        causes=(),
        fit=FitSummary(0.01, 0.01, 0.002, True, ("walk",)),
        unexplained=(),
        next_experiment=(),
        limits=(),
    )
    found = RobotDiagnosis(plain, (), (), ())
    monkeypatch.setattr(robot_running, "diagnose_robot", lambda *_, **__: found)
    monkeypatch.setattr(robot_running, "write_answers", lambda *_: None)
    monkeypatch.setattr(robot_running, "traces", lambda *_: [])
    watch = Watch(lambda _: None)
    watch.stopped = stopped
    answers = robot_running.run_robot(
        load_robot("marvin"), Split((), ()), tmp_path, date(2026, 1, 2), watch=watch
    )
    assert unfinished(answers.diagnosis) is (stopped is not None)
    told = " ".join(cautions(answers.diagnosis))
    assert ("before the search was done" in told) is (stopped is not None)


def late(stage):
    raise OutOfTimeError(stage)


@pytest.mark.parametrize(
    ("cut", "again"),
    [(False, True), (True, True), (False, False)],
    ids=["in time", "cut", "beside play"],
)
def test_what_was_found_is_told_whatever_the_time(cut, again):
    """Only another search is left out: the first one's name was taken back."""
    told, searches = [], []
    model = SimpleNamespace(
        observed=[SimpleNamespace(name="walk", group="walk")] * 2,
        floors=dict,
        placed={name: SimpleNamespace(effect=effect(name)) for name in ("dead_zone", "punch")},
    )
    work = Work(model, None, [0], [1], "", late, told.append)

    def run(without, base, done):
        assert done is work.held.consistent
        if cut and searches:
            late("replaying effects")
        searches.append(without)
        name = "punch" if "dead_zone" in without else "dead_zone"
        return SimpleNamespace(taken=(SimpleNamespace(name=name),))

    def kept(found, say):
        say("asking")
        (gain,) = found.taken
        taken = [gain] if gain.name == "punch" else []
        return taken, found, [] if taken else [{"effect": gain.name}]

    work.search = SimpleNamespace(run=run)
    work.held = SimpleNamespace(consistent=lambda base: False, kept=kept)
    twice = again and not cut
    found, taken, _, rejected = work.searched(None, frozenset(), again)
    assert [gain.name for gain in taken] == (["punch"] if twice else [])
    assert found.taken[0].name == ("punch" if twice else "dead_zone")
    assert rejected == [{"effect": "dead_zone"}]
    assert told == ["asking"] * (2 if twice else 1)


@pytest.mark.parametrize(
    ("consistent", "at_ends", "cut", "holds", "asked"),
    [
        (False, True, False, True, "searched"),
        (True, True, False, True, "beyond"),
        (True, True, False, False, "believed"),
        (True, True, True, True, "believed"),
        (True, False, False, True, "believed"),
    ],
)
def test_where_no_more_than_noise_is_left_only_tolerances_at_their_ends_are_asked(
    monkeypatch, consistent, at_ends, cut, holds, asked
):
    """Where no name holds, the fit is the one that was consistent."""
    model = SimpleNamespace(observed=[SimpleNamespace(name="walk", group="walk")] * 2, floors=dict)
    work = Work(model, None, [0], [1], "", late, print)
    monkeypatch.setattr(work, "searched", lambda *_: ("searched", ["gain"], "searched", ()))

    def beyond(base, without):
        if cut:
            late("trying")
        return RobotFindings("again", "beyond", ("tilt",), (), {}, ())

    def kept(found, say):
        named = holds and bool(found.taken)
        return list(found.taken) if named else [], found.fit if named else found.base, ()

    work.search = SimpleNamespace(
        nothing=lambda base: RobotFindings(base, base, (), (), {}, ()), beyond=beyond
    )
    work.held = SimpleNamespace(
        consistent=lambda base: consistent,
        at_ends=lambda base: ["tilt"] if at_ends else [],
        stands=False,
        kept=kept,
    )
    found, taken, after, _ = work.named("believed", frozenset(), True)
    assert after == asked
    assert bool(taken) is (asked != "believed")
    if asked == "believed":
        assert (found.base, found.fit, found.taken) == ("believed", "believed", ())


@pytest.mark.parametrize("consistent", [True, False])
@pytest.mark.parametrize("stands", [True, False])
def test_no_zero_of_a_joint_is_named_where_a_robot_stands(stands, consistent):
    """There chance drags zeros as far as they may go."""
    model = SimpleNamespace(observed=[SimpleNamespace(name="walk", group="walk")] * 2, floors=dict)
    work, asked = Work(model, None, [0], [1], "", late, print), []

    def found(*without):
        asked.append(set().union(*without))
        return RobotFindings("base", "fit", (), (), {}, ())

    work.search = SimpleNamespace(
        nothing=lambda base: found,
        beyond=lambda base, without: found(without),
        run=lambda without, base, done: found(without),
    )
    work.held = SimpleNamespace(
        consistent=lambda base: consistent,
        at_ends=lambda base: ["tilt"],
        kept=lambda found, say: ([], "fit", ()),
        stands=stands,
    )
    work.named("base", frozenset({"punch"}), True)
    assert asked == [{"punch", *(["zero_offset"] if stands else [])}]
