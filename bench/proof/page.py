"""``index.html``: the score, the figures and every case, to be looked at in a browser."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from bench.files import write_text
from bench.pages import STYLE

from .judging import Judged
from .rivals import METHODS
from .robot_scoring import GOALS as ROBOT_GOALS
from .scoring import GOALS
from .stages import STAGES

#: what the figures show
CAPTIONS = {
    "power": "Share of single effects named right against their size, and against what tolerances "
    "leave of it; bars are 95 % intervals.",
    "confusion": "What is hidden (rows) and what is named first (columns); numbers of cases.",
    "calibration": "Stated probabilities against the share that is right; numbers of causes.",
    "coverage": "Errors of the main parameter, and intervals that hold the truth.",
    "explained": "Explainable held-out misfit that the named effects remove, case by case.",
    "failures": "The surest wrong names: residual of positions on a recording that was held out.",
    "robots": "Whole robots: where what is hidden was found, against its size; each dot is a case.",
    "robots_confusion": "Whole robots: what is hidden (rows) and what is named first (columns).",
    "robots_failures": "Whole robots: the surest wrong names, in the joint that is left worst.",
}
OWN = """
.scroll { overflow-x: auto; max-height: 40rem; } .scroll td, .scroll th { font-size: 12px; }
"""


def write_page(
    path: Path, score: Mapping[str, Any], cases: Sequence[Judged], figures: Mapping[str, Path]
) -> None:
    """Write the page, whole or not at all; figures are named relative to it."""
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width'>",
        f"<title>Proof, seed {score['seed']}</title><style>{STYLE}{OWN}</style>",
        f"<h1>Proof of the diagnosis: seed {score['seed']}, {score['cases']} cases</h1>",
        f"<p>{_provenance(score)}</p>",
        _rows({name: score[name] for name in (*GOALS, *ROBOT_GOALS) if name in score}),
        *(
            f"<p>{escape(name)}: left out, {escape(why)}.</p>"
            for name, why in score["left_out"].items()
        ),
    ]
    if "robots" in score:
        parts.append(f"<h2>Whole robots: {score['robots']['cases']} cases</h2>")
        parts.append(_rows(score["robots"]["rows"]))
    for name, file in figures.items():
        source = escape(str(file.relative_to(path.parent)))
        parts.append(
            f"<figure><img src='{source}' alt='{escape(name)}'>"
            f"<figcaption>{escape(CAPTIONS[name])}</figcaption></figure>"
        )
    if "baselines" in score:
        parts += ["<h2>Other methods on the same cases</h2>", _baselines(score["baselines"])]
    parts += ["<h2>What each part of the method buys</h2>", _stages(score["stages"])]
    parts += ["<h2>Every case</h2>", _cases(cases)]
    write_text(path, "\n".join(parts) + "\n")


def _provenance(score: Mapping[str, Any]) -> str:
    frozen = "frozen" if score["frozen"] else "NOT frozen: its sources changed during the run"
    return escape(
        f"Diagnoser {score['diagnoser']['commit']}, {frozen}; confinement: "
        f"{score['confinement']}; {score['not_had']} planned cases could not be had. "
        "Rules: docs/proof/rules.md. Data: score.json, cases.csv."
    )


def number(row: Mapping[str, Any]) -> str:
    """A row's value with its interval, in words."""
    if row["value"] is None:
        return "no case"
    low, high = row["ci95"]
    return f"{row['value']:.3f} [{low:.3f}, {high:.3f}]"


def _rows(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of the rows that have cases, and the names of the others in a line."""
    told = {name: row for name, row in rows.items() if row["value"] is not None}
    lines = ["<table><tr><th>row<th>value [95 %]<th>n<th>good<th>great<th>"] if told else []
    for name, row in told.items():
        lines.append(
            f"<tr><td>{escape(name)}<td>{number(row)}<td>{row['n']}<td>{row['good']:g}"
            f"<td>{row['great']:g}<td class='{row['met']}'>{row['met']}"
        )
        for inner, other in row.items():
            if isinstance(other, Mapping) and other.get("value") is not None:
                lines.append(f"<tr><td>&emsp;{escape(inner)}<td>{number(other)}<td>{other['n']}")
    if told:
        lines.append("</table>")
    if bare := [name for name in rows if name not in told]:
        lines.append(f"<p>No case speaks for {escape(', '.join(bare))}.</p>")
    return "\n".join(lines)


def _baselines(found: Mapping[str, Any]) -> str:
    names = list(found["rows"])
    columns = list(found["rows"][names[0]])
    lines = [f"<p>{found['cases']} cases.</p><div class='scroll'><table><tr><th>method"]
    lines += [f"<th>{escape(column)}" for column in columns]
    for name in names:
        told = f"{name}: {METHODS[name]}" if name in METHODS else name
        cells = "".join(f"<td>{number(row)}" for row in found["rows"][name].values())
        lines.append(f"<tr><td>{escape(told)}{cells}")
    return "\n".join([*lines, "</table></div>"])


def _stages(found: Mapping[str, Mapping[str, Any]]) -> str:
    lines = ["<table><tr><th>names<th>on nulls<th>right, of a floor and more<th>not true"]
    for stage, rows in found.items():
        cells = "".join(f"<td>{number(rows[name])}" for name in ("alarms", "right", "wrong"))
        lines.append(f"<tr><td>{escape(STAGES[stage])}{cells}")
    return "\n".join([*lines, "</table>"])


def _cases(cases: Sequence[Judged]) -> str:
    lines = ["<div class='scroll'><table><tr><th>case<th>on<th>kind<th>concealed<th>hidden"]
    lines.append("<th>size<th>left<th>verdict<th>named<th>right<th>found in")
    for c in cases:
        named = ", ".join(f"{n.effect} {n.probability:.2f}" for n in c.named)
        hidden = ", ".join((*c.hidden, *(f"({n})" for n in c.ordinary)))
        size, left = ("" if math.isnan(r) else f"{r:.2g}" for r in (c.ratio, c.left))
        verdict = f"{c.verdict} {c.failure}".strip()
        cells = (
            *(c.case, c.rig, c.kind, c.concealment, hidden, size, left),
            *(verdict, named, _right(c), _found_in(c)),
        )
        lines.append("<tr>" + "".join(f"<td>{escape(cell)}" for cell in cells))
    return "\n".join([*lines, "</table></div>"])


def _found_in(c: Judged) -> str:
    if c.place is None:
        return ""
    found = f"joints F1 {c.place.f1:.2f}"
    if not c.place.true_phase:
        return found
    return f"{found}; {c.place.told_phase or 'no phase told'}, true {c.place.true_phase}"


def _right(c: Judged) -> str:
    if c.kind == "null":
        return "false alarm" if c.alarms else "yes"
    if c.kind in ("deleted", "stranger"):
        return "yes" if c.says_unknown else "wrong name" if c.wrong else "silent"
    if c.kind == "single":
        return "by name" if c.first_exact else "by class" if c.first_right else "no"
    return "yes" if c.set_right else "no"
