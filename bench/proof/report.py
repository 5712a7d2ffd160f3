"""From answered cases to ``score.json`` and all that is written beside it."""

from __future__ import annotations

from typing import Any

from bench.files import finite, write_json

from . import rivals
from .active import Active
from .judging import Judged, judge
from .page import write_page
from .pictures import draw
from .robot_pictures import draw_robots
from .robot_scoring import GOALS as ROBOT_GOALS
from .robot_scoring import WITHOUT, place_rows, robot_score
from .running import Proof
from .scoring import FORMAT, GOALS, RULES, beside, score, set_goal
from .stages import stages
from .table import write_table


def judged_cases(proof: Proof, keys: dict[str, dict[str, Any]]) -> list[Judged]:
    """All cases of a proof with their keys open."""
    return [judge(name, key, *proof.answers.read(name)) for name, key in keys.items()]


def write_score(
    proof: Proof,
    seed: int,
    published: dict[str, Any],
    active: Active | None = None,
    baselines: int = 0,
) -> dict[str, Any]:
    """Open the keys; write ``score.json``, ``cases.csv``, figures and page. Returns the score."""
    keys = proof.open(published, (active.digest(),) if active else ())
    every = judged_cases(proof, keys)
    cases, robots = [c for c in every if not c.robot], [c for c in every if c.robot]
    made_by = {proof.answers.read(name)[1]["sources_sha256"] for name in keys}
    made_by |= active.made_by() if active else set()
    document: dict[str, Any] = {
        "format": FORMAT,
        "rules": RULES,
        "seed": seed,
        "cases": len(every),
        "not_had": len(proof.not_had),
        "diagnoser": published["diagnoser"],
        "frozen": made_by <= {published["diagnoser"]["sources_sha256"]},
        "confinement": published["confinement"],
        **score(cases),
        **place_rows(robots),
        "left_out": {} if robots else dict.fromkeys(ROBOT_GOALS, WITHOUT),
        "beside": beside(cases),
        "stages": stages([(key, proof.answers.read(name)[0]) for name, key in keys.items()]),
    }
    if robots:
        document["robots"] = robot_score(robots)
    if active:
        row = active.score(keys)
        set_goal(row, *GOALS["resolved_by_experiment"])
        document["resolved_by_experiment"] = row
    else:
        document["left_out"]["resolved_by_experiment"] = "the proof was run without --active"
    names = rivals.chosen(proof, baselines)
    if names:
        rows = rivals.compare(proof, names, keys)
        document["baselines"] = {"cases": len(names), "rows": rows}
    told: dict[str, Any] = finite(document)
    write_table(every, proof.folder / "cases.csv")
    write_json(proof.folder / "score.json", told)
    folder = proof.folder / "figures"
    figures = draw(cases, folder, proof.answers.answers) if cases else {}
    figures |= draw_robots(robots, folder, proof.answers.answers) if robots else {}
    write_page(proof.folder / "index.html", told, every, figures)
    return told
