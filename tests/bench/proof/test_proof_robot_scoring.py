"""Rows of robots counted by hand, apart from those of the joints; files with and without them."""

import csv
import json
import re

import pytest
from judged_cases import (
    cause,
    diagnosis,
    effect,
    hidden_in,
    judged,
    key,
    mismatch,
    placed,
    robot_diagnosis,
    robot_key,
)
from sealed_cases import small_proof

from bench.proof import report
from bench.proof.page import _found_in
from bench.proof.report import write_score
from bench.proof.robot_pictures import draw_robots
from bench.proof.robot_pictures import places as draw_places
from bench.proof.robot_scoring import GOALS, place_rows, robot_score
from bench.proof.scoring import GOALS as JOINT_GOALS
from bench.proof.table import line

TIBIAS = [f"leg{n}.tibia" for n in range(1, 7)]
EVERY = [f"leg{n}.{link}" for n in range(1, 7) for link in ("coxa", "femur", "tibia")]
STANDS = [mismatch(TIBIAS, "stance")]
SWINGS = [mismatch(TIBIAS, "swing")]


def mass(ratio):
    return hidden_in("link_mass", TIBIAS, ratio, factor=(1.5, 1.0))


def with_walking(concealed, ratio):
    return concealed | {"walking_ratio": ratio}


def weight(ratio):
    return hidden_in("payload", EVERY, ratio, mass_kg=(0.3, 0.0))


@pytest.fixture(scope="module")
def cases():
    right = placed("link_mass", TIBIAS, scale=(1.45, 1.4, 1.55))
    return [
        judged(robot_key("single", mass(6.0)), robot_diagnosis(right, places=STANDS), "robot-1"),
        judged(
            robot_key("single", mass(4.0), rig="phantomx-walk"),
            robot_diagnosis(placed("payload"), places=SWINGS),
            "robot-2",
        ),
        judged(robot_key("single", weight(4.0)), robot_diagnosis(placed("payload")), "robot-3"),
        judged(robot_key("single", mass(1.0)), robot_diagnosis(), "robot-4"),
        judged(
            robot_key("deleted", mass(4.0)),
            robot_diagnosis(places=STANDS, verdict="unexplained"),
            "robot-5",
        ),
        judged(robot_key("null", stance_share=None), robot_diagnosis(), "robot-6"),
    ]


def test_joint_groups_are_a_mean_over_cases_at_three_times_the_floor(cases):
    row = place_rows(cases)["joint_group_f1"]
    # rightly; all joints for six of them; all of all; the six of the mismatch
    assert row["n"] == 4
    assert row["value"] == pytest.approx((1.0 + 0.5 + 1.0 + 1.0) / 4)
    assert row["ci95"][0] <= row["value"] <= row["ci95"][1]
    assert (row["good"], row["great"]) == GOALS["joint_group_f1"][:2]
    assert row["in_some_joints"]["value"] == pytest.approx((1.0 + 0.5 + 1.0) / 3)
    assert row["nameable"]["value"] == pytest.approx((1.0 + 0.5 + 1.0) / 3)
    assert row["nameable"]["n"] == 3
    assert row["of_mismatch"]["value"] == pytest.approx((1.0 + 1.0 + 0.0 + 1.0) / 4)
    assert row["at_all_sizes"]["n"] == 5


def test_phases_are_a_share_of_cases(cases):
    row = place_rows(cases)["phase_right"]
    assert (row["value"], row["n"]) == (0.5, 4)  # stance where it is stance, twice
    assert row["told_at_all"]["value"] == 0.75
    assert row["at_all_sizes"]["value"] == pytest.approx(2 / 5)
    # a true share of 0.9, told as 1, 0 and 1; two tell nothing
    assert (row["share_off"]["value"], row["share_off"]["n"]) == (pytest.approx(0.1), 3)
    assert row["share_off"]["ci95"] == pytest.approx([0.1, 0.9])
    assert row["met"] == "no"


def test_a_robot_that_stands_has_joints_and_no_phase(cases):
    stands = robot_key("single", mass(6.0), rig="marvin-stand", stance_share=None)
    told = robot_diagnosis(placed("link_mass", TIBIAS), places=STANDS)
    more = [*cases, judged(stands, told, "robot-7")]
    rows, before = place_rows(more), place_rows(cases)
    assert rows["joint_group_f1"]["n"] == before["joint_group_f1"]["n"] + 1
    assert rows["phase_right"] == before["phase_right"]
    assert _found_in(more[-1]) == "joints F1 1.00"
    assert _found_in(more[0]) == "joints F1 1.00; stance, true stance"
    assert len(draw_places(more).axes[1].lines) == len(draw_places(cases).axes[1].lines)
    assert not draw_places(more).axes[1].texts
    (told,) = draw_places(more[-1:]).axes[1].texts
    assert told.get_text() == "no robot walked"


def test_sizes_of_a_walk_without_standing_up_are_counted_beside_the_rows():
    right, wrong = placed("link_mass", TIBIAS), placed("backlash", TIBIAS)
    walks = [(3.0, right), (2.9, right), (2.9, wrong), (1.0, wrong), (0.9, wrong), (0.0, wrong)]
    walked = [
        judged(robot_key("single", with_walking(mass(5.0), ratio)), robot_diagnosis(cause))
        for ratio, cause in walks
    ]
    walked.append(judged(robot_key("single", mass(5.0)), robot_diagnosis(right)))
    two = robot_key("pair", with_walking(mass(5.0), 4.0), with_walking(weight(5.0), 3.5))
    walked.append(judged(two, robot_diagnosis(right)))
    beside = robot_score(walked)["beside"]
    large, small = (beside[f"named_at_{n}_floor_walking"] for n in ("3", "1_to_3"))
    assert (large["value"], large["n"]) == (1.0, 1)
    assert (small["value"], small["n"]) == (pytest.approx(1 / 3), 3)
    assert walked[-1].walking == 3.5
    assert walked[-3].walking == 0.0
    assert [line(c)["ratio_walking"] for c in walked[-3:]] == ["0", "", "3.5"]


def test_without_a_robot_the_rows_are_empty_and_not_nought():
    for row in place_rows([]).values():
        assert (row["value"], row["n"], row["ci95"], row["met"]) == (None, 0, None, "unknown")


def test_robots_have_the_rows_of_the_joints_on_their_own(cases):
    found = robot_score(cases)
    assert found["cases"] == 6
    missing = {"full_set_triples", "resolved_by_experiment"}
    missing |= {name for name in JOINT_GOALS if name.endswith("_left")}
    assert set(found["rows"]) == set(JOINT_GOALS) - missing
    named = found["rows"]["named_at_3_floor"]
    assert (named["value"], named["n"]) == (pytest.approx(2 / 3), 3)
    assert found["rows"]["false_alarms"]["n"] == 1
    assert found["rows"]["full_set_pairs"]["value"] is None
    assert set(found["beside"]["place_by_scene"]) == {"marvin-walk", "phantomx-walk"}
    assert found["beside"]["place_by_scene"]["phantomx-walk"]["joint_group_f1"]["n"] == 1


def joint():
    hidden = effect("backlash", 5.0, 1.25, width_rad=(0.02, 0.0))
    return judged(key("single", hidden), diagnosis(cause("backlash")), "case-0001")


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Write the score of cases made by hand; returns it, the page and the lines of the table."""

    def write(some):
        proof = small_proof(tmp_path / "proof")
        proof.folder.mkdir()
        monkeypatch.setattr(type(proof), "open", lambda *_: {})
        monkeypatch.setattr(report, "judged_cases", lambda *_: some)
        published = {
            "diagnoser": {"commit": "some", "sources_sha256": "this"},
            "confinement": "none",
        }
        score = write_score(proof, 9, published)
        assert json.loads((proof.folder / "score.json").read_text()) == score
        with (proof.folder / "cases.csv").open(newline="") as file:
            lines = list(csv.DictReader(file))
        return score, (proof.folder / "index.html").read_text(), lines

    return write


def test_joints_without_robots_have_empty_rows_and_a_word_why(written):
    score, page, lines = written([joint()])
    assert "robots" not in score
    assert score["joint_group_f1"]["value"] is None
    assert "--robots" in score["left_out"]["joint_group_f1"]
    assert "<td>joint_group_f1" not in page
    (bare,) = re.findall("<p>No case speaks for (.*).</p>", page)
    assert {"joint_group_f1", "full_set_pairs"} <= set(bare.split(", "))
    assert "named_at_1_to_3_floor_left" not in bare
    assert score["named_at_1_to_3_floor_left"]["n"] == 1
    assert "<td>named_at_1_to_3_floor_left<td>1.000" in page
    assert "<td>5<td>1.2<td>" in page  # its size, and what tolerances leave of it
    assert "Whole robots" not in page
    assert lines[0]["joint_group_f1"] == lines[0]["true_phase"] == ""


def test_robots_without_joints_leave_the_joints_rows_empty(written, cases):
    score, page, lines = written(cases)
    assert score["cases"] == 6
    assert score["named_at_3_floor"]["value"] is None
    assert score["robots"]["rows"]["named_at_3_floor"]["n"] == 3
    assert score["joint_group_f1"]["n"] == 4
    assert "joint_group_f1" not in score["left_out"]
    assert "<h2>Whole robots: 6 cases</h2>" in page
    ours, robots = page.split("<h2>Whole robots")
    assert "<td>named_at_3_floor" not in ours
    assert "<td>named_at_3_floor" in robots
    assert "<p>No case speaks for named_at_3_floor, " in ours
    assert "figures/robots.png" in page
    assert "figures/power.png" not in page
    assert "joints F1 0.50; swing, true stance" in page
    assert lines[1]["joint_group_f1"] == "0.5000"
    assert (lines[1]["told_phase"], lines[1]["true_phase"]) == ("swing", "stance")
    assert (lines[1]["told_stance"], lines[1]["true_stance"]) == ("0", "0.9")
    assert (lines[2]["told_stance"], lines[5]["true_stance"]) == ("", "")


def test_both_stand_apart(written, cases):
    score, page, lines = written([joint(), *cases])
    assert (score["cases"], score["robots"]["cases"], len(lines)) == (7, 6, 7)
    assert score["named_at_3_floor"]["n"] == 1  # no robot among the joints
    assert score["false_alarms"]["n"] == 0
    for name in ("power", "robots", "robots_confusion"):
        assert f"src='figures/{name}.png'" in page


def test_nulls_alone_can_be_drawn(tmp_path, cases):
    assert set(draw_robots(cases[-1:], tmp_path, tmp_path)) == {"robots", "robots_confusion"}
