"""Some processes at a time: started, watched, ended with this one, and never waited for in vain."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

POLL_S = 0.1
#: what of the environment a process gets; a secret in it goes no further
PASSED = ("PATH", "HOME", "LANG", "LC_ALL", "TZ", "LD_LIBRARY_PATH")
#: linear algebra in one thread: the processes are what runs in parallel
FIXED = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
ROOT = Path(__file__).resolve().parents[2]  #: where the packages are imported from


@dataclass(frozen=True, slots=True)
class Job:
    """A process to run: its arguments, its input, where its output goes, how long it may take."""

    name: str
    command: tuple[str, ...]
    log: Path
    standard_input: str = ""
    most_s: float = float("inf")
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Ended:
    """A process that has ended; ``code`` is ``None`` where it took too long."""

    job: Job
    code: int | None
    seconds: float


def environment(more: Mapping[str, str]) -> dict[str, str]:
    """What a process gets instead of this one's environment."""
    passed = {name: os.environ[name] for name in PASSED if name in os.environ}
    return {**passed, **FIXED, "PYTHONPATH": str(ROOT), **more}


def run(
    jobs: Iterable[Job], processes: int, watch: Callable[[], None] = lambda: None
) -> Iterator[Ended]:
    """Run jobs, ``processes`` at a time, and yield each when it has ended.

    A job is taken from ``jobs`` only when it is its turn. ``watch`` is called many times a second.
    Whatever ends this, the processes end with it.
    """
    waiting = iter(jobs)
    running: list[tuple[Job, subprocess.Popen[str], float]] = []
    more = True
    try:
        while more or running:
            while more and len(running) < processes:
                job = next(waiting, None)
                if job is None:
                    more = False
                else:
                    running.append((job, _start(job), time.monotonic()))
            for entry in list(running):
                job, process, since_s = entry
                seconds = time.monotonic() - since_s
                code = process.poll()
                if code is None and seconds <= job.most_s:
                    continue
                if code is None:
                    _end(process)
                running.remove(entry)
                yield Ended(job, code, seconds)
            watch()
            if running:
                time.sleep(POLL_S)
    finally:
        for _, process, _ in running:
            _end(process)


def _start(job: Job) -> subprocess.Popen[str]:
    with job.log.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            job.command,
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment(job.environment),
            cwd=job.log.parent,
            text=True,
            start_new_session=True,  # Ctrl-C reaches this process alone, which ends the others
        )
    assert process.stdin is not None
    with suppress(BrokenPipeError), process.stdin:
        process.stdin.write(job.standard_input)
    return process


def _end(process: subprocess.Popen[str]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
