"""Processes of a proof: so many at a time, in a small environment, and none is left behind."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from bench.proof.processes import ROOT, Job, environment, run


def job(folder, name, code, **more):
    return Job(name, (sys.executable, "-c", code), folder / f"{name}.log", **more)


def wait_until_gone(pid):
    """Return when a process has ended; it sleeps much longer than this waits."""
    for _ in range(6000):
        try:
            with open(f"/proc/{pid}/stat") as file:
                if file.read().rpartition(")")[2].split()[0] == "Z":
                    return
        except FileNotFoundError:
            return
        time.sleep(0.01)
    pytest.fail(f"process {pid} was left behind")


def test_every_job_ends_with_its_code(tmp_path):
    jobs = [job(tmp_path, str(code), f"raise SystemExit({code})") for code in (0, 3)]
    assert {ended.job.name: ended.code for ended in run(jobs, 2)} == {"0": 0, "3": 3}


def test_a_job_gets_its_input_and_its_output_goes_to_its_log(tmp_path):
    echo = job(tmp_path, "echo", "print(input())", standard_input="said\n")
    list(run([echo], 1))
    assert echo.log.read_text() == "said\n"


def test_a_job_that_takes_too_long_is_ended_without_a_code(tmp_path):
    slow = job(tmp_path, "slow", "import time; time.sleep(1000)", most_s=0.2)
    (ended,) = run([slow], 1)
    assert ended.code is None


def test_no_more_jobs_run_at_a_time_than_asked_for(tmp_path):
    code = (
        "import os, pathlib, time\n"
        "mark = pathlib.Path(f'running-{os.getpid()}'); mark.touch(); time.sleep(0.3)\n"
        "print(len(list(pathlib.Path().glob('running-*')))); mark.unlink()"
    )
    jobs = [job(tmp_path, f"job{n}", code) for n in range(4)]
    list(run(jobs, 1))
    assert {j.log.read_text().strip() for j in jobs} == {"1"}


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
def test_what_runs_is_ended_when_the_run_is_given_up(tmp_path):
    code = "import os, time; print(os.getpid(), flush=True); time.sleep(1000)"
    slow = job(tmp_path, "slow", code)
    running = run([slow, job(tmp_path, "quick", "pass")], 2)
    next(running)
    while not (said := slow.log.read_text()):
        time.sleep(0.01)
    running.close()
    wait_until_gone(int(said))


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel ends them, on Linux")
def test_a_confined_process_ends_with_its_parent_even_if_that_is_killed(tmp_path):
    (tmp_path / "sleeper.py").write_text("import time; print('up', flush=True); time.sleep(1000)")
    code = (
        "import json, os, subprocess, sys\n"
        "child = subprocess.Popen([sys.executable, '-P', '-m', 'bench.proof.confined',\n"
        f"    f'--parent={{os.getpid()}}', '--read={ROOT / 'bench'}', '--list={ROOT}',\n"
        f"    '--read={tmp_path}', 'sleeper'], stdout=subprocess.PIPE,\n"
        f"    env={{**os.environ, 'PYTHONPATH': {json.dumps(f'{ROOT}{os.pathsep}{tmp_path}')}}})\n"
        "child.stdout.readline(); print(child.pid, flush=True); child.wait()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=ROOT) as parent:
        child = int(parent.stdout.readline())
        os.kill(parent.pid, signal.SIGKILL)
    wait_until_gone(child)


def test_secrets_of_the_environment_are_not_passed_on(monkeypatch):
    monkeypatch.setenv("SOME_TOKEN", "secret")
    assert "SOME_TOKEN" not in environment({})
    assert environment({})["OPENBLAS_NUM_THREADS"] == "1"
