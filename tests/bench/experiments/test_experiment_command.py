"""``busemu experiment`` as a person types it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest
from programs import busemu


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["leg-step", "--robot", "marvin", "--port", "/dev/nowhere", "--yes"], "no such port"),
        (["leg-step"], "--robot marvin"),
        (["leg-step", "--robot", "nobody"], "no robot named 'nobody': use one of "),
        (
            ["leg-step", "--robot", "marvin", "--leg", "leg9"],
            "marvin has no leg leg9: use --leg leg1 or --leg leg2",
        ),
        (
            ["servo-check", "--robot", "marvin", "--leg", "leg9"],
            "marvin has no leg leg9: use --leg leg1 or --leg leg2",
        ),
        (["locomotion", "--robot", "arm"], "arm has no legs: use servo-check or leg-step"),
        (["servo-check", "--robot", "arm", "--joint", "hand"], "no joint hand: use --joint base"),
        (["leg-stop", "--robot", "marvin"], "use servo-check, torque-analysis, leg-step"),
        (
            ["locomotion", "--robot", "marvin", "--repeats", "0"],
            "--repeats must be 1 to 1000, not 0",
        ),
        (["locomotion", "--robot", "marvin", "--seconds", "0"], "must be 0.1 to 604800 s, not 0"),
        (["locomotion", "--robot", "marvin", "--seconds", "inf"], "604800 s, not inf"),
        (["locomotion", "--robot", "marvin", "--seconds", "1"], "--seconds must be at least 4.8 s"),
        (["locomotion", "--robot", "marvin", "--v-left", "nan"], "--v-left must be -100 to 100"),
        (["locomotion", "--robot", "marvin", "--v-left", "40"], "too long a stride"),
        (["locomotion", "--robot", "marvin", "--seed", "-1"], "--seed must be 0 to"),
        (["leg-step", "--robot", "marvin", "--joint", "leg1.coxa"], "only servo-check takes one"),
        (["locomotion", "--evaluate", "nowhere"], "no recording there"),
    ],
)
def test_bad_words_get_one_clear_line_and_a_failure(words, says, tmp_path):
    done = busemu("experiment", *words, "--out", tmp_path / "out")
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert says in line
    assert not (tmp_path / "out" / "recordings").exists() or "--port" in words
    assert not list(tmp_path.rglob("*.parquet"))


def test_the_list_names_every_experiment_and_its_figures():
    done = busemu("experiment", "list")
    assert done.returncode == 0
    for words in ("servo-check (figures 29, 33)", "torque-analysis", "leg-step", "locomotion"):
        assert words in done.stdout


def test_a_run_leaves_its_results_and_evaluates_again(tmp_path):
    out = tmp_path / "steps"
    done = busemu("experiment", "leg-step", "--robot", "marvin", "--repeats", 1, "--out", out)
    assert done.returncode == 0, done.stderr
    assert f"{out}/figure.png" in done.stdout
    result = (out / "result.json").read_bytes()
    again = busemu("experiment", "leg-step", "--evaluate", out)
    assert again.returncode == 0, again.stderr
    assert (out / "result.json").read_bytes() == result
    assert done.stdout.split("\n", 1)[1] == again.stdout


def test_ctrl_c_says_what_is_kept(tmp_path):
    out = tmp_path / "steps"
    words = ["experiment", "leg-step", "--robot", "marvin", "--repeats", "500", "--out", str(out)]
    running = subprocess.Popen(
        [sys.executable, "-m", "busemu", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 120.0
        while not list(out.rglob("leg-step-01.parquet")) and time.monotonic() < until:
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        told, complained = running.communicate(timeout=120)
    finally:
        running.kill()
    assert running.returncode == 130
    assert "torque is off" in told
    assert "of 500 trials are kept" in told
    assert complained == ""
    assert all(not path.name.startswith(".") for path in out.rglob("*"))
