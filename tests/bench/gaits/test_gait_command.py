"""``busemu gait-search`` as a person types it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from inspect import signature
from pathlib import Path

import pytest
from programs import busemu

from bench.experiments.locomotion_result import TORQUE_LIMIT
from bench.gait_commands import gait_search
from bench.gaits.ledger import WALKS, Ledger
from busemu.tables import load_robot

HERE = Path(__file__).parent

#: The command with walks that cost nothing but time: so many pauses of 10 ms in the first walk of a
#: process, in its second, and so on.
SLOW = """
import sys, time
import bench.gaits.walking
from pretended_walks import outcome

PAUSES = [int(pauses) for pauses in sys.argv[1].split(",")]

class Slow:
    def __init__(self, robot):
        self.walks = 0
    def __call__(self, job, check):
        self.walks += 1
        for _ in range(PAUSES[min(self.walks, len(PAUSES)) - 1]):
            time.sleep(0.01)
            check()
        return outcome(job)

bench.gaits.walking.Walker = Slow
sys.argv = ["busemu", "gait-search", "--robot", "marvin", *sys.argv[2:]]
from busemu.cli import main
main()
"""


def started(pauses, *words):
    path = os.pathsep.join([str(HERE), *sys.path])
    return subprocess.Popen(
        [sys.executable, "-c", SLOW, pauses, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": path},
    )


def rows(out):
    return max(0, len((out / WALKS).read_text().splitlines()) - 1) if (out / WALKS).exists() else 0


def wait_for(condition):
    until = time.monotonic() + 200.0
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError
        time.sleep(0.05)


def family(group):
    """Living processes of a process group."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            state, _, of = (entry / "stat").read_text().rsplit(")", 1)[1].split()[:3]
        except (OSError, IndexError, ValueError):
            continue
        if of == str(group) and state != "Z":
            found.append(int(entry.name))
    return found


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--robot", "nobody"], "no robot named 'nobody': use one of "),
        (["--robot", "marvin", "--budget", "0"], "--budget"),
        (["--robot", "marvin", "--seconds", "1"], "2.4 to 604800 s (two periods at least), not 1"),
        (["--robot", "marvin", "--method", "guess"], "use cma or grid"),
        (["--robot", "marvin", "--seed", "-1"], "--seed"),
        (["--robot", "marvin", "--torque-limit", "75"], "0.01 to 1 of the stall torque, not 75"),
        (["--robot", "pendulum"], "this robot cannot walk"),
        (["--robot", "marvin", "--model", "nowhere.toml"], "nowhere.toml: cannot be read"),
    ],
)
def test_bad_words_get_one_clear_line_and_no_folder(words, says, tmp_path):
    done = busemu("gait-search", *words, "--out", tmp_path / "out")
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert says in line
    assert not (tmp_path / "out").exists()


def test_the_limit_that_nobody_says_is_that_of_the_experiments():
    assert signature(gait_search).parameters["torque_limit"].default == TORQUE_LIMIT


def test_a_model_of_another_robot_is_refused(tmp_path):
    other = load_robot("phantomx").path
    done = busemu("gait-search", "--robot", "marvin", "--model", other, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "is of phantomx, not of marvin" in done.stderr


def test_a_search_says_what_to_look_at_and_what_to_do_next(tmp_path):
    running = started("0", "--out", tmp_path, "--budget", "9", "--seconds", "2.4")
    told, complained = running.communicate(timeout=300)
    assert running.returncode == 0, complained
    assert complained == ""
    for words in ("look at ", "result.json", "landscape.png", "try next  busemu walk --robot"):
        assert words in told
    assert (tmp_path / "landscape.png").read_bytes().startswith(b"\x89PNG")


def test_a_search_that_finds_nothing_says_what_it_asked_for_and_what_to_do(tmp_path):
    limit = ("--torque-limit", "0.02")
    running = started("0", "--out", tmp_path, "--budget", "9", "--seconds", "2.4", *limit)
    told, complained = running.communicate(timeout=300)
    assert running.returncode == 0, complained
    assert "torque below 0.02 x stall" in told
    assert "try next  a larger --budget, or a higher --torque-limit" in told


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_search_keeps_its_walks_and_leaves_no_process(ending, tmp_path):
    running = started("10,10,1000000", "--out", tmp_path, "--budget", "500", "--seconds", "2.4")
    try:
        wait_for(lambda: rows(tmp_path) >= 2)
        if ending is signal.SIGINT:
            os.killpg(running.pid, ending)  # as a terminal does it
        else:
            running.send_signal(ending)
        told, complained = running.communicate(timeout=60)
    finally:
        running.kill()
        running.communicate()
    assert running.returncode == 130
    assert complained == ""
    assert "the same command goes on" in told
    assert f"{rows(tmp_path)} walks are kept" in told
    assert len(Ledger(tmp_path, load_robot("marvin"))) == rows(tmp_path)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    wait_for(lambda: not family(running.pid))


def test_a_killed_search_leaves_whole_walks_and_no_process(tmp_path):
    running = started("20", "--out", tmp_path, "--budget", "500", "--seconds", "2.4")
    try:
        wait_for(lambda: rows(tmp_path) >= 3)
    finally:
        running.kill()
        running.communicate()
    assert len(Ledger(tmp_path, load_robot("marvin"))) == rows(tmp_path) >= 3
    wait_for(lambda: not family(running.pid))
