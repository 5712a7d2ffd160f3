"""Ambiguous cases: one more experiment on the hidden specimen, the proposed one or a random one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.blind import rerun
from bench.motions import ExperimentPlan
from bench.recording import write

from .answering import Answers
from .errors import ProofError
from .judging import UNKNOWN_KINDS, Judged, judge
from .opening import was_opened
from .plan import case_seed
from .running import Proof
from .scoring import Row, share
from .staging import MENU

WAYS = ("proposed", "random")


@dataclass(frozen=True, slots=True)
class Active:
    """The second round of a proof, in its folder ``active``."""

    proof: Proof
    seed: int

    def answers(self, way: str) -> Answers:
        """Where the second answers of one way are."""
        folder = self.proof.folder / "active" / way
        more = folder / "recordings"
        return Answers(
            self.proof.cases, folder / "diagnoses", folder / "work", self.proof.method, more
        )

    def ambiguous(self) -> dict[str, dict[str, Any]]:
        """Cases of one joint whose first cause has rivals, with a proposed experiment."""
        found = {}
        for name in self.proof.joints:
            diagnosis, _ = self.proof.answers.read(name)
            if diagnosis and is_ambiguous(diagnosis) and diagnosis["next_experiment"]:
                found[name] = diagnosis
        return found

    def plans(self, name: str, diagnosis: Mapping[str, Any]) -> dict[str, ExperimentPlan]:
        """The experiment of each way. The menu is what the diagnosis chose from."""
        menu = json.loads((self.proof.answers.answers / name / MENU).read_text("utf-8"))
        random = np.random.default_rng(case_seed(self.seed, f"experiment {name}"))
        drawn = menu[int(random.integers(len(menu)))]
        proposed = diagnosis["next_experiment"][0]["arguments"]
        return {"proposed": ExperimentPlan.of(proposed), "random": ExperimentPlan.of(drawn)}

    def record(self, name: str, diagnosis: Mapping[str, Any]) -> None:
        """Run the experiments on the hidden specimen of a case, unless that was done."""
        for way, plan in self.plans(name, diagnosis).items():
            folder = self.answers(way).more
            assert folder is not None
            if not list((folder / name).glob("*.parquet")):
                (folder / name).mkdir(parents=True, exist_ok=True)
                recording = rerun(self.proof.cases / name, self.proof.secret, plan)
                write(recording, folder / name / f"{recording.name}.parquet")

    def run(self) -> Iterator[tuple[int, int]]:
        """Record and diagnose what is left; yields how many are done, of how many."""
        cases = self.ambiguous()
        left = [n for w in WAYS for n in cases if not self.answers(w).finished(n)]
        if left and was_opened(self.proof.folder):
            raise ProofError(f"{self.proof.folder}: the keys are open: --active comes before")
        catalogues = {p.name: p.catalogue for p in self.proof.planned}
        total, done = len(WAYS) * len(cases), 0
        for name, diagnosis in cases.items():
            self.record(name, diagnosis)
        for way in WAYS:
            answers = self.answers(way)
            done += sum(answers.finished(name) for name in cases)
            yield done, total
            for _ in answers.answer(list(cases), catalogues, self.proof.processes):
                done += 1
                yield done, total

    def score(self, keys: Mapping[str, Mapping[str, Any]]) -> Row:
        """Shares of ambiguous cases that are resolved, by the proposed and by a random one."""
        shares: dict[str, Row] = {}
        for way in WAYS:
            answers = self.answers(way)
            names = [n for n in self.ambiguous() if keys[n]["kind"] not in UNKNOWN_KINDS]
            judged = [judge(name, keys[name], *answers.read(name)) for name in names]
            shares[way] = share(is_resolved(case) for case in judged if case.kind != "null")
        return {**shares["proposed"], "random": shares["random"]}

    def made_by(self) -> set[str]:
        """Hashes of the sources that made the second answers."""
        names = self.ambiguous()
        return {self.answers(w).read(n)[1]["sources_sha256"] for w in WAYS for n in names}

    def digest(self) -> str:
        """A hash of the second answers."""
        names = list(self.ambiguous())
        return " ".join(self.answers(way).digest(names) for way in WAYS)


def is_ambiguous(diagnosis: Mapping[str, Any]) -> bool:
    """Whether the first cause has rivals that are not told apart."""
    return bool(diagnosis["causes"] and diagnosis["causes"][0]["indistinguishable_from"])


def is_resolved(case: Judged) -> bool:
    """Whether the first cause is right and has no rivals left."""
    return case.first_right and not case.ambiguous
