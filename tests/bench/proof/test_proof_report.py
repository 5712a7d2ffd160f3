"""From answers to a score: the second round, the files, and the whole of it as a user runs it."""

import csv
import json
import re
import shutil

import pytest
from judged_cases import cause, diagnosis, effect, judged, key
from programs import busemu
from sealed_cases import delayed_proof, small_proof

from bench.blind import Kind
from bench.proof import active as active_module
from bench.proof import pictures
from bench.proof.active import Active
from bench.proof.answering import Answers
from bench.proof.errors import ProofError
from bench.proof.judging import Judged
from bench.proof.report import write_score
from bench.proof.scoring import GOALS, RULES


def prove(*words):
    """``busemu prove`` as a person types it."""
    return busemu("prove", *words, timeout_s=900.0)


@pytest.fixture(scope="module")
def ambiguous(tmp_path_factory):
    """A proof of one ambiguous case that the proposed experiment decides, and no other does."""
    proof = delayed_proof(tmp_path_factory.mktemp("active") / "proof", "ambiguous")
    proof.prepare()
    proof.write()
    published = proof.publish()
    list(proof.answer())
    active = Active(proof, seed=9)
    last = [list(active.run(asked))[-1] for asked in (1, 2, 3)]
    assert last == [(2, 2), (1, 1), (1, 1)]  # one that is proposed, three at random
    return proof, active, published, write_score(proof, 9, published, active)


def test_a_kind_that_is_none_is_refused(tmp_path):
    ran = prove("--seed", "5", "--out", str(tmp_path / "x"), "--only", "nul")
    assert ran.returncode == 1
    assert ran.stderr.startswith("busemu: --only nul: no such kind; use one of null, single")


def test_a_way_of_concealment_is_of_one_kind_of_cases(tmp_path):
    told = "--seed", "5", "--out", str(tmp_path / "x"), "--only-plan", "--cases", "6"
    ran = prove(*told, "--concealed", "mimicked")
    assert ran.returncode == 1
    assert ran.stderr == "busemu: --concealed mimicked: give --only KIND as well\n"
    ran = prove(*told, "--only", "single", "--concealed", "hidden")
    assert "no such concealment; use one of plain, masked" in ran.stderr
    ran = prove(*told, "--only", "null", "--concealed", "mimicked")
    assert ran.stderr == "busemu: --cases: no null case is concealed that way: mimicked\n"
    assert "6 single" in prove(*told, "--only", "single", "--concealed", "mimicked").stdout
    assert not (tmp_path / "x").exists()


def test_help_and_refusal_name_the_kinds_in_one_order():
    words = re.sub(r"[^a-z]+", " ", prove("--help").stdout)
    kinds = [kind.value for kind in Kind]
    assert f"{' '.join(kinds[:-1])} or {kinds[-1]} only null" in words


@pytest.mark.slow
def test_the_proposed_experiment_is_run_on_the_hidden_specimen_and_scored(ambiguous):
    _, _, _, score = ambiguous
    row = score["resolved_by_experiment"]
    assert (row["value"], row["n"], row["met"]) == (1.0, 1, "great")
    assert (row["random"]["value"], row["random"]["n"]) == (0.0, 1)
    told = [(k, way, one["value"], one["n"]) for k in "123" for way, one in row["after"][k].items()]
    assert told == [(k, w, float(w == "proposed"), 1) for k in "123" for w in active_module.WAYS]


@pytest.mark.slow
def test_a_case_is_followed_until_it_is_decided(ambiguous):
    """Every round has the recordings of those before it, and one more."""
    proof, active, _, _ = ambiguous
    assert [list(active.ambiguous("proposed", k)) for k in (1, 2)] == [["case-0001"], []]
    assert [list(active.ambiguous("random", k)) for k in (1, 2, 3)] == [["case-0001"]] * 3
    for k in (1, 2, 3):
        tried = json.loads(
            (active.answers("random", k).answers / "case-0001" / "pried.json").read_text()
        )
        assert sum("/next-" in path for path in tried["staged"]) == k
    assert not (proof.folder / "active" / "proposed" / "round-2").exists()


@pytest.mark.slow
def test_rounds_are_not_run_again(ambiguous):
    _, active, _, _ = ambiguous
    assert [list(active.run(asked)) for asked in (1, 2)] == [[(1, 2), (2, 2)], [(1, 1)]]


@pytest.mark.slow
def test_rounds_come_before_the_keys_are_opened(ambiguous, tmp_path):
    scored, _, _, _ = ambiguous
    without = shutil.ignore_patterns("active")
    folder = shutil.copytree(scored.folder, tmp_path / "proof", ignore=without)
    proof = delayed_proof(folder, "ambiguous")
    with pytest.raises(ProofError, match="--active comes before"):
        list(Active(proof, seed=9).run(1))


@pytest.mark.slow
def test_everything_is_written_beside_the_score(ambiguous):
    proof, _, published, score = ambiguous
    assert json.loads((proof.folder / "score.json").read_text()) == score
    assert score["format"] == "busemu-score/1"
    assert score["rules"] == RULES
    assert score["diagnoser"] == published["diagnoser"]
    assert set(GOALS) <= set(score)
    with (proof.folder / "cases.csv").open(newline="") as file:
        (line,) = csv.DictReader(file)
    assert line["hidden"] == "transport_delay"
    assert line["named"] == "transport_delay:0.600"
    page = (proof.folder / "index.html").read_text()
    assert "case-0001" in page
    drawn = {path.stem for path in (proof.folder / "figures").iterdir()}
    assert drawn >= {"power", "confusion", "calibration"}
    for name in drawn:
        assert f"src='figures/{name}.png'" in page
        assert (proof.folder / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((proof.folder / "keys" / "case-0001.json").read_text())["kind"] == "single"


@pytest.mark.slow
@pytest.mark.parametrize(("at_the_time", "frozen"), [("this one", True), ("another", False)])
def test_a_diagnoser_that_changed_during_the_run_is_told(
    ambiguous, monkeypatch, at_the_time, frozen
):
    proof, active, told, _ = ambiguous
    read = Answers.read

    def made_by(self, name):
        diagnosis, run = read(self, name)
        return diagnosis, run | {"sources_sha256": at_the_time}

    monkeypatch.setattr(Answers, "read", made_by)
    told = told | {"diagnoser": {"commit": "some", "sources_sha256": "this one"}}
    assert write_score(proof, 9, told, active)["frozen"] is frozen


@pytest.mark.slow
def test_what_was_not_run_is_left_out_with_a_word(tmp_path):
    proof = small_proof(tmp_path / "proof")
    proof.prepare()
    proof.write()
    published = proof.publish()
    list(proof.answer())
    score = write_score(proof, 9, published)
    assert "--active" in score["left_out"]["resolved_by_experiment"]
    assert "--robots" in score["left_out"]["joint_group_f1"]
    assert score["false_alarms"]["value"] == 0.0
    assert score["false_alarms"]["n"] == 2


@pytest.mark.parametrize(
    ("ratio", "size"), [(0.3, 0.5), (0.52, 0.5), (0.98, 1.0), (2.9, 3.0), (5.2, 5.0), (40.0, 8.0)]
)
def test_a_ratio_belongs_to_the_nearest_size(ratio, size):
    assert pictures.size_of(ratio) == size


def test_a_scene_of_robots_can_be_asked_for_alone(tmp_path):
    told = "--seed", "5", "--out", str(tmp_path / "x"), "--only-plan", "--cases", "0"
    ran = prove(*told, "--robots", "9", "--scene", "phantomx-stand")
    assert "9 cases of whole robots" in ran.stdout
    ran = prove(*told, "--scene", "phantomx-stand")
    assert ran.stderr == "busemu: --scene phantomx-stand: give --robots CASES as well\n"
    ran = prove(*told, "--robots", "9", "--scene", "marvin-leg")
    assert ran.returncode == 1
    assert ran.stderr.startswith("busemu: --robots: no robot is on its feet in marvin-leg: marvin-")


def test_the_surest_wrong_names_are_shown_first():
    hidden = effect("backlash", width_rad=(0.02, 0.0))
    cases: list[Judged] = [
        judged(key("single", hidden), diagnosis(cause(name, p)), name)
        for name, p in (("punch", 0.6), ("cable_drag", 0.9), ("backlash", 0.99))
    ]
    assert [c.case for c in pictures.worst_cases(cases)] == ["cable_drag", "punch"]


def test_the_plan_can_be_looked_at_alone(tmp_path):
    result = prove("--seed", "3", "--out", str(tmp_path / "out"), "--only-plan")
    assert result.returncode == 0
    assert "1476 cases: 100 deleted, 300 null, 100 pair, 840 single" in result.stdout
    assert not (tmp_path / "out").exists()


def test_a_proof_of_too_few_cases_is_refused_in_a_line(tmp_path):
    result = prove("--seed", "3", "--out", str(tmp_path / "out"), "--cases", "2")
    assert result.returncode == 1
    assert "at least 6 cases" in result.stderr


def test_a_quick_proof_runs_from_its_seed_to_its_score(tmp_path):
    told = ("--seed", "3", "--out", str(tmp_path / "out"), "--quick")
    result = prove(*told)
    assert result.returncode == 0, result.stderr
    score = json.loads((tmp_path / "out" / "score.json").read_text())
    assert score["cases"] == 2
    assert score["beside"]["failed"]["value"] == 0.0
    assert score["named_at_3_floor"]["n"] == 1
    assert score["named_at_3_floor"]["value"] == 1.0  # a delay of eight times the floor
    assert prove(*told).returncode == 0
    assert json.loads((tmp_path / "out" / "score.json").read_text()) == score


def test_power_is_drawn_against_the_size_and_against_what_tolerances_leave_of_it():
    cases = [
        judged(
            key("single", effect("dead_zone", 5.0, left, margin_rad=(0.01, 0.0))), diagnosis(*named)
        )
        for left, named in (
            (0.5, []),
            (5.0, [cause("dead_zone", margin_rad=(0.01, 0.009, 0.011))]),
            (None, []),
        )
    ]
    asked, left, *_ = pictures.power(cases).axes
    for axes, told in ((asked, {5.0: 1 / 3}), (left, {0.5: 0.0, 5.0: 1.0})):
        first = axes.containers[0].lines[0]
        assert dict(zip(*first.get_data(), strict=True)) == pytest.approx(told)


def test_a_figure_that_no_case_speaks_for_is_not_drawn(tmp_path):
    hidden = effect("dead_zone", margin_rad=(0.01, 0.0))
    triple = judged(key("triple", hidden, hidden, hidden), diagnosis(), "silent")
    assert set(pictures.draw([triple], tmp_path / "little", tmp_path)) == {"explained"}
    assert pictures.draw([], tmp_path / "none", tmp_path) == {}
    named = judged(key("triple", hidden), diagnosis(cause("dead_zone", 0.9)), "named")
    assert set(pictures.draw([named], tmp_path / "some", tmp_path)) == {
        "calibration",
        "explained",
    }
    single = judged(key("single", hidden), diagnosis(), "alone")
    assert {"power", "confusion"} <= set(pictures.draw([single], tmp_path / "more", tmp_path))
