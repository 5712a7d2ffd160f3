"""The examples run as they stand."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(*words):
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_the_example_in_virtual_time_sees_the_servo_arrive():
    done = run(EXAMPLES / "virtual_time.py")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 10
    assert lines[-1].endswith("position 600")
    assert not lines[0].endswith("position 600")


def test_the_example_with_faults_meets_them_all_and_the_same_every_time():
    first, second = (run(EXAMPLES / "bearing_faults.py") for _ in range(2))
    assert first.returncode == 0, first.stderr
    assert first.stdout == second.stdout
    *seen, corrupt, drop, brown_out = first.stdout.splitlines()
    assert "Incorrect status packet" in "".join(seen)
    assert int(corrupt.split()[0]) > 0
    assert drop.split()[:3] == ["2", "times:", "drop"]
    assert brown_out.split()[:3] == ["1", "times:", "brown-out,"]


@pytest.mark.pty
def test_any_client_reads_all_servos_of_a_served_robot(tmp_path):
    link = tmp_path / "marvin"
    command = [sys.executable, "-m", "busemu", "serve", "--robot", "marvin", "--plant", "ideal"]
    with subprocess.Popen([*command, "--link", link], stdout=subprocess.PIPE, text=True) as server:
        try:
            while "port" not in server.stdout.readline():
                assert server.poll() is None
            done = run(EXAMPLES / "any_client.py", link)
        finally:
            server.terminate()
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split(":")[0] for line in done.stdout.splitlines()] == [
        f"servo {servo_id:2}" for servo_id in range(1, 19)
    ]


def test_examples_are_short():
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text("utf-8").splitlines()) <= 40, path
