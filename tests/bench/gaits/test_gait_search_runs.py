"""A whole search on a made-up robot: kept, gone on with, the same with any number of processes."""

import json
import math
import multiprocessing
import os
import tomllib
from dataclasses import replace

import pytest
from pretended_walks import MARVIN, ORIGINAL, Pretended, outcome

from bench.experiments.locomotion_result import TORQUE_LIMIT
from bench.gaits import search as searching
from bench.gaits.candidate import GaitSearchError
from bench.gaits.ledger import SEARCH, WALKS, Ledger
from bench.gaits.methods import Method
from bench.gaits.outcome import Job
from bench.gaits.report import document, summary, walk_command, write_report
from bench.gaits.search import CHECK_S, CHECKS, GaitSearch, Plan
from bench.gaits.walks import Walks
from busemu.tables import load_robot
from hal.cpg import Gait

PLAN = Plan(budget=16, seconds=5.0)


def search(folder, walk, plan=PLAN, processes=1, tell=None, limit=TORQUE_LIMIT):
    with Walks(walk, processes) as walks:
        return GaitSearch(MARVIN, plan, Ledger(folder, MARVIN, limit), walks, tell).run()


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("found")
    return search(folder / "out", Pretended(folder / "log")), folder


def jobs(result):
    return [[o.job for o in (*f.outcomes, *f.checks)] for f in result.found]


def test_the_best_gait_was_checked_from_other_start_states_for_ten_seconds(found):
    result, _ = found
    for each in result.found:
        assert {check.job.seed for check in each.checks} == set(range(CHECKS))
        assert {check.job.seconds for check in each.checks} == {CHECK_S}
        assert all(check.allowed for check in each.checks)
    assert result.original.job == Job(ORIGINAL, CHECK_S, 0)


def test_every_walk_is_a_row_and_none_is_made_twice(found):
    result, folder = found
    rows = (folder / "out" / WALKS).read_text().splitlines()
    different = {job for each in jobs(result) for job in each} | {result.original.job}
    assert len(rows) - 1 == len(different) == len(Pretended(folder / "log").walked)


def test_the_same_command_walks_nothing_again_and_finds_the_same(found, tmp_path):
    result, folder = found
    again = Pretended(tmp_path / "log")
    told = []
    second = search(folder / "out", again, tell=lambda o, new: told.append(new))
    assert again.walked == []
    assert told
    assert not any(told)
    assert document(second) == document(result)


def test_an_interrupted_search_goes_on_where_it_was(found, tmp_path):
    result, _ = found
    pretended = Pretended(tmp_path / "log")

    def interrupted(job, check):
        if len(pretended.walked) == 11:
            raise KeyboardInterrupt
        return pretended(job, check)

    with pytest.raises(KeyboardInterrupt):
        search(tmp_path / "out", interrupted)
    assert len(Ledger(tmp_path / "out", MARVIN)) == 11
    second = search(tmp_path / "out", pretended)
    total = len({job for each in jobs(result) for job in each} | {result.original.job})
    assert len(pretended.walked) == total
    assert document(second) == document(result)


def test_a_larger_budget_goes_on_from_a_smaller_one(tmp_path):
    pretended = Pretended(tmp_path / "log")
    small, large = (Plan(n, 5.0, methods=(Method.CMA,)) for n in (8, 24))
    first = search(tmp_path / "out", pretended, small)
    second = search(tmp_path / "out", pretended, large)
    walks = [o.job for o in second.found[0].outcomes]
    assert [o.job for o in first.found[0].outcomes] == walks[:8]
    fresh = search(tmp_path / "fresh", Pretended(tmp_path / "other"), large)
    assert document(fresh) == document(second)


def test_a_lower_limit_judges_the_same_walks_and_finds_a_gait_below_it(tmp_path):
    folder, pretended = tmp_path / "out", Pretended(tmp_path / "log")
    search(folder, pretended)
    before = len(pretended.walked)
    lower = search(folder, pretended, limit=0.5)
    assert lower.original.torque_limit == document(lower)["torque_limit_of_stall"] == 0.5
    checks = [check for each in lower.found for check in each.checks]
    assert checks
    assert max(check.torque_of_stall for check in checks) < 0.5
    assert any(not o.allowed for each in lower.found for o in each.outcomes)
    grid = PLAN.budget  # which is the same whatever is allowed
    assert len(pretended.walked) < before + len({j for each in jobs(lower) for j in each}) - grid
    again = Ledger(folder, MARVIN)
    assert [again.get(o.job).allowed for o in lower.found[0].outcomes] != [
        o.allowed for o in lower.found[0].outcomes
    ]


def test_two_processes_find_what_one_does(found, tmp_path):
    result, _ = found
    pretended = Pretended(tmp_path / "log")
    second = search(tmp_path / "out", pretended, processes=2)
    assert document(second) == document(result)
    assert os.getpid() not in pretended.walked


def test_two_processes_walk_at_once():
    meeting = multiprocessing.get_context("fork").Barrier(2)

    def walk(job, check):
        meeting.wait(timeout=60.0)  # a walk that is alone gives up, which is an error
        return outcome(job)

    several = [Job(ORIGINAL, 5.0, seed) for seed in range(4)]
    with Walks(walk, 2) as walks:
        assert {done.job for done in walks.run(several)} == set(several)


def test_another_seed_starts_and_draws_another_way(tmp_path):
    plan = Plan(8, 5.0, 1, (Method.CMA,))
    other = search(tmp_path / "out", Pretended(tmp_path / "log"), plan)
    first = search(tmp_path / "two", Pretended(tmp_path / "log2"), Plan(8, 5.0, 0, (Method.CMA,)))
    assert {o.job.seed for o in other.found[0].outcomes} == {1}
    candidates = [{o.job.candidate for o in r.found[0].outcomes} for r in (first, other)]
    assert not candidates[0] & candidates[1]


def test_a_gait_that_falls_from_another_start_state_is_not_the_best(tmp_path):
    plan = Plan(25, 5.0, methods=(Method.GRID,))
    honest = search(tmp_path / "one", Pretended(tmp_path / "log"), plan).found[0]
    fragile = honest.candidate

    def walk(job, check):
        falls = job.candidate == fragile and job.seed == 2
        return outcome(job, **({"fell_after_s": 3.0} if falls else {}))

    found = search(tmp_path / "two", walk, plan).found[0]
    assert [o.job.candidate for o in found.refuted] == [fragile]
    assert found.candidate not in (fragile, None)
    assert found.speed_m_s <= honest.speed_m_s


def test_nothing_allowed_leaves_no_best_and_says_so(tmp_path):
    def walk(job, check):
        return outcome(job, fell_after_s=1.0, speed_m_s=0.0)

    result = search(tmp_path / "out", walk)
    assert result.best is None
    written = write_report(result, tmp_path / "out")
    assert not (tmp_path / "out" / "best.toml").exists()
    assert len(written) == 2
    assert "no gait stood the check" in summary(result)
    assert walk_command(result, tmp_path) is None


# -- on disk ---------------------------------------------------------------------------------------


def test_a_walk_comes_back_from_disk_to_the_bit(tmp_path):
    ledger = Ledger(tmp_path, MARVIN)
    odd = outcome(Job(ORIGINAL, 1.0 / 3.0, 7), speed_m_s=0.1 + 0.2, torque_of_stall=math.pi / 10)
    ledger.add(odd)
    back = Ledger(tmp_path, MARVIN).get(odd.job)
    assert repr(back) == repr(odd)  # NaN is not equal to itself


def test_walks_of_another_robot_file_are_refused(tmp_path):
    Ledger(tmp_path, MARVIN).add(outcome(Job(ORIGINAL, 5.0, 0)))
    with pytest.raises(GaitSearchError, match="choose another --out"):
        Ledger(tmp_path, load_robot("phantomx"))
    (tmp_path / SEARCH).unlink()
    with pytest.raises(GaitSearchError, match="nobody knows whose"):
        Ledger(tmp_path, MARVIN)


def test_a_damaged_row_is_named(tmp_path):
    ledger = Ledger(tmp_path, MARVIN)
    ledger.add(outcome(Job(ORIGINAL, 5.0, 0)))
    path = tmp_path / WALKS
    path.write_text(path.read_text().replace(",5.0,", ",long,"))
    with pytest.raises(GaitSearchError, match="row 2"):
        Ledger(tmp_path, MARVIN)
    path.write_text("a,b\n")
    with pytest.raises(GaitSearchError, match="columns"):
        Ledger(tmp_path, MARVIN)


def test_a_failing_disk_leaves_the_walks_as_they_were(tmp_path, monkeypatch):
    ledger = Ledger(tmp_path, MARVIN)
    ledger.add(outcome(Job(ORIGINAL, 5.0, 0)))
    before = (tmp_path / WALKS).read_bytes()
    monkeypatch.setattr("pathlib.Path.replace", lambda *_: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        ledger.add(outcome(Job(ORIGINAL, 5.0, 1)))
    assert (tmp_path / WALKS).read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == [SEARCH, WALKS]


def test_the_report_names_what_it_wrote_and_best_toml_is_the_gait(found, tmp_path):
    both, _ = found
    result = replace(both, found=both.found[:1])  # the grid leaves the gait of the file alone
    written = write_report(result, tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in written)
    told = json.loads((tmp_path / "result.json").read_text())
    assert told["methods"]["cma"]["walks"] == PLAN.budget
    best = result.best.candidate
    robot = load_robot(tmp_path / "best.toml")
    assert Gait.of(robot) == Gait.of(best.on(MARVIN))
    changed = {key for key in robot.document if robot.document[key] != MARVIN.document[key]}
    assert changed == {"gait"}
    words = walk_command(result, tmp_path).split()
    assert float(words[words.index("--v-left") + 1]) == best.v_left
    assert float(words[words.index("--v-right") + 1]) == best.v_right


def test_gains_are_over_the_original_gait(found):
    result, _ = found
    for each in result.found:
        gain = document(result)["methods"][each.method.value]["gain"]
        assert gain["speed"] == pytest.approx(each.speed_m_s / result.original.speed_m_s)
        assert gain["stride_commanded"] == each.candidate.stride


def test_result_json_has_no_nan_and_search_toml_names_the_robot(found):
    result, _ = found
    json.dumps(document(result), allow_nan=False)
    assert tomllib.loads((found[1] / "out" / SEARCH).read_text())["robot"] == "marvin"


def test_a_plan_asks_for_about_as_many_walks_as_it_says(found):
    result, _ = found
    different = {job for each in jobs(result) for job in each} | {result.original.job}
    assert abs(PLAN.walks - len(different)) <= CHECKS
    assert searching.FASTEST > 1
