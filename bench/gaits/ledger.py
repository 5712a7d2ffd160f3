"""Finished walks on disk: ``walks.csv``, a row a walk, and what they are walks of.

The table is written anew under another name and then renamed after every walk, so that it is whole
whatever ends the program. Numbers are written with all their digits: a walk is found again by what
was asked for, to the bit.
"""

from __future__ import annotations

import csv
import tomllib
from dataclasses import asdict, astuple, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from busemu.tables import Robot

from ..experiments.locomotion_result import TORQUE_LIMIT
from ..files import write_csv, write_text
from ..recording.metadata import fingerprint
from .candidate import NAMES, Candidate, GaitSearchError
from .outcome import Job, Outcome

WALKS, SEARCH = "walks.csv", "search.toml"
_MEASURED = tuple(f for f in fields(Outcome) if f.name not in ("job", "torque_limit"))
#: For the reader of the table; read back they are worked out again.
_DERIVED = ("allowed", "reasons")
COLUMNS = (*NAMES, "seconds", "seed", *(field.name for field in _MEASURED), *_DERIVED)
_READ = {"float": float, "int": int, "str": str}


class Ledger:
    """The walks of one robot file in one folder, judged by one limit of torque.

    A walk is what was measured, so that other limits may judge the same folder. Raises
    :class:`GaitSearchError`, ``OSError``.
    """

    def __init__(self, folder: Path, robot: Robot, torque_limit: float = TORQUE_LIMIT) -> None:
        self.folder = folder
        self.robot = robot
        self.torque_limit = torque_limit
        self._of = {"robot": robot.name, "sha256": fingerprint(robot)}
        self._found: dict[Job, Outcome] = {}
        if (folder / WALKS).exists():
            self._check()
            found = _read(folder / WALKS)
            self._found = {job: self._judged(outcome) for job, outcome in found.items()}

    def __len__(self) -> int:
        return len(self._found)

    def get(self, job: Job) -> Outcome | None:
        """The finished walk, if it is there."""
        return self._found.get(job)

    def add(self, outcome: Outcome) -> Outcome:
        """Keep a finished walk, on disk when this returns; the walk as it is judged."""
        if not self._found:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_text(self.folder / SEARCH, tomli_w.dumps(self._of))
        judged = self._judged(outcome)
        self._found[outcome.job] = judged
        write_csv(self.folder / WALKS, COLUMNS, map(_row, self._found.values()))
        return judged

    def _judged(self, outcome: Outcome) -> Outcome:
        return replace(outcome, torque_limit=self.torque_limit)

    def _check(self) -> None:
        path = self.folder / SEARCH
        try:
            told = tomllib.loads(path.read_text("utf-8"))
        except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError):
            raise GaitSearchError(
                f"{path}: cannot be read, so nobody knows whose walks {WALKS} has: choose another "
                "--out"
            ) from None
        if told != self._of:
            raise GaitSearchError(
                f"{self.folder}: its walks are of {told.get('robot')} with another robot file: "
                "choose another --out"
            )


def _row(outcome: Outcome) -> list[str]:
    job = outcome.job
    measured = asdict(outcome)
    cells: list[Any] = [*astuple(job.candidate), job.seconds, job.seed]
    cells += [measured[field.name] for field in _MEASURED]
    words = [str(cell) if not isinstance(cell, float) else repr(cell) for cell in cells]
    reasons = ", ".join(reason.value for reason in outcome.reasons)
    return [*words, "yes" if outcome.allowed else "no", reasons]


def _read(path: Path) -> dict[Job, Outcome]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    if not rows or tuple(rows[0]) != COLUMNS:
        raise GaitSearchError(f"{path}: its columns are not those of a gait search: remove it")
    found = {}
    for number, row in enumerate(rows[1:], start=2):
        try:
            cell = dict(zip(COLUMNS, row, strict=True))
            job = Job(
                Candidate(*(float(cell[name]) for name in NAMES)),
                float(cell["seconds"]),
                int(cell["seed"]),
            )
            measured = {f.name: _READ[str(f.type)](cell[f.name]) for f in _MEASURED}
        except ValueError:
            raise GaitSearchError(
                f"{path}: row {number} cannot be read: remove the row, and its walk is made again"
            ) from None
        found[job] = Outcome(job=job, **measured)
    return found
