"""A proof from its seed to answered cases: written, published, diagnosed, resumable at any time."""

from __future__ import annotations

import json
import math
import os
import secrets
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.blind.cases import generator

from .answering import DIAGNOSIS, PACKAGES, Answers, Method
from .errors import ProofError
from .opening import open_keys, was_opened
from .plan import Planned, fingerprint
from .processes import ROOT, Job, run
from .published import publish
from .writing import NOT_HAD, is_there

TOGETHER = 8  #: cases that one process writes, at most: it keeps what it measured of a rig


@dataclass(frozen=True)
class Proof:
    """A proof in a folder (absolute path); its secret is in a file beside the folder."""

    folder: Path
    planned: tuple[Planned, ...]
    processes: int = 2
    method: Method = DIAGNOSIS

    @property
    def secret_path(self) -> Path:
        """Where the secret is: not in the folder."""
        return self.folder.with_name(f"{self.folder.name}.secret")

    @cached_property
    def secret(self) -> str:
        """What seals and opens; made, readable by its owner alone, where there is none."""
        path = self.secret_path
        if not path.exists():
            if (self.folder / "cases").exists():
                raise ProofError(f"{path}: is gone, and with it the keys: use another --out")
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                file.write(secrets.token_urlsafe(32) + "\n")
        return path.read_text("utf-8").strip()

    @property
    def cases(self) -> Path:
        """Folder of the sealed cases."""
        return self.folder / "cases"

    @property
    def answers(self) -> Answers:
        """Where the answers are."""
        folder = self.folder
        return Answers(self.cases, folder / "diagnoses", folder / "work", self.method)

    @cached_property
    def had(self) -> tuple[str, ...]:
        """Names of the cases that were written, in their order."""
        return tuple(p.name for p in self.planned if (self.cases / p.name).exists())

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of those that are of one joint."""
        robots = {p.name for p in self.planned if p.robot}
        return tuple(name for name in self.had if name not in robots)

    @property
    def left(self) -> list[str]:
        """Names of the cases that have no answer yet."""
        return [name for name in self.had if not self.answers.finished(name)]

    @property
    def not_had(self) -> list[dict[str, Any]]:
        """Planned cases that could not be had, with reasons."""
        found = sorted(self.cases.glob(f"*{NOT_HAD}"))
        return [json.loads(path.read_text("utf-8")) for path in found]

    def prepare(self) -> None:
        """Make the folder. Raises :class:`ProofError` where diagnoses could read it."""
        folder = self.folder.resolve()
        readable = [ROOT / name for name in PACKAGES]
        readable += [Path(sys.prefix).resolve(), Path(sys.base_prefix).resolve()]
        for place in readable:
            if folder.is_relative_to(place):
                raise ProofError(f"{folder}: lies in {place}, which a diagnosis reads: use --out")
        self.cases.parent.mkdir(parents=True, exist_ok=True)
        _ = self.secret
        self.cases.mkdir(exist_ok=True)

    def write(self, watch: Callable[[int], None] = lambda _: None) -> None:
        """Write the cases that are not there; ``watch`` is told how many are."""
        missing = [p for p in self.planned if not is_there(self.cases, p.name)]
        if not missing:
            return
        size = min(TOGETHER, math.ceil(len(missing) / self.processes))
        chunks = [missing[i : i + size] for i in range(0, len(missing), size)]
        jobs = (self._writing(chunk) for chunk in chunks)
        for ended in run(jobs, self.processes, lambda: watch(self._written())):
            log = ended.job.log
            if ended.code != 0:
                raise ProofError(f"{log}: writing cases failed: {_last_line(log)}")
            log.unlink()

    def _written(self) -> int:
        return sum(is_there(self.cases, p.name) for p in self.planned)

    def _writing(self, chunk: list[Planned]) -> Job:
        log = self.folder / f"writing-{chunk[0].name}.log"
        told = {
            "parent": os.getpid(),
            "secret": self.secret,
            "cases": [p.document() for p in chunk],
        }
        command = (sys.executable, "-P", "-m", "bench.proof.writing", str(self.cases))
        return Job(chunk[0].name, command, log, json.dumps(told))

    def publish(self) -> dict[str, Any]:
        """Publish the hashes, or check them. Raises :class:`ProofError`."""
        plan = fingerprint(self.planned)
        return publish(self.folder, list(self.had), plan, generator(), left=bool(self.left))

    def answer(self, watch: Callable[[], None] = lambda: None) -> Iterator[str]:
        """Diagnose what is left; yields the name of every case that is finished.

        Raises :class:`ProofError` if keys were opened while cases are left.
        """
        if self.left and was_opened(self.folder):
            raise ProofError(f"{self.folder}: the keys are open, no case is diagnosed any more")
        catalogues = {p.name: p.catalogue for p in self.planned}
        yield from self.answers.answer(self.had, catalogues, self.processes, watch)

    def open(
        self, published: dict[str, Any], further: tuple[str, ...] = ()
    ) -> dict[str, dict[str, Any]]:
        """The keys, when all cases are answered; ``further`` are hashes of other answers."""
        if left := self.left:
            raise ProofError(f"{left[0]} and {len(left) - 1} more have no answer yet")
        digest = " ".join((self.answers.digest(self.had), *further))
        return open_keys(self.folder, self.had, self.secret, published, digest)


def _last_line(log: Path) -> str:
    lines = log.read_text("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else "no word why"
