"""A diagnosis that is stopped: what it leaves, and how it goes on."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from diagnosing import busemu, without_most, written
from swinging import ROBOT, swings

from bench.diagnosis.journal import FOLDER
from busemu.tables import load_robot
from sim.model import read_model

pytestmark = pytest.mark.slow

FILES = {"diagnosis.json", "model.toml", "report.html"}
SECONDS = "0.001"  #: no time for any step


def told(folder):
    """The answers, less what is of the run and not of the recordings."""
    document = json.loads((folder / "diagnosis.json").read_text())
    document["details"].pop("rollouts")
    return document


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    written(folder, swings("viscous_friction", 3.0))
    return folder


@pytest.fixture(scope="module")
def whole(logs, tmp_path_factory):
    """The answers of a run that nothing stops."""
    out = tmp_path_factory.mktemp("whole")
    done = busemu("--robot", ROBOT, "--out", out, *without_most(), logs)
    assert done.returncode == 0, done.stderr
    return told(out)


def test_too_little_time_gives_a_valid_result_that_says_so_and_goes_on(logs, whole, tmp_path):
    words = ("--robot", ROBOT, "--out", tmp_path, *without_most(), logs)
    done = busemu("--budget", SECONDS, *words)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == FILES | {FOLDER}
    partial = told(tmp_path)
    assert partial["causes"] == []
    assert partial["details"]["stopped"] == "step 1: trying every effect"
    assert any("the time was used up" in limit for limit in partial["limits"])
    assert "The time was used up before the search was done" in done.stdout
    read_model(load_robot(tmp_path / "model.toml"))
    done = busemu(*words)
    assert "steps were there from an earlier run" in done.stdout
    assert told(tmp_path) == whole
    assert {path.name for path in tmp_path.iterdir()} == FILES


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_killed_goes_on_and_says_the_same(how, logs, whole, tmp_path):
    out = tmp_path / "out"
    words = ("--robot", ROBOT, "--out", out, *without_most(), logs)
    command = [sys.executable, "-m", "busemu", "diagnose", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        while len(list((out / FOLDER).glob("*.json"))) < 2:
            assert run.poll() is None
            time.sleep(0.01)
        os.kill(run.pid, how)
        run.wait(60)
    assert not FILES & {path.name for path in out.iterdir()}
    done = busemu(*words)
    assert done.returncode == 0, done.stderr
    assert "steps were there from an earlier run" in done.stdout
    assert told(out) == whole


def test_other_recordings_do_not_go_on_from_there(logs, tmp_path):
    words = ("--robot", ROBOT, "--out", tmp_path / "out", "--budget", SECONDS, *without_most())
    busemu(*words, logs)
    other = tmp_path / "other"
    written(other, swings("viscous_friction", 2.0))
    assert "steps were there" not in busemu(*words, other).stdout
