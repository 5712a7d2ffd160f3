"""From answered cases to ``score.json`` and all that is written beside it."""

from __future__ import annotations

from typing import Any

from .judging import Judged, judge
from .published import write_json
from .running import Proof
from .scoring import FORMAT, LEFT_OUT, beside, finite, score
from .table import write_table


def judged_cases(proof: Proof, keys: dict[str, dict[str, Any]]) -> list[Judged]:
    """All cases of a proof with their keys open."""
    answers = proof.answers
    return [judge(name, key, *answers.read(name)) for name, key in keys.items()]


def write_score(proof: Proof, seed: int, published: dict[str, Any]) -> dict[str, Any]:
    """Open the keys, write ``score.json`` and ``cases.csv``; returns the score."""
    keys = proof.open(published)
    cases = judged_cases(proof, keys)
    made_by = {proof.answers.read(name)[1]["sources_sha256"] for name in keys}
    document = {
        "format": FORMAT,
        "seed": seed,
        "cases": len(cases),
        "not_had": len(proof.not_had),
        "diagnoser": published["diagnoser"],
        "frozen": made_by <= {published["diagnoser"]["sources_sha256"]},
        "confinement": published["confinement"],
        **score(cases),
        "left_out": dict(LEFT_OUT),
        "beside": beside(cases),
    }
    document = finite(document)
    write_table(cases, proof.folder / "cases.csv")
    write_json(proof.folder / "score.json", document)
    return document
