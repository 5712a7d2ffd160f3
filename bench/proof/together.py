"""Several runs of a proof counted together, from the tables that each has left.

    python -m bench.proof.together docs/proof/robots/run-*/cases.csv

prints rows for a page. Runs are of different states of the diagnosis, each frozen: together they
say how good it has been, and no run alone has cases enough for that.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from .judging import UNKNOWN
from .scoring import (
    AT_1,
    AT_3,
    LEFT_1,
    LEFT_3,
    Row,
    calibration_error,
    mean,
    median,
    share,
    statistic,
)
from .table import COLUMNS
from .truths import OFF, Truth, error_of, main_parameter

Case = dict[str, str]
NEEDED = frozenset(COLUMNS) - {  #: what tables have always had
    *("ratio_walking", "ratio_left", "true_stance", "told_stance")
}
#: an estimate with its interval, as a table has it
SHOWN = re.compile(r"(?P<name>[^=\s]+)=(?P<value>[^\[]+)\[(?P<low>[^;]+);(?P<high>[^\]]+)\]")


def read_tables(paths: Iterable[Path]) -> list[Case]:
    """All cases of some tables. Raises ``ValueError`` naming a file that is none."""
    cases: list[Case] = []
    for path in paths:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            if missing := NEEDED - set(reader.fieldnames or ()):
                raise ValueError(
                    f"{path}: no column {sorted(missing)[0]!r}: name the cases.csv of a proof"
                )
            cases += list(reader)
    return cases


def rows(cases: Sequence[Case]) -> dict[str, Row]:
    """What is counted, by its name on a page."""
    single = [c for c in cases if c["kind"] == "single"]
    pairs = [c for c in cases if c["kind"] == "pair"]
    triples = [c for c in cases if c["kind"] == "triple"]
    nulls = [c for c in cases if c["kind"] == "null"]
    large = [c for c in single if float(c["ratio"]) >= AT_3]
    small = [c for c in single if AT_1 <= float(c["ratio"]) < AT_3]
    deleted = [c for c in cases if c["kind"] == "deleted" and float(c["ratio"]) >= AT_3]
    known = [c for c in (*single, *pairs, *triples) if float(c["ratio"]) >= AT_1]
    placed = [c for c in cases if c["kind"] != "null" and float(c["ratio"]) >= AT_3]
    names = [label for c in cases for label in c["labels"].split()]
    told = [c for c in cases if c["told_phase"]]
    return {
        "class right at 3 floors and more, single effect": _flags(large, "first_right"),
        "the same at 1 to 3 floors": _flags(small, "first_right"),
        "class right where it moves a walk by 3 floors and more": _flags(
            (c for c in single if walking(c) >= LEFT_3), "first_right"
        ),
        "the same by 1 to 3 floors": _flags(
            (c for c in single if LEFT_1 <= walking(c) < LEFT_3), "first_right"
        ),
        "class right where tolerances leave 3 floors and more": _flags(
            (c for c in single if left(c) >= LEFT_3), "first_right"
        ),
        "the same where they leave 1 to 3": _flags(
            (c for c in single if LEFT_1 <= left(c) < LEFT_3), "first_right"
        ),
        "the same where they leave less than one": _flags(
            (c for c in single if left(c) < LEFT_1), "first_right"
        ),
        "full set right, pairs of 3 floors and more each": _flags(
            (c for c in pairs if float(c["ratio"]) >= AT_3), "full_set_right"
        ),
        "the same, pairs of any size": _flags(pairs, "full_set_right"),
        "true effect deleted: says that it has no name for it": share(
            c["verdict"] in UNKNOWN and "wrong" not in c["labels"].split() for c in deleted
        ),
        "deleted: a wrong name": share("wrong" in c["labels"].split() for c in deleted),
        "nulls that are not *consistent*": share(c["verdict"] != "consistent" for c in nulls),
        "nulls that have a name": share(bool(c["labels"]) for c in nulls),
        "names said that are true": share(label != "wrong" for label in names),
        "confidently wrong": _flags(cases, "certain_and_wrong"),
        "calibration error of stated probabilities": statistic(
            [np.array(stated(c)).reshape(-1, 2) for c in cases], calibration_error
        ),
        "share of explainable held-out misfit removed (mean)": mean(
            [np.array([float(c["explained_share"])]) for c in known if c["explained_share"]]
        ),
        "parameter error (median)": median([np.array(list(errors(c))) for c in large]),
        "intervals that hold the truth": share(within for c in cases for within in held(c)),
        "joint group F1 (mean)": mean(
            [np.array([float(c["joint_group_f1"])]) for c in placed if c["joint_group_f1"]]
        ),
        "phase right, where one is told": share(c["told_phase"] == c["true_phase"] for c in told),
        "share of stance that is told, off by (median)": median(
            [np.array([off]) for c in told if not math.isnan(off := stance_off(c))]
        ),
    }


def walking(case: Case) -> float:
    """The size while a robot walks, in floors; nan where a run has not measured it."""
    return float(case.get("ratio_walking") or "nan")


def left(case: Case) -> float:
    """What tolerances leave of it, in floors; nan where nobody has measured it."""
    return float(case.get("ratio_left") or "nan")


def stance_off(case: Case) -> float:
    """How far the share of stance that is told is from the true one; nan where a run has none."""
    told, true = (float(case.get(f"{which}_stance") or "nan") for which in ("told", "true"))
    return abs(told - true)


def errors(case: Case) -> Iterator[float]:
    """Of every effect that is named by its name, how far off is the number that says its size."""
    shown = {found["name"]: found["value"] for found in SHOWN.finditer(case["parameters"])}
    for word in case["true_parameters"].split():
        name, _, true = word.partition("=")
        effect, _, parameter = name.partition(".")
        if name in shown and parameter == main_parameter(effect, case["rig"]):
            yield error_of(Truth(float(true), OFF.get(effect, 0.0)), float(shown[name]))


def held(case: Case) -> Iterator[bool]:
    """Of every number that has an interval and a truth, whether the one holds the other."""
    shown = {found["name"]: found for found in SHOWN.finditer(case["parameters"])}
    for word in case["true_parameters"].split():
        name, _, true = word.partition("=")
        if (found := shown.get(name)) and "none" not in (found["low"], found["high"]):
            yield float(found["low"]) <= float(true) <= float(found["high"])


def stated(case: Case) -> list[tuple[float, bool]]:
    """Of every name its probability and whether it is true."""
    chances = [float(named.rpartition(":")[2]) for named in case["named"].split()]
    labels = case["labels"].split()
    return [(chance, label != "wrong") for chance, label in zip(chances, labels, strict=True)]


def page(cases: Sequence[Case]) -> Iterator[str]:
    """The lines of a table."""
    yield "| score | value | cases | 95 % |"
    yield "|---|---|---|---|"
    for name, row in rows(cases).items():
        if row["n"]:
            low, high = row["ci95"]
            yield f"| {name} | {row['value']:.2g} | {row['n']} | {low:.2f} - {high:.2f} |"


def _flags(cases: Iterable[Case], column: str) -> Row:
    return share(c[column] == "1" for c in cases)


app = typer.Typer(add_completion=False)


@app.command()
def main(
    tables: Annotated[list[Path], typer.Argument(help="Files cases.csv that proofs have left.")],
) -> None:
    """Count several runs of a proof together: rows of a table for a page."""
    try:
        cases = read_tables(tables)
    except (OSError, ValueError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None
    for line in page(cases):
        typer.echo(line)


if __name__ == "__main__":
    app()
