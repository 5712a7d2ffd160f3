"""Other methods on some cases of a proof, judged like the diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .answering import Answers, Method
from .judging import judge
from .running import Proof
from .scoring import Row, score

#: by name: what is in use, in a line; the methods are those of ``baselines``
METHODS: Mapping[str, str] = {
    "grid": "grid search on RMSE, one effect at a time",
    "evolution": "one evolution fit of everything (CMA-ES)",
    "information": "BIC with independent samples",
    "sparse": "sparse regression of the residual on equation terms",
    "black_box": "ridge regression on goals now and before; names nothing",
}
#: rows that a method without probabilities and intervals can be scored in
ROWS = (
    "named_at_3_floor",
    "named_at_1_to_3_floor",
    "full_set_pairs",
    "full_set_triples",
    "false_alarms",
    "deleted_wrong_name",
    "explained_share",
    "parameter_error",
)


def answers_of(proof: Proof, method: str) -> Answers:
    """Where the answers of a method are."""
    folder = proof.folder / "baselines" / method
    module = Method("bench.proof.baselines", (method,))
    return Answers(proof.cases, folder / "diagnoses", folder / "work", module)


def chosen(proof: Proof, count: int) -> list[str]:
    """The first cases of one joint: in their shuffled order, a sample of all kinds."""
    return list(proof.joints[:count])


def run(proof: Proof, count: int) -> Iterator[tuple[int, int]]:
    """Run all methods on some cases; yields how many are done, of how many."""
    names = chosen(proof, count)
    catalogues = {p.name: p.catalogue for p in proof.planned}
    total, done = len(names) * len(METHODS), 0
    for method in METHODS:
        answers = answers_of(proof, method)
        done += sum(answers.finished(name) for name in names)
        yield done, total
        for _ in answers.answer(names, catalogues, proof.processes):
            done += 1
            yield done, total


def compare(
    proof: Proof, names: Sequence[str], keys: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Row]]:
    """Rows by method, the diagnosis on the same cases among them."""
    found = {}
    methods = {"diagnosis": proof.answers} | {m: answers_of(proof, m) for m in METHODS}
    for method, answers in methods.items():
        judged = [judge(name, keys[name], *answers.read(name)) for name in names]
        rows = score(judged)
        found[method] = {name: rows[name] for name in ROWS}
    return found
