"""Several runs counted together, from the tables that they left."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.proof.scoring import AT_1, AT_3
from bench.proof.table import write_table
from bench.proof.together import NEEDED, app, errors, held, page, read_tables, rows
from tests.bench.proof.judged_cases import hidden_in, judged, robot_diagnosis, robot_key

EMPTY = ("true_parameters", "parameters", "explained_share", "joint_group_f1", "rig")
FLAGS = ("first_right", "full_set_right", "certain_and_wrong")


def case(kind="single", ratio=4.0, verdict="explained", labels="", **more):
    flags = dict.fromkeys(FLAGS, "0") | {"true_phase": "", "told_phase": ""}
    numbers = dict.fromkeys(EMPTY, "")
    named = " ".join("an_effect:0.7" for _ in labels.split())
    given = {"kind": kind, "ratio": str(ratio), "verdict": verdict, "labels": labels}
    given |= {"named": named}
    return flags | numbers | given | {name: str(value) for name, value in more.items()}


def counted(name, *cases):
    (found,) = [row for key, row in rows(cases).items() if key.startswith(name)]
    return found["value"], found["n"]


def test_sizes_count_where_they_belong():
    few = [
        case(ratio=AT_3 + 0.01, first_right=1),
        case(ratio=AT_3 + 0.01),
        case(ratio=AT_3 - 0.01, first_right=1),
        case(ratio=AT_1 - 0.01),
        case("pair", ratio=9.0, full_set_right=1),
        case("pair", ratio=AT_3 - 0.01),
    ]
    assert counted("class right at", *few) == (0.5, 2)
    assert counted("the same at", *few) == (1.0, 1)
    assert counted("full set", *few) == (1.0, 1)
    assert counted("the same, pairs", *few) == (0.5, 2)


def test_sizes_of_a_walk_count_where_a_run_has_them():
    few = [case(ratio_walking=x, first_right=int(x != "2.9")) for x in ("3.0", "2.9", "0.9", "")]
    assert counted("class right where it moves", *few, case(first_right=1)) == (1.0, 1)
    assert counted("the same by 1 to 3", *few) == (0.0, 1)


def test_what_tolerances_leave_counts_where_it_was_measured():
    right = ("3.0", "2.9", "0.9")
    sizes = (*right, "3.1", "1.0", "0.1", "0.2", "")
    few = [case(ratio_left=x, first_right=int(x in right)) for x in sizes]
    few.append(case("pair", ratio_left=4.0, first_right=1))
    assert counted("class right where tolerances", *few) == (0.5, 2)
    assert counted("the same where they leave 1 to 3", *few) == (0.5, 2)
    assert counted("the same where they leave less", *few) == (pytest.approx(1 / 3), 3)


def test_a_null_may_alarm_without_a_name():
    nulls = [
        case("null", "nan", "consistent"),
        case("null", "nan", "unexplained"),
        case("null", "nan", "explained", "wrong"),
        case(verdict="unexplained"),
    ]
    assert counted("nulls that are", *nulls) == (pytest.approx(2 / 3), 3)
    assert counted("nulls that have", *nulls) == (pytest.approx(1 / 3), 3)


def test_every_name_counts_and_so_does_what_is_sure_and_wrong():
    few = [
        case(labels="hidden ordinary"),
        case(labels="hidden wrong", certain_and_wrong=1),
        case("null", "nan", "consistent"),
    ]
    assert counted("names", *few) == (0.75, 4)
    assert counted("confidently", *few) == (pytest.approx(1 / 3), 3)


def test_probabilities_are_held_against_what_of_them_is_true():
    few = [
        case(labels="hidden wrong", named="gain_error:0.95 backlash:0.35"),
        case(labels="hidden", named="foot_slip:0.35"),
        case("null", "nan", "consistent"),
    ]
    assert counted("calibration", *few) == (pytest.approx((0.05 + 2 * 0.15) / 3), 3)


def test_deleted_effects_count_by_what_is_said_of_them():
    few = [
        case("deleted", verdict="unexplained"),
        case("deleted", verdict="partly_explained", labels="ordinary"),
        case("deleted", verdict="partly_explained", labels="ordinary wrong"),
        case("deleted", verdict="consistent"),
        case("deleted", ratio=AT_3 - 0.01, labels="wrong"),
        case(labels="wrong"),
    ]
    assert counted("true effect deleted", *few) == (0.5, 4)
    assert counted("deleted: a wrong name", *few) == (0.25, 4)


def test_what_names_take_away_is_a_mean_over_cases_that_have_a_name():
    few = [
        case(explained_share="0.9"),
        case("pair", ratio=AT_1 + 0.01, explained_share="0.5"),
        case("triple", explained_share="-0.2"),
        case(ratio=AT_1 - 0.01, explained_share="0"),
        case("deleted", explained_share="0"),
        case(),
    ]
    assert counted("share of explainable", *few) == (pytest.approx(0.4), 3)


def test_an_error_is_of_how_far_a_size_is_from_off():
    told = case(
        rig="phantomx-walk",
        true_parameters="gain_error.scale=0.8 payload.mass_kg=0.5 foot_compliance.stiffness_n_m=200"
        " ground_tilt.pitch_rad=0.1 ground_tilt.roll_rad=0.2",
        parameters="gain_error.scale=0.85[0.8;0.9] foot_compliance.stiffness_n_m=260[200;300] "
        "ground_tilt.pitch_rad=0.09[0.08;0.1] ground_tilt.roll_rad=0.1[0;0.2] "
        "link_mass.scale=1[1;1]",
    )
    assert list(errors(told)) == pytest.approx([0.25, 0.3, 0.1])
    found, count = counted("parameter error", told, told | {"kind": "pair"})
    assert (found, count) == (pytest.approx(0.25), 3)


def test_joints_count_where_something_large_is_hidden():
    few = [
        case(joint_group_f1="1"),
        case("deleted", joint_group_f1="0.5"),
        case("null", "nan", joint_group_f1=""),
        case(ratio=AT_3 - 0.01, joint_group_f1="0"),
    ]
    assert counted("joint group F1", *few) == (0.75, 2)


def test_a_phase_counts_where_one_is_told():
    few = [
        case(true_phase="stance", told_phase="stance"),
        case(true_phase="all", told_phase="stance"),
        case(true_phase="all"),
    ]
    assert counted("phase", *few) == (0.5, 2)


def test_a_share_of_stance_counts_where_a_run_has_it():
    few = [
        case(told_phase="all", told_stance="0.4", true_stance="0.3"),
        case(told_phase="all", told_stance="0.5", true_stance="0.7"),
        case(told_phase="stance", told_stance="1", true_stance="0.2"),
        case(told_phase="stance", told_stance="0.9"),
        case(true_stance="0.5"),
    ]
    assert counted("share of stance", *few, case(told_phase="all")) == (pytest.approx(0.2), 3)


def test_an_interval_is_asked_for_its_own_truth():
    told = case(
        true_parameters="gain_error.scale=0.8 payload.mass_kg=0.5 tilt.roll_rad=-0.1 far.k=inf",
        parameters="payload.mass_kg=0.51[0.49;0.53] gain_error.scale=0.9[0.85;0.95] "
        "tilt.roll_rad=-0.2[-0.3;-0.05] far.k=none[3;none] other.k=1[0;2]",
    )
    assert list(held(told)) == [False, True, True]


def test_tables_of_a_proof_are_read_together(tmp_path: Path):
    right = judged(
        robot_key("single", hidden_in("payload", ["leg1.femur"], mass_kg=(0.5, 0.0))),
        robot_diagnosis(),
        "robot-1",
    )
    paths = [tmp_path / "one.csv", tmp_path / "two.csv"]
    for path in paths:
        write_table([right], path)
    told = CliRunner().invoke(app, [str(path) for path in paths])
    lines = told.output.splitlines()
    assert told.exit_code == 0
    assert lines[0] == "| score | value | cases | 95 % |"
    assert lines == list(page(read_tables(paths)))
    assert any(line.startswith("| confidently wrong | 0 | 2 | 0.00 - ") for line in lines)


def test_another_file_is_named_with_what_it_lacks(tmp_path: Path):
    other = tmp_path / "other.csv"
    other.write_text(f"{','.join(sorted(NEEDED - {'labels'}))}\n", encoding="utf-8")
    told = CliRunner().invoke(app, [str(other)])
    assert told.exit_code == 1
    assert told.output == f"error: {other}: no column 'labels': name the cases.csv of a proof\n"
    told = CliRunner().invoke(app, [str(tmp_path / "none.csv")])
    assert told.exit_code == 1
    assert "none.csv" in told.output
