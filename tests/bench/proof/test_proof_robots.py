"""A robot's case from its seed to its score, as a person types it."""

import json
import subprocess
import sys

import pytest

from bench.proof import confined
from bench.proof.robot_plan import QUICK_EFFECTS
from bench.proof.robot_scoring import GOALS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    """The folder of a proof of one robot with a small catalogue, and what was said."""
    folder = tmp_path_factory.mktemp("robots") / "proof"
    told = ("--seed", "3", "--out", str(folder), "--quick", "--cases", "0", "--robots", "1")
    command = (sys.executable, "-c", "from busemu.cli import main; main()", "prove", *told)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_a_robot_is_diagnosed_as_a_whole_by_a_confined_process(proof):
    folder, _ = proof
    told = json.loads((folder / "published.json").read_text())
    assert told["confinement"].startswith("Landlock" if confined.version() else "none")
    answer = folder / "diagnoses" / "robot-0001"
    assert json.loads((answer / "run.json").read_text())["failure"] == ""
    assert {"diagnosis.json", "model.toml", "trace.npz"} <= {p.name for p in answer.iterdir()}
    diagnosis = json.loads((answer / "diagnosis.json").read_text())
    assert diagnosis["fit"]["held_out"]
    assert {c["effect"] for c in diagnosis["causes"]} <= set(QUICK_EFFECTS)


def test_its_key_has_joints_and_phase_and_its_score_rows_of_its_own(proof):
    folder, said = proof
    key = json.loads((folder / "keys" / "robot-0001.json").read_text())
    assert key["kind"] == "single"
    (hidden,) = key["effects"]
    assert set(hidden["joints"]) >= {"leg1.coxa", "leg6.tibia"}
    assert 0.0 <= key["stance_share"] <= 1.0
    score = json.loads((folder / "score.json").read_text())
    assert score["robots"]["cases"] == score["cases"] == 1
    assert score["robots"]["beside"]["failed"]["value"] == 0.0
    for name in GOALS:
        assert score[name]["at_all_sizes"]["n"] == 1
    assert score["named_at_3_floor"]["value"] is None
    assert "Whole robots: 1 cases" in (folder / "index.html").read_text()
    assert "1 cases of whole robots: 1 single" in said
