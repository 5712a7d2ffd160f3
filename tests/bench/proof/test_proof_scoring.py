"""The score of cases made by hand: numbers counted by hand."""

import csv
import json
import math

import numpy as np
import pytest
from judged_cases import cause, diagnosis, effect, judged, key

from bench.files import finite
from bench.proof.intervals import bootstrap, wilson
from bench.proof.scoring import GOALS, beside, calibration_error, score
from bench.proof.table import COLUMNS, write_table


def backlash(ratio):
    return effect("backlash", ratio, width_rad=(0.02, 0.0))


def single(ratio, *causes, **more):
    return judged(key("single", backlash(ratio)), diagnosis(*causes, **more))


RIGHT = cause("backlash", 0.95, width_rad=(0.022, 0.018, 0.026))
CLOSE = cause("backlash", 0.95, width_rad=(0.0202, 0.0201, 0.0203))
WRONG = cause("cable_drag", 0.95)
PUNCH = effect("punch", duty=(0.02, 0.0))


@pytest.fixture(scope="module")
def rows():
    cases = [
        single(8.0, RIGHT),
        single(3.0, CLOSE),
        single(5.0, WRONG),
        single(2.9, cause("dead_zone", 0.6, rivals=[("backlash", 0.3)])),
        single(1.0, RIGHT),
        single(2.0, after=0.01),
        single(0.5, after=0.01),
        judged(key("null"), diagnosis()),
        judged(key("null"), diagnosis()),
        judged(key("null"), diagnosis(WRONG)),
        judged(key("null"), diagnosis(verdict="unexplained")),
        judged(key("deleted", effect("punch", 5.0)), diagnosis(verdict="unexplained")),
        judged(key("deleted", effect("punch", 5.0)), diagnosis(WRONG)),
        judged(key("deleted", effect("punch", 2.0)), diagnosis()),
        judged(key("pair", backlash(5.0), PUNCH), diagnosis(RIGHT)),
        judged(
            key("pair", backlash(2.0), PUNCH),
            diagnosis(RIGHT, cause("dead_zone", 0.5)),
        ),
    ]
    return score(cases), beside(cases)


def test_every_row_has_value_number_interval_and_goals(rows):
    found, _ = rows
    assert set(found) == set(GOALS) - {"resolved_by_experiment"}
    for row in found.values():
        assert {"value", "n", "ci95", "good", "great", "met"} <= set(row)
        if row["value"] is not None:
            assert row["ci95"][0] <= row["value"] <= row["ci95"][1]
    assert found["full_set_triples"]["value"] is None
    assert found["full_set_triples"]["met"] == "unknown"


def test_naming_is_counted_by_size(rows):
    found, more = rows
    large = found["named_at_3_floor"]
    assert (large["value"], large["n"]) == (0.75, 4)  # two by name, one by the class it states
    assert large["by_name"]["value"] == 0.5
    assert large["top_2"]["value"] == 0.75
    assert large["nothing_else"]["value"] == 0.5
    assert (found["named_at_1_to_3_floor"]["value"], found["named_at_1_to_3_floor"]["n"]) == (
        0.5,
        2,
    )
    assert more["named_below_floor"]["n"] == 1
    assert more["named_below_floor"]["nothing_named"]["value"] == 1.0


def left(ratio, beside_tolerances, *causes):
    hidden = effect("backlash", ratio, beside_tolerances, width_rad=(0.02, 0.0))
    return judged(key("single", hidden), diagnosis(*causes))


def test_naming_is_counted_by_what_tolerances_leave_too():
    cases = [
        left(8.0, 3.0, RIGHT),
        left(8.0, 2.9, WRONG),  # no slack: what is left is measured, not asked for
        left(8.0, 1.0, RIGHT),
        left(3.0, 0.4),
        left(0.9, 0.9),
        single(8.0, RIGHT),  # a key of before: nobody measured
        judged(key("null"), diagnosis()),
        judged(
            key("pair", effect("backlash", 5.0, 4.0, width_rad=(0.02, 0.0)), PUNCH), diagnosis()
        ),
    ]
    found, more = score(cases), beside(cases)
    counted = {
        name: (row["value"], row["n"]) for name, row in (found | more).items() if "left" in name
    }
    assert counted == {
        "named_at_3_floor_left": (1.0, 1),
        "named_at_1_to_3_floor_left": (0.5, 2),
        "named_below_floor_left": (0.0, 2),
    }
    assert found["named_at_3_floor"]["n"] == 5  # sizes are what they were
    assert found["named_at_3_floor_left"]["top_2"]["great"] == 0.99


def test_what_is_left_of_several_is_that_of_the_smallest():
    pair = judged(key("pair", effect("backlash", 5.0, 4.0), effect("punch", 5.0, 0.5)), diagnosis())
    assert (pair.ratio, pair.left) == (5.0, 0.5)
    assert math.isnan(judged(key("null"), diagnosis()).left)


def test_alarms_and_wrong_names_are_counted(rows):
    found, _ = rows
    assert found["false_alarms"]["value"] == 0.5
    assert found["false_alarms"]["names_a_cause"]["value"] == 0.25
    assert found["confidently_wrong"]["value"] == 3 / 16
    assert found["confidently_wrong"]["of_the_certain"]["n"] == 8
    assert found["deleted_unexplained"]["value"] == 0.5
    assert found["deleted_unexplained"]["at_all_sizes"]["value"] == 1 / 3
    assert found["deleted_wrong_name"]["value"] == 0.5


def test_sets_are_counted_at_three_times_the_floor_and_at_all_sizes(rows):
    pairs = rows[0]["full_set_pairs"]
    assert (pairs["value"], pairs["n"]) == (0.0, 1)
    assert (pairs["at_all_sizes"]["value"], pairs["at_all_sizes"]["n"]) == (0.5, 2)
    assert pairs["no_wrong_name"]["value"] == 1.0


def test_parameters_are_counted(rows):
    found, _ = rows
    assert found["parameter_error"]["n"] == 2
    assert found["parameter_error"]["value"] == pytest.approx(0.055)  # of 10 % and 1 %
    assert found["coverage"]["n"] == 5  # RIGHT four times, in pairs too, CLOSE once
    assert found["coverage"]["value"] == pytest.approx(4 / 5)


def test_the_explained_share_is_a_mean_over_cases(rows):
    share = rows[0]["explained_share"]
    # singles and pairs at the floor or more: 7 with (100 - 4) / 99, one that removed nothing
    assert share["n"] == 8
    assert share["value"] == pytest.approx(7 / 8 * 96 / 99)
    assert share["median"]["value"] == pytest.approx(96 / 99)


def test_the_calibration_error_is_the_mean_gap_of_the_bins():
    told = np.array([[0.95, 1], [0.95, 0], [0.45, 0], [0.45, 1], [0.45, 0], [0.45, 0]])
    # the bin at 0.95: half right, gap 0.45; the bin at 0.45: a quarter right, gap 0.20
    assert calibration_error(told) == pytest.approx((2 * 0.45 + 4 * 0.20) / 6)
    assert calibration_error(np.array([[1.0, 1.0]])) == 0.0


def test_wilsons_interval_is_the_published_one():
    # Agresti and Coull, Am. Stat. 52 (1998): 0 of 10 gives (0, 0.278)
    low, high = wilson(0, 10)
    assert low == 0.0
    assert high == pytest.approx(0.2775, abs=5e-4)
    assert wilson(10, 10) == pytest.approx((1.0 - high, 1.0))


def test_the_bootstrap_draws_whole_cases():
    same = [np.full(20, 0.0), np.full(20, 1.0)]
    low, high = bootstrap(same, lambda x: float(x.mean()))
    assert (low, high) == (0.0, 1.0)  # forty rows, but only two cases


def test_goals_are_met_on_the_right_side():
    good = score([judged(key("null"), diagnosis()) for _ in range(30)])
    assert good["false_alarms"]["met"] == "great"
    bad = score([judged(key("null"), diagnosis(WRONG)) for _ in range(30)])
    assert bad["false_alarms"]["met"] == "no"
    assert bad["confidently_wrong"]["met"] == "no"


def test_intervals_that_cover_everything_are_not_great():
    wide = cause("backlash", 0.95, width_rad=(0.02, 0.0, 1.0))
    covered = score([single(5.0, wide) for _ in range(10)])["coverage"]
    assert covered["value"] == 1.0
    assert covered["met"] == "good"


def test_a_score_is_json_that_others_can_read(rows):
    text = json.dumps(finite(rows[0]), allow_nan=False)
    assert json.loads(text)["false_alarms"]["n"] == 4


def test_the_table_has_every_case_in_a_line(tmp_path):
    cases = [left(5.0, 2.345, RIGHT), judged(key("null"), None, failure="took too long")]
    write_table(cases, tmp_path / "cases.csv")
    with (tmp_path / "cases.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert tuple(lines[0]) == COLUMNS
    assert lines[0]["named"] == "backlash:0.950"
    assert lines[0]["parameters"] == "backlash.width_rad=0.022[0.018;0.026]"
    assert lines[0]["true_parameters"] == "backlash.width_rad=0.02"
    assert lines[1]["failure"] == "took too long"
    assert [(line["ratio"], line["ratio_left"]) for line in lines] == [("5", "2.35"), ("nan", "")]
