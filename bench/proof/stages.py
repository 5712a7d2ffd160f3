"""What each part of the method buys: the names there would be if it stopped early, case by case.

An answer lists what was fitted with its gains, what was taken and what was taken back. So the same
answers, scored at every stage, tell what deflation, recordings left out and objections are for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench.blind.rigs import RIGS

from .equivalence import Sight, same
from .judging import POSITION_STYLE, UNKNOWN_KINDS
from .scoring import AT_1, share

GAIN_NATS = 7.0  #: of a name without which nothing is taken; the diagnosis's own
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
        enough = best is not None and float(best[key]) >= GAIN_NATS
        found[stage] = (str(best["effect"]),) if best is not None and enough else ()
    answer = tuple(str(cause["effect"]) for cause in diagnosis["causes"])
    back = tuple(str(row["effect"]) for row in diagnosis.get("rejected", ()) if "gain_nats" in row)
    return found | {"left_out": answer + back, "answer": answer}


def stages(
    answers: Sequence[tuple[Mapping[str, Any], Mapping[str, Any] | None]],
) -> dict[str, dict[str, Any]]:
    """Rows by stage, of keys and answers.

    ``alarms``: a name on a null; ``right``: the name of a single effect of a floor and more is
    among them; ``wrong``: a name that is not true, of all cases but nulls.
    """
    told = [
        (key, names_at(answer))
        for key, answer in answers
        if answer is not None and key["rig"] in RIGS  # whole robots are searched otherwise
    ]
    return {stage: _rows([(key, names[stage]) for key, names in told]) for stage in STAGES}


def _rows(told: Sequence[tuple[Mapping[str, Any], Sequence[str]]]) -> dict[str, Any]:
    alarms, right, wrong = [], [], []
    for key, names in told:
        sight = Sight(key["style"] == POSITION_STYLE, RIGS[key["rig"]].upright)
        hidden = [] if key["kind"] in UNKNOWN_KINDS else [e["effect"] for e in key["effects"]]
        true = [same(name, sight) for name in (*hidden, *(e["effect"] for e in key["ordinary"]))]
        if key["kind"] == "null":
            alarms.append(bool(names))
            continue
        wrong.append(any(not any(name in alike for alike in true) for name in names))
        if key["kind"] == "single" and float(key["effects"][0]["ratio"]) >= AT_1:
            right.append(any(name in true[0] for name in names))
    return {"alarms": share(alarms), "right": share(right), "wrong": share(wrong)}
