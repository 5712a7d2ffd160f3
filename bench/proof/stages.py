"""What each part of the method buys: the names there would be if it stopped early, case by case.

An answer lists what was fitted with its gains, what was taken and what was taken back. So the same
answers, scored at every stage, tell what deflation, recordings left out and objections are for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench.blind.rigs import RIGS
from bench.diagnosis.joint.search import NEEDED

from .judging import RIGHT, Judged, judge
from .scoring import AT_1, share

STAGES = {
    "likelihood": "the best single effect, by the likelihood as it is",
    "deflated": "the same, its gain divided by how much too sure the likelihood is",
    "left_out": "what gains on recordings left out, one effect after another",
    "answer": "the same, without the names that something speaks against",
}


def names_at(diagnosis: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """The names of an answer at every stage."""
    alone = [row for row in diagnosis.get("ranking", ()) if not row["with"]]
    found: dict[str, tuple[str, ...]] = {}
    for stage, key in (("likelihood", "gain_nats"), ("deflated", "deflated_nats")):
        best = max(alone, key=lambda row: float(row[key]), default=None)
        enough = best is not None and float(best[key]) >= NEEDED
        found[stage] = (str(best["effect"]),) if best is not None and enough else ()
    answer = tuple(str(cause["effect"]) for cause in diagnosis["causes"])
    rejected = [row["effect"] for row in diagnosis.get("rejected", ()) if "gain_nats" in row]
    back = tuple(map(str, diagnosis.get("details", {}).get("taken_back", rejected)))
    return found | {"left_out": answer + back, "answer": answer}


def stages(
    answers: Sequence[tuple[Mapping[str, Any], Mapping[str, Any] | None]],
) -> dict[str, dict[str, Any]]:
    """Rows by stage, of keys and answers.

    ``alarms``: a name on a null; ``right``: the name of a single effect of a floor and more is
    among them; ``wrong``: a name that is not true, of all cases but nulls.
    """
    told = [
        (key, answer)
        for key, answer in answers
        if answer is not None and key["rig"] in RIGS  # whole robots are searched otherwise
    ]
    return {
        stage: _rows([_stopped(key, answer, stage) for key, answer in told]) for stage in STAGES
    }


def _stopped(key: Mapping[str, Any], answer: Mapping[str, Any], stage: str) -> Judged:
    """A case judged as if its answer had been the names of a stage."""
    causes = [
        {"effect": name, "probability": 1.0, "indistinguishable_from": [], "parameters": {}}
        for name in names_at(answer)[stage]
    ]
    return judge("", key, {**answer, "causes": causes}, {"failure": "", "seconds": 0.0})


def _rows(cases: Sequence[Judged]) -> dict[str, Any]:
    beside = [case for case in cases if case.kind != "null"]
    single = [case for case in beside if case.kind == "single" and case.ratio >= AT_1]
    return {
        "alarms": share([bool(case.named) for case in cases if case.kind == "null"]),
        "right": share([any(n.label == RIGHT for n in case.named) for case in single]),
        "wrong": share([bool(case.wrong) for case in beside]),
    }
