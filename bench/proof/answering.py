"""Diagnosing all cases, each in a process of its own that cannot read the keys."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.blind import read_public
from bench.files import write_json

from .processes import ROOT, Job, run
from .published import sources
from .staging import stage

RUN = "run.json"
ANSWER = "diagnosis.json"
MOST_S = 3600.0  #: a diagnosis that takes longer is none
#: folders in which compiled functions are kept; a confined process may add to them
COMPILED = ("sim", "sim/drive", "sim/floating", "bench/diagnosis")
PACKAGES = ("busemu", "hal", "sim", "bench")


@dataclass(frozen=True, slots=True)
class Method:
    """What diagnoses: a module that takes a staged case and a folder for its answer."""

    module: str = "bench.proof.diagnosing"
    arguments: tuple[str, ...] = ()
    reads: tuple[Path, ...] = ()  #: beside the packages; also where modules are looked for


DIAGNOSIS = Method()


@dataclass(frozen=True, slots=True)
class Answers:
    """Where the cases are, where the answers go, and what the diagnoses may name."""

    cases: Path
    answers: Path
    work: Path
    method: Method = DIAGNOSIS
    more: Path | None = None  #: folder with a folder of further recordings for some cases

    def finished(self, name: str) -> bool:
        """Whether a case has its answer, even if that is a failure."""
        return (self.answers / name / RUN).exists()

    def answer(
        self,
        names: Sequence[str],
        catalogues: Mapping[str, tuple[str, ...]],
        processes: int,
        watch: Callable[[], None] = lambda: None,
    ) -> Iterator[str]:
        """Diagnose the cases that are not finished; yields each when it is.

        A process that a signal ended (memory, a person) gets a second try before it is a failure.
        """
        self.answers.mkdir(parents=True, exist_ok=True)
        for last in (False, True):
            started: dict[str, str] = {}
            left = [name for name in names if not self.finished(name)]
            for ended in run(self._jobs(left, catalogues, started), processes, watch):
                name = ended.job.name
                if last or ended.code is None or ended.code >= 0:
                    self._keep(name, ended.code, ended.seconds, started[name])
                    yield name

    def _jobs(
        self,
        names: Sequence[str],
        catalogues: Mapping[str, tuple[str, ...]],
        started: dict[str, str],
    ) -> Iterator[Job]:
        """Jobs, each made when it is its turn; ``started`` gets the hash of the sources then."""
        for name in names:
            started[name] = sources()
            yield self._job(name, catalogues.get(name, ()))

    def _job(self, name: str, catalogue: tuple[str, ...]) -> Job:
        staged, out = self.work / name / "stage", self.work / name / "out"
        shutil.rmtree(self.work / name, ignore_errors=True)
        stage(self.cases / name, read_public(self.cases / name), staged, catalogue)
        if self.more is not None:
            shutil.copytree(self.more / name, staged / "recordings", dirs_exist_ok=True)
        for folder in (out, out / "tmp"):
            folder.mkdir()
        compiled = [ROOT / place / "__pycache__" for place in COMPILED]
        for folder in compiled:
            folder.mkdir(exist_ok=True)
        reads = [*(ROOT / package for package in PACKAGES), *self.method.reads, staged]
        flags = [f"--read={path}" for path in reads]
        flags += [f"--write={path}" for path in (out, *compiled)]
        confined = ("-P", "-m", "bench.proof.confined", f"--parent={os.getpid()}", *flags)
        told = (f"--list={ROOT}", self.method.module, str(staged), str(out))
        paths = os.pathsep.join(map(str, (ROOT, *self.method.reads)))
        return Job(
            name,
            (sys.executable, *confined, *told, *self.method.arguments),
            out / "log.txt",
            most_s=MOST_S,
            environment={"TMPDIR": str(out / "tmp"), "PYTHONPATH": paths},
        )

    def _keep(self, name: str, code: int | None, seconds: float, by: str) -> None:
        """Move an answer to its place, whole or not at all."""
        out = self.work / name / "out"
        shutil.rmtree(out / "tmp", ignore_errors=True)
        told: dict[str, Any] = {"sources_sha256": by, "seconds": seconds, "failure": ""}
        if code != 0 or not (out / ANSWER).exists():
            told["failure"] = _failure(code, out / "log.txt")
            (out / ANSWER).unlink(missing_ok=True)
        write_json(out / RUN, told)
        shutil.rmtree(self.answers / name, ignore_errors=True)
        os.replace(out, self.answers / name)
        shutil.rmtree(self.work / name, ignore_errors=True)

    def read(self, name: str) -> tuple[dict[str, Any] | None, dict[str, Any]]:
        """The diagnosis of a case, ``None`` if it failed, and how it was made."""
        folder = self.answers / name
        told: dict[str, Any] = json.loads((folder / RUN).read_text("utf-8"))
        if told["failure"]:
            return None, told
        return json.loads((folder / ANSWER).read_text("utf-8")), told

    def digest(self, names: Sequence[str]) -> str:
        """A hash of all answers."""
        total = hashlib.sha256()
        for name in sorted(names):
            diagnosis = self.answers / name / ANSWER
            total.update(name.encode() + b"\n")
            total.update(diagnosis.read_bytes() if diagnosis.exists() else b"failed")
        return total.hexdigest()


def _failure(code: int | None, log: Path) -> str:
    """Why a process has no answer, in a line."""
    if code is None:
        return f"took longer than {MOST_S:g} s"
    if code < 0:
        return f"ended by signal {-code}, twice"
    lines = log.read_text("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else "no word why"
