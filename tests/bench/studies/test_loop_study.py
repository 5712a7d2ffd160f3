from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from bench.diagnosis.robot.judging import rmse_rad
from bench.experiments.locomotion_result import TORQUE_LIMIT
from bench.gaits.candidate import Candidate
from bench.motions import WalkPlan
from bench.studies import loop, loop_gaits
from bench.studies.loop import FITTED, JUDGING, UNSEEN, compared, emulated, hidden, lines
from bench.studies.loop_gaits import really, short_of_torque
from bench.studies.stance_runs import Cause
from busemu.tables import load_robot

SECONDS = 1.0


@pytest.fixture(scope="module")
def walked():
    return emulated(load_robot("marvin"), WalkPlan(SECONDS), "walk")


def test_a_walk_is_no_way_off_itself(walked):
    robot = load_robot("marvin")
    same = compared(robot, walked.recording, walked.recording)
    assert rmse_rad([same]) == 0.0
    assert len(same.modelled_rad) == len(robot.servos)


def test_the_same_program_walks_the_same_again_and_another_robot_otherwise(walked):
    robot = load_robot("marvin")
    again = emulated(robot, WalkPlan(SECONDS), "again")
    assert again.travelled_m == walked.travelled_m
    heavy = emulated(robot, WalkPlan(SECONDS, payload_kg=0.3), "heavy")
    assert rmse_rad([compared(robot, walked.recording, heavy.recording)]) > 0.0


def test_a_model_is_short_of_the_torque_that_another_needs_beyond_it(walked):
    robot = load_robot("marvin")
    heavy = emulated(robot, WalkPlan(SECONDS, payload_kg=0.3), "heavy").recording
    same, more = (walked.recording, walked.recording, SECONDS), (heavy, walked.recording, SECONDS)
    assert short_of_torque(robot, [same]) == 0.0
    assert short_of_torque(robot, [same, more]) == short_of_torque(robot, [more]) > 0.02
    unloaded = (walked.recording, heavy, SECONDS)
    assert short_of_torque(robot, [unloaded]) < short_of_torque(robot, [more])


def test_both_models_go_on_from_the_gait_of_the_first_with_what_each_is_short(monkeypatch, walked):
    asked = []

    def searched(robot, short, folder, _say, begin=None):
        asked.append((robot, short, folder.name, begin))
        return SimpleNamespace(candidate="gait")

    monkeypatch.setattr(loop, "emulated", lambda robot, *_: SimpleNamespace(recording=robot))
    monkeypatch.setattr(loop_gaits, "searched", searched)
    monkeypatch.setattr(
        loop_gaits, "short_of_torque", lambda _robot, walks: {"b": 0.2, "a": 0.1}[walks[0][1]]
    )
    monkeypatch.setattr(loop_gaits, "told", lambda _run, _found, short, _say: short)
    known, say = [(UNSEEN, walked.recording)], [].append
    told = loop._gaits(hidden(1), {"before": "b", "after": "a"}, known, Path("out"), say)
    assert told == {"before": 0.2, "after": 0.1}
    assert asked == [
        ("b", 0.2, "gaits-before", None),
        ("b", 0.2, "gaits-before", "gait"),
        ("b", 0.2, "gaits-before", "gait"),
        ("a", 0.1, "gaits-after", "gait"),
    ]


def test_nobody_has_seen_the_walk_that_judges_the_loop():
    seen = [*FITTED.values(), *JUDGING.values()]
    assert UNSEEN not in seen
    assert {(p.v_left, p.v_right) for p in seen}.isdisjoint({(UNSEEN.v_left, UNSEEN.v_right)})


def test_what_is_hidden_is_in_the_key():
    told = hidden(1).told()
    assert hidden(1).cause is Cause.BOTH
    assert told["tips_n_m"] > 0.0
    assert told["joints_rad_nm"] > 0.0


def test_the_result_in_words_has_all_numbers():
    walked = {"speed_m_s": 0.17, "torque_of_stall": 0.77, "allowed": 1, "of": 3}
    result = {
        "causes": [{"effect": "foot_compliance", "scope": ["leg1", "leg2"]}],
        "walking_rmse_rad": {"before": 0.012, "after": 0.004, "floor": 0.003},
        "rmse_rad": {"before": 0.015, "after": 0.0051, "floor": 0.0032},
        "travelled_m": {"real": 0.5, "before": 0.6, "after": 0.51},
        "seconds": 5.0,
        "gaits": {
            "before": {"model": {"speed_m_s": 0.189, "short_of_torque": 0.12}, "robot": walked},
            "after": {},
        },
    }
    told = " ".join(lines(result))
    words = ("foot_compliance of 2", "12.00 mrad", "4.00", "3.00", "0.500", "0.600", "0.510")
    more = ("15.00 mrad", "5.10", "3.20", "189 mm/s", "170 mm/s", "0.77", "1 of 3", "after: none")
    for word in (*words, *more, "0.12 of stall below"):
        assert word in told


@pytest.mark.slow
def test_the_robot_itself_walks_a_gait_that_was_found(monkeypatch):
    monkeypatch.setattr(loop_gaits, "CHECK_S", 5.0)
    original = Candidate.original(load_robot("marvin"))
    one = really(hidden(1), original, seed=0)
    assert not one.fell
    assert 0.02 < one.speed_m_s < 0.06  # the file's own gait: about 36 mm/s
    assert one.allowed is (one.torque_of_stall < TORQUE_LIMIT)
    longer = really(hidden(1), replace(original, v_left=2.0, v_right=2.0), seed=0)
    assert longer.speed_m_s > 1.5 * one.speed_m_s


def test_the_better_model_goes_on_from_the_gait_that_was_there(monkeypatch, tmp_path):
    plans, limits = [], []

    class Search:
        def __init__(self, _robot, plan, ledger, *_others):
            plans.append(plan)
            limits.append(ledger.torque_limit)

        def run(self):
            return SimpleNamespace(found=["found"])

    monkeypatch.setattr(loop_gaits, "GaitSearch", Search)
    robot, gait = load_robot("marvin"), Candidate.original(load_robot("marvin"))
    for begin in (None, gait):
        assert loop_gaits.searched(robot, 0.1, tmp_path, print, begin) == "found"
    assert limits == [pytest.approx(TORQUE_LIMIT - 0.1)] * 2
    first, more = plans
    assert (first.begin, more.begin) == (None, gait)
    assert (first.budget, more.budget) == (loop_gaits.PLAN.budget, loop_gaits.MORE)
