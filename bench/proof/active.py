"""Ambiguous cases: more experiments on the hidden specimen, as proposed or drawn at random."""

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
ROUNDS = 3  #: experiments that a case is followed for, one after another, at most


@dataclass(frozen=True, slots=True)
class Active:
    """The rounds of a proof that come after its diagnoses, in its folder ``active``.

    ``asked`` is which experiment of a case a round is of, from 1; the answers of round 0 are the
    proof's own.
    """

    proof: Proof
    seed: int

    def answers(self, way: str, asked: int) -> Answers:
        """Where the answers of a round are."""
        if asked == 0:
            return self.proof.answers
        folder = self.proof.folder / "active" / way
        own = folder / f"round-{asked}"
        more = folder / "recordings"
        return Answers(self.proof.cases, own / "diagnoses", own / "work", self.proof.method, more)

    def ambiguous(self, way: str = WAYS[0], asked: int = 1) -> dict[str, dict[str, Any]]:
        """Cases of one joint that a round is made for, with their diagnoses until then.

        Their first cause has rivals, and an experiment is proposed.
        """
        names = self.proof.joints if asked == 1 else list(self.ambiguous(way, asked - 1))
        found = {}
        for name in names:
            diagnosis, _ = self.answers(way, asked - 1).read(name)
            if diagnosis and is_ambiguous(diagnosis) and diagnosis["next_experiment"]:
                found[name] = diagnosis
        return found

    def plan(self, way: str, asked: int, name: str, diagnosis: Mapping[str, Any]) -> ExperimentPlan:
        """The experiment of a round. What is random is of the menu that a diagnosis chose from."""
        if way == "proposed":
            return ExperimentPlan.of(diagnosis["next_experiment"][0]["arguments"])
        random = np.random.default_rng(case_seed(self.seed, f"experiment {asked} of {name}"))
        menu = json.loads((self.answers(way, asked - 1).answers / name / MENU).read_text("utf-8"))
        return ExperimentPlan.of(menu[int(random.integers(len(menu)))])

    def record(self, way: str, asked: int, name: str, diagnosis: Mapping[str, Any]) -> None:
        """Run the experiment of a round on the hidden specimen, unless that was done."""
        more = self.answers(way, asked).more
        assert more is not None
        folder = more / name
        if len(list(folder.glob("*.parquet"))) < asked:
            folder.mkdir(parents=True, exist_ok=True)
            plan = self.plan(way, asked, name, diagnosis)
            recording = rerun(self.proof.cases / name, self.proof.secret, plan)
            write(recording, folder / f"{recording.name}-{asked}.parquet")

    def run(self, asked: int) -> Iterator[tuple[int, int]]:
        """Record and diagnose what is left of a round; yields how many are done, of how many."""
        catalogues = {p.name: p.catalogue for p in self.proof.planned}
        cases = {way: self.ambiguous(way, asked) for way in WAYS}
        done, total = 0, sum(map(len, cases.values()))
        for way, some in cases.items():
            answers = self.answers(way, asked)
            left = [name for name in some if not answers.finished(name)]
            if left and was_opened(self.proof.folder):
                raise ProofError(f"{self.proof.folder}: the keys are open: --active comes before")
            for name in left:
                self.record(way, asked, name, some[name])
            done += len(some) - len(left)
            if some:
                yield done, total
            for _ in answers.answer(left, catalogues, self.proof.processes) if left else ():
                done += 1
                yield done, total

    def score(self, keys: Mapping[str, Mapping[str, Any]]) -> Row:
        """Shares of ambiguous cases that are resolved: after one experiment, and after more.

        ``random``: the same of experiments drawn at random; ``after`` has both, by how many.
        """
        left_out = {"null", *UNKNOWN_KINDS}
        names = [name for name in self.ambiguous() if keys[name]["kind"] not in left_out]
        after: dict[str, dict[str, Row]] = {str(k): {} for k in range(1, ROUNDS + 1)}
        for way in WAYS:
            last = dict.fromkeys(names, 0)
            for asked in range(1, ROUNDS + 1):
                last |= {name: asked for name in self.ambiguous(way, asked) if name in last}
                judged = [
                    judge(name, keys[name], *self.answers(way, k).read(name))
                    for name, k in last.items()
                ]
                after[str(asked)][way] = share(is_resolved(case) for case in judged)
        first = after["1"]
        return {**first["proposed"], "random": first["random"], "after": after}

    def _given(self) -> Iterator[tuple[Answers, list[str]]]:
        for way in WAYS:
            for asked in range(1, ROUNDS + 1):
                yield self.answers(way, asked), list(self.ambiguous(way, asked))

    def made_by(self) -> set[str]:
        """Hashes of the sources that made the answers of all rounds."""
        return {
            answers.read(name)[1]["sources_sha256"]
            for answers, names in self._given()
            for name in names
        }

    def digest(self) -> str:
        """A hash of the answers of all rounds."""
        return " ".join(answers.digest(names) for answers, names in self._given())


def is_ambiguous(diagnosis: Mapping[str, Any]) -> bool:
    """Whether the first cause has rivals that are not told apart."""
    return bool(diagnosis["causes"] and diagnosis["causes"][0]["indistinguishable_from"])


def is_resolved(case: Judged) -> bool:
    """Whether the first cause is right and has no rivals left."""
    return case.first_right and not case.ambiguous
