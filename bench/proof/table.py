"""Every case in a line: truth, size, concealment, verdict, names, parameters, fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.files import write_csv

from .judging import Judged, Named

COLUMNS = (
    "case",
    "kind",
    "concealment",
    "rig",
    "programme",
    "style",
    "hidden",
    "ordinary",
    "ratio",
    "ratio_left",
    "ratio_walking",
    "verdict",
    "named",
    "labels",
    "first_right",
    "first_by_name",
    "second_guess_right",
    "full_set_right",
    "certain_and_wrong",
    "true_parameters",
    "parameters",
    "mse_before_rad2",
    "mse_after_rad2",
    "mse_oracle_rad2",
    "explained_share",
    "joint_group_f1",
    "mismatch_f1",
    "true_phase",
    "told_phase",
    "true_stance",
    "told_stance",
    "seconds",
    "failure",
)


def write_table(cases: Sequence[Judged], path: Path) -> None:
    """Write all cases as CSV, whole or not at all."""
    write_csv(path, COLUMNS, ([row[name] for name in COLUMNS] for row in map(line, cases)))


def line(c: Judged) -> Mapping[str, Any]:
    """A case as a line of the table."""
    return {
        "case": c.case,
        "kind": c.kind,
        "concealment": c.concealment,
        "rig": c.rig,
        "programme": c.programme,
        "style": c.style,
        "hidden": " ".join(c.hidden),
        "ordinary": " ".join(c.ordinary),
        "ratio": f"{c.ratio:.3g}",
        "ratio_left": _number(c.left),
        "ratio_walking": _number(c.walking),
        "verdict": c.verdict,
        "named": " ".join(f"{n.effect}:{n.probability:.3f}" for n in c.named),
        "labels": " ".join(n.label for n in c.named),
        "first_right": int(c.first_right),
        "first_by_name": int(c.first_exact),
        "second_guess_right": int(c.second_right),
        "full_set_right": int(c.set_right),
        "certain_and_wrong": int(c.certain_and_wrong),
        "true_parameters": " ".join(f"{p.effect}.{p.name}={p.true:.6g}" for p in c.checked),
        "parameters": " ".join(word for n in c.named for word in _parameters(n)),
        "mse_before_rad2": f"{c.mse_before:.6g}",
        "mse_after_rad2": f"{c.mse_after:.6g}",
        "mse_oracle_rad2": f"{c.mse_oracle:.6g}",
        "explained_share": "" if c.explained is None else f"{c.explained:.4f}",
        "joint_group_f1": f"{c.place.f1:.4f}" if c.place else "",
        "mismatch_f1": f"{c.place.mismatch_f1:.4f}" if c.place else "",
        "true_phase": c.place.true_phase if c.place else "",
        "told_phase": c.place.told_phase if c.place else "",
        "true_stance": _number(c.place.true_stance) if c.place else "",
        "told_stance": _number(c.place.told_stance) if c.place else "",
        "seconds": f"{c.seconds:.1f}",
        "failure": c.failure,
    }


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _parameters(named: Named) -> list[str]:
    words = []
    for name, estimate in named.parameters.items():
        value, ends = estimate["value"], estimate["ci95"]
        shown = [("none" if x is None else f"{x:.6g}") for x in (value, *ends)]
        words.append(f"{named.effect}.{name}={shown[0]}[{shown[1]};{shown[2]}]")
    return words
