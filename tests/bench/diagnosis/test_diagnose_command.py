"""``busemu diagnose``, as a person types it."""

import json
import tomllib
from types import SimpleNamespace

import pytest
from diagnosing import busemu, refused, without_most, written
from swinging import ROBOT, swings

from bench.recording import Recording, write
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import additions, read_model

SIZE = 3.0
FILES = {"diagnosis.json", "model.toml", "report.html"}
KEYS = (
    "format",
    "verdict",
    "mismatch",
    "causes",
    "fit",
    "unexplained",
    "next_experiment",
    "limits",
)
CAUSE_KEYS = (
    "effect",
    "scope",
    "kind",
    "parameters",
    "held_out_gain_nats",
    "explained_share",
    "probability",
    "indistinguishable_from",
)
FIT_KEYS = {"metric", "before", "after", "noise_floor", "held_out", "recordings"}


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """Recordings in which nothing moves."""
    return written(tmp_path_factory.mktemp("still"), swings(moving=False))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """One run on recordings with more viscous friction than believed."""
    folder = tmp_path_factory.mktemp("found")
    paths = written(folder / "logs", swings("viscous_friction", SIZE))
    words = ["--robot", ROBOT, "--out", folder / "out", "--holdout", paths[2], *without_most()]
    done = busemu(*words, folder / "logs")
    assert done.returncode == 0, done.stderr
    document = json.loads((folder / "out" / "diagnosis.json").read_text())
    return SimpleNamespace(done=done, out=folder / "out", document=document, held=paths[2].stem)


def test_all_files_are_there_and_nothing_else(found):
    assert {path.name for path in found.out.iterdir()} == FILES


def test_json_has_the_keys_of_the_contract(found):
    document = found.document
    assert tuple(document)[: len(KEYS)] == KEYS
    assert document["format"] == "busemu-diagnosis/1"
    assert document["fit"].keys() == FIT_KEYS
    assert document["fit"]["metric"] == "rmse_rad"
    (cause,) = document["causes"]
    assert tuple(cause) == CAUSE_KEYS
    (parameter,) = cause["parameters"].values()
    assert {"value", "ci95", "unit"} <= parameter.keys()


def test_the_held_out_recording_judges(found):
    assert found.document["fit"]["held_out"] is True
    assert found.document["fit"]["recordings"] == [found.held]
    assert "3 recordings to fit, 1 held out" in found.done.stdout


def test_the_effect_is_named_and_the_summary_says_so(found):
    (cause,) = found.document["causes"]
    assert cause["effect"] == "viscous_friction"
    verdict = found.document["verdict"].replace("_", " ").upper()
    assert found.done.stdout.splitlines()[1].startswith(verdict)
    assert "viscous friction of arm" in found.done.stdout
    for name in FILES:
        assert str(found.out / name) in found.done.stdout


def test_the_report_is_of_the_same_verdict(found):
    page = (found.out / "report.html").read_text()
    assert f'class="verdict {found.document["verdict"]}"' in page
    assert str(found.out / "model.toml") in page


def test_the_model_is_a_robot_with_the_effect(found):
    robot = load_robot(found.out / "model.toml")
    assert "viscous_friction" in {addition.effect.name for addition in additions(robot)}
    believed = read_model(load_robot(ROBOT)).joints[0].drive.friction.viscous_nm_s_rad
    drive = read_model(robot).joints[0].drive
    typical = effect("viscous_friction").typical["more_nm_s_rad"]
    assert drive.friction.viscous_nm_s_rad > believed + typical
    with (found.out / "model.toml").open("rb") as file:
        assert "fitted to recordings" in str(tomllib.load(file)["effect"])


def test_stages_are_told_where_no_terminal_is(found):
    assert "fitting what the operator believes" in found.done.stderr


def test_recordings_of_another_robot_are_refused(still, tmp_path):
    done = busemu("--robot", "pendulum", "--out", tmp_path / "out", *still)
    refused(done, str(still[0]), "another robot")
    assert not (tmp_path / "out").exists()


def test_servos_that_the_robot_does_not_have_are_refused(tmp_path):
    read_once = SimpleNamespace(
        t_s=0.0, t_reply_s=0.001, servo_id=7, op="read", register="present_position", raw=2048
    )
    metadata = {"name": "seven", "source": "simulation", "servo": {"7": {"model": "XL330-M288"}}}
    path = write(Recording.of([read_once], metadata), tmp_path / "seven.parquet")
    done = busemu("--robot", ROBOT, "--out", tmp_path / "out", path)
    refused(done, str(path), "servo 7 is none of xl330-pendulum (it has 1)")


def test_recordings_in_which_nothing_moves_are_refused(still, tmp_path):
    done = busemu("--robot", ROBOT, "--out", tmp_path / "out", *still)
    refused(done, "present_position never changes", "record motions")


def test_a_file_of_few_rows_is_refused(tmp_path):
    (long,) = swings(speeds=(5.0,))
    rows = long.table.slice(0, 10)
    short = type(long).checked(rows, long.metadata)
    path = write(short, tmp_path / "short.parquet")
    refused(busemu("--robot", ROBOT, "--out", tmp_path / "out", path), "positions", "arm")


def test_a_file_that_is_no_recording_is_refused(tmp_path):
    path = tmp_path / "notes.csv"
    path.write_text("a,b\n1,2\n")
    refused(busemu("--robot", ROBOT, "--out", tmp_path / "out", path), str(path))


def test_unknown_names_are_refused(still, tmp_path):
    out = ("--out", tmp_path / "out")
    refused(busemu("--robot", "nobody", *out, *still), "no robot named 'nobody'")
    moving = written(tmp_path / "moving", swings(speeds=(5.0,)))
    done = busemu("--robot", ROBOT, *out, "--without", "magic", *moving)
    assert "no effect named 'magic'" in done.stderr
    assert not (tmp_path / "out").exists()
    mine = tmp_path / "out" / "mine.txt"
    mine.parent.mkdir()
    mine.write_text("there before")
    assert busemu("--robot", ROBOT, *out, "--without", "magic", *moving).returncode == 1
    assert mine.read_text() == "there before"
    mine.unlink()
    busemu("--robot", ROBOT, *out, "--without", "magic", *moving)
    assert mine.parent.exists()  # made by somebody else


def test_holding_everything_out_is_refused(still, tmp_path):
    words = ("--robot", ROBOT, "--out", tmp_path / "out", "--holdout", still[0])
    refused(busemu(*words, still[0]), "all recordings are held out")


def test_no_time_at_all_is_refused(still, tmp_path):
    words = ("--robot", ROBOT, "--out", tmp_path / "out", "--budget", "0")
    refused(busemu(*words, *still), "--budget must be more than 0")
