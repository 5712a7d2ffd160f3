"""The bench's commands, as a person types them."""

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from programs import busemu, fails_in_one_line

from bench.recording import read


def test_the_command_is_installed():
    assert shutil.which("busemu", path=sys.prefix + "/bin")


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_a_virtual_walk_writes_a_recording_that_reads_back(tmp_path, suffix):
    path = tmp_path / f"walk.{suffix}"
    words = ["--robot", "marvin", "--virtual", "--plant", "ideal", "--seconds", 1]
    done = busemu("walk", *words, "--record", path)
    assert done.returncode == 0, done.stderr
    assert "50 cycles in 1.00 s" in done.stdout
    recording = read(path)
    assert recording.servo_ids == tuple(range(1, 19))
    assert recording.metadata["source"] == "emulator"
    assert len(recording.series(1, "present_position", "read").value) >= 50


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["walk", "--robot", "marvin", "--port", "/dev/nowhere"], "/dev/nowhere"),
        (["walk", "--robot", "marvin"], "--virtual"),
        (["walk", "--robot", "nobody", "--virtual"], "no robot named 'nobody': use one of "),
        (["walk", "--robot", "marvin", "--virtual", "--plant", "clay"], "bullet, ideal"),
        (["walk", "--robot", "marvin", "--virtual", "--seconds", "0"], "0.1 to 604800 s, not 0"),
        (["walk", "--robot", "marvin", "--virtual", "--seconds", "nan"], "604800 s, not nan"),
        (["walk", "--robot", "marvin", "--virtual", "--v-right", "inf"], "--v-right must be -100"),
        (["walk", "--robot", "marvin", "--virtual", "--cycle-ms", "-5"], "0 to 1000 ms, not -5"),
        (["walk", "--robot", "marvin", "--virtual", "--seed", "-1"], "--seed must be 0 to"),
        (["walk", "--robot", "marvin", "--virtual", "--v-left", "40"], "reach"),
        (["walk", "--robot", "marvin", "--virtual", "--record", "walk.txt"], "parquet"),
        (["walk", "--robot", "marvin", "--virtual", "--record", "a.parquet"], "a folder has that"),
        (["demo", "--robot", "nobody"], "no robot named 'nobody': use one of "),
        (["demo", "--robot", "arm"], "cannot walk"),
        (["demo", "--out", "a.parquet/file/y"], "a.parquet/file"),
        (["timing", "--robot", "arm", "--virtual", "--out", "a.parquet/file"], "File exists"),
        (["timing", "--robot", "arm", "--virtual", "--fit", "none/b.toml"], "no folder none"),
        (["serve", "--robot", "arm", "--plant", "ideal", "--link", "/proc/link"], "/proc/link: "),
        (["study", "engines", "--seed", "-1"], "--seed must be 0 to 4294967295, not -1"),
        (["study", "engines", "--out", "a.parquet/file"], "busemu: a.parquet/file: File exists"),
        (["import", "auto", "a.parquet/c.parquet", "--out", "b"], "look with busemu inspect"),
    ],
)
def test_bad_words_get_one_clear_line_and_a_failure(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.parquet").mkdir()
    for name in ("file", "c.parquet"):
        Path("a.parquet", name).write_text("no recording")
    fails_in_one_line(busemu(*words), says)


WALKING_BYTES = 200_000  #: of a trace of the bus, with which a robot has stood up and walks


@pytest.mark.pty
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_walk_that_is_ended_lets_go_and_keeps_its_recording(tmp_path, number):
    link, trace, path = (tmp_path / name for name in ("marvin", "bus.trace", "walk.parquet"))
    serve = [sys.executable, "-m", "busemu", "serve", "--robot", "marvin", "--plant", "ideal"]
    serve += ["--link", str(link), "--trace", str(trace)]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
        try:
            while "port" not in server.stdout.readline():
                assert server.poll() is None
            words = ["walk", "--robot", "marvin", "--port", link, "--seconds", 60, "--record", path]
            command = [sys.executable, "-m", "busemu", *map(str, words)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as walk:
                while trace.stat().st_size < WALKING_BYTES:
                    assert walk.poll() is None
                    time.sleep(0.1)
                walk.send_signal(number)
                said, _ = walk.communicate(timeout=30)
        finally:
            server.terminate()
    assert walk.returncode == 130
    assert "torque is off" in said
    assert (read(path).series(1, "torque_enable", "write").value[[0, -1]] == [1, 0]).all()
