import json
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import pytest

from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.replay import HEIGHT
from bench.motions import WalkPlan
from bench.recording import Recording
from bench.studies import stance
from bench.studies.stance import CONTACT_CLASS, JOINT_CLASS, JOINTS, PARTS, Answer, scored, study
from bench.studies.stance_runs import (
    BARE,
    IMU,
    LOADS_KG,
    Cause,
    draw_runs,
    key_of,
    only,
    record,
    specimen,
)
from busemu.tables import load_robot
from sim.model import read_model


def cause_of(effect, *rivals):
    return {
        "effect": effect,
        "scope": ["leg1.femur", "leg1.tibia"],
        "kind": "missing",
        "parameters": {"stiffness_n_m": {"value": 1200.0, "ci95": [900.0, 1500.0], "unit": "N/m"}},
        "probability": 0.71,
        "indistinguishable_from": [{"effect": rival, "probability": 0.1} for rival in rivals],
    }


def document(*causes, verdict="explained", next_experiment=()):
    return {
        "verdict": verdict,
        "causes": list(causes),
        "fit": {"before": 5e-3, "after": 3e-3, "noise_floor": 2e-3},
        "next_experiment": list(next_experiment),
    }


def answer(run, *causes, verdict="explained"):
    return Answer(run, JOINTS, document(*causes, verdict=verdict))


def run_with(cause, seed=1):
    return next(run for run in draw_runs(seed) if run.cause is cause)


def test_every_cause_walks_once_under_each_load_in_an_order_of_its_own():
    runs = draw_runs(1)
    assert Counter((run.cause, run.payload_kg) for run in runs) == Counter(
        (cause, load) for cause in Cause for load in LOADS_KG
    )
    orders = {tuple(run.cause for run in draw_runs(seed)) for seed in range(5)}
    assert len(orders) == 5


def test_the_last_walk_of_a_run_is_under_the_other_load():
    for run in draw_runs(1):
        loads = [plan.payload_kg for _, plan in run.walks()]
        assert loads[:-1] == [run.payload_kg] * 2
        assert loads[-1] != run.payload_kg


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
        (("foot_compliance",), Cause.TIPS),
        (("ground_compliance", "gain_error"), Cause.TIPS),
        (("joint_compliance",), Cause.JOINTS),
        (("foot_compliance", "backlash"), Cause.BOTH),
        (("payload",), Cause.NEITHER),
    ],
)
def test_an_answer_is_the_classes_of_what_was_found(names, cause):
    assert answer(draw_runs(1)[0], *map(cause_of, names)).cause is cause


def test_classes_are_of_effects_that_exist():
    known = placed_effects(read_model(load_robot("marvin")))
    assert {placed.effect.name for placed in known.values()} >= CONTACT_CLASS | JOINT_CLASS


def test_an_answer_that_might_be_of_the_other_class_is_undecided_as_a_misfit_without_a_name_is():
    run = run_with(Cause.TIPS)
    assert answer(run, cause_of("foot_compliance")).word == "right"
    assert answer(run, cause_of("foot_compliance", "ground_compliance")).word == "right"
    assert answer(run, cause_of("foot_compliance", "joint_compliance")).word == "undecided"
    assert answer(run, cause_of("joint_compliance")).word == "wrong"
    assert answer(run, verdict="consistent").word == "wrong"
    assert answer(run, cause_of("foot_compliance"), cause_of("foot_slip")).word == "wrong"
    assert answer(run_with(Cause.NEITHER), cause_of("transport_delay")).word == "wrong"
    assert answer(run_with(Cause.NEITHER), verdict="consistent").word == "right"
    assert answer(run, verdict="unexplained").word == "undecided"
    both = cause_of("foot_compliance", "backlash"), cause_of("joint_compliance")
    assert answer(run_with(Cause.BOTH), *both).word == "right"


def test_the_score_counts_words_and_classes():
    wrong = answer(run_with(Cause.BOTH), cause_of("foot_compliance"))
    right = answer(run_with(Cause.NEITHER), verdict="consistent")
    assert scored([wrong, right]) == {
        "right": 1,
        "undecided": 0,
        "wrong": 1,
        "of": 2,
        "tips_right": 2,
        "joints_right": 1,
    }


def test_registers_beside_those_of_servos_are_given_only_where_they_are_asked_for():
    names = ["present_position", HEIGHT, IMU[0]]
    rows = [
        SimpleNamespace(t_s=t, t_reply_s=t, servo_id=servo, op="read", register=name, raw=raw)
        for t, servo, name, raw in zip(
            (0.1, 0.2, 0.3), (1, 0, 0), names, (512.0, 0.1, 0.2), strict=True
        )
    ]
    recording = Recording.of(rows, {"name": "walk", "robot": "marvin", "source": "emulator"})
    assert only(recording, ()).registers == ("present_position",)
    assert only(recording, {HEIGHT}).registers == (HEIGHT, "present_position")
    assert only(recording, IMU).registers == (IMU[0], "present_position")
    assert only(recording, {HEIGHT}).metadata == recording.metadata


def test_what_parts_give_beside_the_joints_is_recorded():
    recording = record(draw_runs(1)[0], WalkPlan(seconds=0.3), "walk")
    for part in PARTS:
        seen = only(recording, part.beside)
        assert {name for name in seen.registers if "/" in name} == part.beside


PROPOSAL = {
    "experiment": "locomotion",
    "arguments": {"trunk_load_kg": 0.15},
    "separates": ["foot_compliance", "joint_compliance"],
    "power": 0.93,
}
UNDECIDED = document(cause_of("foot_compliance", "joint_compliance"), next_experiment=[PROPOSAL])
JOINTS_FOUND = document(cause_of("joint_compliance"))
TIPS_FOUND = document(cause_of("foot_compliance"))


@pytest.fixture
def diagnosed(tmp_path, monkeypatch):
    """What is diagnosed, as ``told`` has it by the folder's name; all is undecided else."""
    told, asked = {}, []

    def diagnose(robot, recordings, folder, title, say):
        assert (tmp_path / "key.sha256").exists()
        assert not (tmp_path / "key.json").exists()
        asked.append((f"{folder.parent.name}/{folder.name}", robot.name, len(recordings)))
        folder.mkdir(parents=True)
        (folder / "diagnosis.json").write_text(json.dumps(told.get(asked[-1][0], UNDECIDED)))
        (folder / "model.toml").write_text("better")

    monkeypatch.setattr(stance, "_diagnose", diagnose)
    monkeypatch.setattr(stance, "recordings_of", lambda *_, bare=False: ["walk"] * (3 + bare))
    monkeypatch.setattr(stance, "only", lambda recording, beside: recording)
    monkeypatch.setattr(stance, "load_robot", lambda which: SimpleNamespace(name=str(which)))
    return told, asked


@pytest.mark.slow
def test_a_run_that_is_undecided_is_asked_with_more_and_then_walks_with_its_tips_off(
    tmp_path, diagnosed
):
    told, asked = diagnosed
    runs = draw_runs(5)
    sound, both = ([run for run in runs if run.cause is c] for c in (Cause.NEITHER, Cause.BOTH))
    told |= {f"{run.name}/joints": document(verdict="consistent") for run in sound}
    soft = [run for run in runs if run not in sound]
    seen, *rest = (run for run in soft if run not in both)
    told |= {f"{seen.name}/joints-and-inertial-sensor": TIPS_FOUND}
    told |= {f"{run.name}/joints-and-height": TIPS_FOUND for run in rest}
    told |= {f"{run.name}/{BARE}": JOINTS_FOUND for run in both}
    told |= {f"{run.name}/joints-and-tips-off": TIPS_FOUND for run in both}
    result = study(5, tmp_path, lambda stage: None)
    names = [f"{run.name}/joints" for run in runs]
    names += [f"{run.name}/joints-and-inertial-sensor" for run in soft]
    names += [f"{run.name}/joints-and-height" for run in soft if run is not seen]
    assert [where for where, _, _ in asked[:19]] == names
    assert {(robot, count) for _, robot, count in asked[:19]} == {("marvin", 3)}
    better = str(tmp_path / both[0].name / BARE / "model.toml")
    assert asked[19:21] == [
        (f"{both[0].name}/{BARE}", "marvin", 4),
        (f"{both[0].name}/joints-and-tips-off", better, 3),
    ]
    assert len(asked) == 23
    score = result["score"]
    assert [one["of"] for one in score.values()] == [8, 6, 5, 2, 8]
    assert score["joints"]["undecided"] == 6
    assert score["joints and tips off"]["right"] == 2
    last = {"right": 6, "undecided": 0, "wrong": 2, "of": 8, "tips_right": 6, "joints_right": 6}
    assert score["the last that was asked"] == last


@pytest.mark.slow
def test_diagnoses_that_are_there_are_not_made_again_and_the_key_is_told_last(tmp_path, diagnosed):
    _, asked = diagnosed
    result = study(5, tmp_path, lambda stage: None)
    key, digest = key_of(draw_runs(5), 5)
    assert (tmp_path / "key.json").read_text() == key
    assert (tmp_path / "key.sha256").read_text().startswith(digest)
    assert json.loads((tmp_path / "study.json").read_text()) == result
    asked.clear()
    assert study(5, tmp_path, lambda stage: None) == result
    assert asked == []


@pytest.mark.slow
def test_a_diagnosis_that_is_broken_is_told_by_its_file(tmp_path, diagnosed):
    study(5, tmp_path, lambda stage: None)
    broken = tmp_path / "run-3" / "joints" / "diagnosis.json"
    broken.write_text("{")
    with pytest.raises(ValueError, match=f"{broken}: .*delete it"):
        study(5, tmp_path, lambda stage: None)


@pytest.mark.slow
def test_the_page_says_what_was_hidden_what_was_said_and_what_would_tell_more(tmp_path, diagnosed):
    study(5, tmp_path, lambda stage: None)
    page = (tmp_path / "index.html").read_text()
    both = run_with(Cause.BOTH, 5)
    assert f"tips {both.tips_n_m:.0f} N/m, femurs and tibiae {both.joints_rad_nm:.2f}" in page
    assert "foot compliance of leg1.femur and leg1.tibia: " in page
    assert "1200 N/m (900 to 1500), probability 0.71; or joint compliance" in page
    assert "locomotion with trunk_load_kg = 0.15" in page
    for part in PARTS:
        for run in draw_runs(5):
            assert f"{run.name}/{part.folder}/phase.png" in page


def test_tips_that_are_off_do_not_give():
    run = run_with(Cause.TIPS)
    _, plan = run.walks()[0]
    give, stiff = (specimen(run, plan, bare=bare).body for bare in (False, True))
    assert give != stiff
    assert stiff == specimen(replace(run, cause=Cause.NEITHER), plan).body
