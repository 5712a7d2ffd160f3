from collections import Counter
from types import SimpleNamespace

import pytest

from bench.diagnosis.robot_effects import placed_effects
from bench.studies.stance import JOINTS, RIVALS, TIPS, Answer
from bench.studies.stance_runs import LOADS_KG, Cause, draw_runs, key_of
from busemu.tables import load_robot
from sim.model import read_model


def test_every_cause_walks_once_under_each_load_in_an_order_of_its_own():
    runs = draw_runs(1)
    assert Counter((run.cause, run.payload_kg) for run in runs) == Counter(
        (cause, load) for cause in Cause for load in LOADS_KG
    )
    orders = {tuple(run.cause for run in draw_runs(seed)) for seed in range(5)}
    assert len(orders) == 5


def test_a_runs_name_tells_nothing_and_the_hash_gives_the_key_away_to_nobody():
    runs = draw_runs(1)
    assert [run.name for run in runs] == [f"run-{n}" for n in range(1, 9)]
    key, digest = key_of(runs, 1)
    other, changed = key_of(draw_runs(2), 2)
    assert key != other
    assert digest != changed


def test_what_is_not_there_is_not_in_the_key():
    for run in draw_runs(3):
        told = run.told()
        assert (told["tips_n_m"] is not None) == run.cause.tips
        assert (told["joints_rad_nm"] is not None) == run.cause.joints


@pytest.mark.parametrize(
    ("names", "cause"),
    [
        ((), Cause.NEITHER),
        (("foot_compliance@all",), Cause.TIPS),
        (("ground_compliance@all", "gain_error@all"), Cause.TIPS),
        (("joint_compliance@tibia",), Cause.JOINTS),
        (("foot_compliance@all", "backlash@femur"), Cause.BOTH),
        (("payload@all",), Cause.NEITHER),
    ],
)
def test_an_answer_is_the_classes_of_what_was_found(names, cause):
    assert Answer(draw_runs(1)[0], "joints", SimpleNamespace(names=names)).cause is cause


def test_all_that_is_asked_about_exists():
    assert set(TIPS + JOINTS + RIVALS) <= set(placed_effects(read_model(load_robot("marvin"))))
