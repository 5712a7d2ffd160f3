"""``busemu diagnose`` of a robot on legs, as a person types it."""

import json
import math
from types import SimpleNamespace

import pytest
from programs import busemu
from walking_robots import believed, marvin

from bench.diagnosis.result import Estimate
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.gains import NEEDED
from bench.diagnosis.robot.improved import of_causes, write_model
from bench.diagnosis.robot.model import ENGINES_RAD
from bench.recording import write
from bench.running import Steering, in_process, walk_in
from busemu.tables import load_robot
from busemu.timing import load_profile
from sim.model import additions, read_model
from sim.world import BulletPlant

pytestmark = pytest.mark.slow

NAME, STIFFNESS_N_M = "foot_compliance", 600.0
KNOWN = (NAME, "joint_compliance", "gain_error")
FILES = {"diagnosis.json", "model.toml", "report.html", "phase.png"}


def walk(robot, name, seed):
    plant = BulletPlant(robot)
    session = in_process(robot, plant, load_profile(robot.timing))
    walk_in(session, Steering(seconds=4.0, seed=seed))
    plant.close()
    return session.recording(name, name)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two walks of a Marvin on rubber tips that its file does not have."""
    folder = tmp_path_factory.mktemp("logs")
    placed = placed_effects(believed())[f"{NAME}@all"]
    found = {placed.parameter.name: Estimate(STIFFNESS_N_M, (0.0, 1e6), "N/m")}
    write_model(marvin(), of_causes([(placed, found)], "made up"), folder / "soft.toml")
    soft = load_robot(folder / "soft.toml")
    return [write(walk(soft, f"walk-{n}", n), folder / f"walk-{n}.parquet") for n in (1, 2)]


@pytest.fixture(scope="module")
def found(logs, tmp_path_factory):
    out = tmp_path_factory.mktemp("found")
    known = {placed.effect.name for placed in placed_effects(believed()).values()}
    left_out = [word for name in sorted(known - set(KNOWN)) for word in ("--without", name)]
    words = ["--robot", "marvin", "--out", out, "--holdout", logs[1], *left_out, logs[0]]
    done = busemu("diagnose", *words, timeout_s=900.0)
    assert done.returncode == 0, done.stderr
    document = json.loads((out / "diagnosis.json").read_text())
    return SimpleNamespace(done=done, out=out, document=document)


def test_all_files_are_there_and_no_progress_is_left(found):
    assert {path.name for path in found.out.iterdir()} == FILES


def test_the_tips_are_named_with_their_stiffness(found):
    (cause,) = found.document["causes"]
    assert cause["effect"] == NAME
    assert cause["scope"] == [f"leg{n}" for n in range(1, 7)]
    assert cause["parameters"]["stiffness_n_m"]["value"] == pytest.approx(STIFFNESS_N_M, rel=0.3)
    assert cause["probability"] > 0.8  # of names that gain so much eight or nine in ten were true


def test_the_held_out_walk_is_nearer_than_before(found):
    fit = found.document["fit"]
    assert fit["held_out"] is True
    assert fit["recordings"] == ["walk-2"]
    sound = math.hypot(fit["noise_floor"], ENGINES_RAD)  # PyBullet walked, and is not what replays
    assert fit["after"] < sound < fit["before"]


def test_how_much_joints_shake_is_told_by_their_kind_and_phase(found):
    shaking = found.document["details"]["shaking"]
    assert {name.split()[1] for name in shaking["log_ratio"]} == {"stance", "swing"}
    assert len(shaking["log_ratio"]) == 6
    assert shaking["left_nats"] < NEEDED
    assert not any("shake" in limit for limit in found.document["limits"])


def test_the_mismatch_has_joints_phases_shares_and_chances(found):
    assert found.document["mismatch"]
    for place in found.document["mismatch"]:
        assert set(place["joints"]) <= {joint.name for joint in believed().joints}
        assert place["phase"] in ("stance", "swing")
        assert 0.0 < place["share"] <= 1.0
        assert 0.0 <= place["p_value"] <= 1.0  # by its share, whatever it would tell alone


def test_the_better_model_is_a_robot_with_the_tips(found):
    robot = load_robot(found.out / "model.toml")
    assert NAME in {addition.effect.name for addition in additions(robot)}
    stiffness = [leg.foot.stiffness_n_m for leg in read_model(robot).legs]
    assert stiffness == [pytest.approx(STIFFNESS_N_M, rel=0.3)] * 6


def test_the_report_and_the_summary_say_the_same(found):
    page = (found.out / "report.html").read_text()
    assert f'class="verdict {found.document["verdict"]}"' in page
    assert "foot compliance of leg1" in found.done.stdout
    assert str(found.out / "model.toml") in found.done.stdout


def test_an_effect_that_no_walk_shows_is_no_name(logs, tmp_path):
    done = busemu("diagnose", "--robot", "marvin", "--out", tmp_path, "--without", "magic", *logs)
    assert done.returncode == 1
    assert "no effect named 'magic' for a whole robot" in done.stderr
