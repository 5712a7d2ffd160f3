"""What a run of a whole robot's diagnosis adds to what was found."""

from datetime import date

import pytest

from bench.diagnosis.report.telling import cautions, unfinished
from bench.diagnosis.result import Diagnosis, FitSummary
from bench.diagnosis.robot import running as robot_running
from bench.diagnosis.robot.diagnosis import RobotDiagnosis
from bench.diagnosis.running import Split
from bench.diagnosis.watch import Watch
from busemu.tables import load_robot


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
