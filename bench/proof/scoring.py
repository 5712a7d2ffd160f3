"""The score: every row of the table that any case speaks for, and what is beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .intervals import bootstrap, wilson
from .judging import CERTAIN, UNKNOWN_KINDS, Judged

Floats = NDArray[np.float64]
Row = dict[str, Any]

FORMAT = "busemu-score/1"
RULES = 2  #: of docs/proof/rules.md: what is hidden where, and what counts as right
#: ratios at which a size counts as so many times the floor: a case's is within 5 % of the wanted
AT_1, AT_3 = 0.95, 2.85
#: the same of what is left beside tolerances: that is measured, and never asked for
LEFT_1, LEFT_3 = 1.0, 3.0
BINS = 10  #: of stated probabilities

#: good and great by row, and whether more is better
GOALS: Mapping[str, tuple[float, float, bool]] = {
    "named_at_3_floor": (0.80, 0.96, True),
    "named_at_1_to_3_floor": (0.60, 0.85, True),
    "named_at_3_floor_left": (0.80, 0.96, True),
    "named_at_1_to_3_floor_left": (0.60, 0.85, True),
    "confidently_wrong": (0.01, 0.0, False),
    "full_set_pairs": (0.50, 0.85, True),
    "full_set_triples": (0.30, 0.70, True),
    "false_alarms": (0.05, 0.01, False),
    "deleted_unexplained": (0.60, 0.90, True),
    "deleted_wrong_name": (0.25, 0.04, False),
    "explained_share": (0.60, 0.95, True),
    "parameter_error": (0.20, 0.05, False),
    "coverage": (0.80, 0.93, True),
    "calibration_error": (0.10, 0.03, False),
    "resolved_by_experiment": (0.50, 0.90, True),
}
SECOND_GUESS = (0.90, 0.99, True)
COVERAGE_MOST = 0.97  #: intervals that cover more than this are too wide to be great


def share(hits: Iterable[bool]) -> Row:
    """A share with Wilson's interval."""
    told = list(hits)
    if not told:
        return {"value": None, "n": 0, "ci95": None}
    return {
        "value": sum(told) / len(told),
        "n": len(told),
        "ci95": list(wilson(sum(told), len(told))),
    }


def statistic(groups: Sequence[Floats], of: Callable[[Floats], float]) -> Row:
    """A statistic of rows with its bootstrap interval; ``groups`` are the rows of each case."""
    told = [group for group in groups if len(group)]
    rows = sum(len(group) for group in told)
    if not told:
        return {"value": None, "n": 0, "ci95": None}
    return {"value": of(np.concatenate(told)), "n": rows, "ci95": list(bootstrap(told, of))}


def median(groups: Sequence[Floats]) -> Row:
    """The median of rows, as :func:`statistic`."""
    return statistic(groups, lambda x: float(np.median(x)))


def mean(groups: Sequence[Floats]) -> Row:
    """The mean of rows, as :func:`statistic`."""
    return statistic(groups, lambda x: float(np.mean(x)))


def calibration_error(rows: Floats) -> float:
    """Expected calibration error of rows of stated probability and truth (0 or 1)."""
    bins = np.minimum((rows[:, 0] * BINS).astype(int), BINS - 1)
    total = 0.0
    for b in range(BINS):
        own = rows[bins == b]
        if len(own):
            total += len(own) * abs(float(own[:, 0].mean() - own[:, 1].mean()))
    return total / len(rows)


def score(cases: Sequence[Judged]) -> dict[str, Row]:
    """All rows by their names, with goals; rows within rows say what stands beside them."""
    rows = {
        "named_at_3_floor": naming(c for c in cases if c.kind == "single" and c.ratio >= AT_3),
        "named_at_1_to_3_floor": naming(
            c for c in cases if c.kind == "single" and AT_1 <= c.ratio < AT_3
        ),
        "named_at_3_floor_left": naming(
            c for c in cases if c.kind == "single" and c.left >= LEFT_3
        ),
        "named_at_1_to_3_floor_left": naming(
            c for c in cases if c.kind == "single" and LEFT_1 <= c.left < LEFT_3
        ),
        "confidently_wrong": _certain(cases),
        "full_set_pairs": _sets(cases, "pair"),
        "full_set_triples": _sets(cases, "triple"),
        "false_alarms": _alarms(cases),
        "deleted_unexplained": _unknown(cases, "deleted", lambda c: c.says_unknown),
        "deleted_wrong_name": _unknown(cases, "deleted", lambda c: bool(c.wrong)),
        "explained_share": _explained(cases),
        "parameter_error": _errors(cases),
        "coverage": _coverage(cases),
        "calibration_error": _calibration(cases),
    }
    for name, row in rows.items():
        set_goal(row, *GOALS[name])
    for name in ("named_at_3_floor", "named_at_3_floor_left"):
        set_goal(rows[name]["top_2"], *SECOND_GUESS)
    covered = rows["coverage"]
    if covered["value"] is not None and covered["value"] > COVERAGE_MOST:
        covered["met"] = "good"
    return rows


def beside(cases: Sequence[Judged]) -> dict[str, Any]:
    """What is worth knowing and is no row: small sizes, strangers, all by effect, failures."""
    small = [c for c in cases if c.kind == "single" and c.ratio < AT_1]
    return {
        "named_below_floor": naming(small),
        "named_below_floor_left": naming(
            c for c in cases if c.kind == "single" and c.left < LEFT_1
        ),
        "strangers_unexplained": _unknown(cases, "stranger", lambda c: c.says_unknown),
        "strangers_wrong_name": _unknown(cases, "stranger", lambda c: bool(c.wrong)),
        "failed": share(bool(c.failure) for c in cases),
        "seconds_median": float(np.median([c.seconds for c in cases])) if cases else None,
        "by_concealment": {
            way: naming(
                c for c in cases if c.kind == "single" and c.concealment == way and c.ratio >= AT_3
            )
            for way in sorted({c.concealment for c in cases if c.kind == "single"})
        },
        "by_effect": {
            name: naming(
                c for c in cases if c.kind == "single" and c.hidden == (name,) and c.ratio >= AT_3
            )
            for name in sorted({c.hidden[0] for c in cases if c.kind == "single"})
        },
    }


def set_goal(row: Row, good: float, great: float, more: bool) -> None:
    """Write a row's goals into it, and which of them it meets."""
    row["good"], row["great"] = good, great
    value = row["value"]
    if value is None:
        row["met"] = "unknown"
        return
    sign = 1.0 if more else -1.0
    row["met"] = "no"
    for name, goal in (("good", good), ("great", great)):
        if sign * value >= sign * goal:
            row["met"] = name


def naming(cases: Iterable[Judged]) -> Row:
    """The first name right by class; within: the second guess, by name, and as a full set."""
    told = list(cases)
    return {
        **share(c.first_right for c in told),
        "top_2": share(c.second_right for c in told),
        "by_name": share(c.first_exact for c in told),
        "nothing_else": share(c.set_right for c in told),
        "nothing_named": share(not c.named for c in told),
    }


def _certain(cases: Sequence[Judged]) -> Row:
    sure = [
        c
        for c in cases
        if c.verdict == "explained" and any(n.probability > CERTAIN for n in c.named)
    ]
    return {
        **share(c.certain_and_wrong for c in cases),
        "of_the_certain": share(c.certain_and_wrong for c in sure),
    }


def _sets(cases: Sequence[Judged], kind: str) -> Row:
    own = [c for c in cases if c.kind == kind]
    large = [c for c in own if c.ratio >= AT_3]
    return {
        **share(c.set_right for c in large),
        "by_name": share(c.set_exact for c in large),
        "at_all_sizes": share(c.set_right for c in own),
        "no_wrong_name": share(not c.wrong for c in large),
    }


def _alarms(cases: Sequence[Judged]) -> Row:
    nulls = [c for c in cases if c.kind == "null"]
    return {
        **share(c.alarms for c in nulls),
        "names_a_cause": share(bool(c.named) for c in nulls),
    }


def _unknown(cases: Sequence[Judged], kind: str, right: Callable[[Judged], bool]) -> Row:
    own = [c for c in cases if c.kind == kind]
    return {
        **share(right(c) for c in own if c.ratio >= AT_3),
        "at_all_sizes": share(right(c) for c in own),
    }


def _explained(cases: Sequence[Judged]) -> Row:
    known = [c for c in cases if c.kind not in (*UNKNOWN_KINDS, "null") and c.ratio >= AT_1]
    rows = [np.array([c.explained]) for c in known if c.explained is not None]
    return {
        **mean(rows),
        "median": median(rows),
    }


def _errors(cases: Sequence[Judged]) -> Row:
    def rows(least: float) -> list[Floats]:
        own = [c for c in cases if c.kind == "single" and c.ratio >= least]
        return [np.array([p.error for p in c.checked if p.main]) for c in own]

    return {**median(rows(AT_3)), "at_all_sizes": median(rows(0.0))}


def _coverage(cases: Sequence[Judged]) -> Row:
    def rows(main: bool) -> list[Floats]:
        return [
            np.array(
                [float(p.covered) for p in c.checked if p.main is main and p.covered is not None]
            )
            for c in cases
        ]

    return {**mean(rows(True)), "of_shapes": mean(rows(False))}


def _calibration(cases: Sequence[Judged]) -> Row:
    def rows(by_class: bool) -> list[Floats]:
        found = []
        for c in cases:
            own = [
                (n.class_probability, n.label != "wrong") if by_class else (n.probability, n.exact)
                for n in c.named
            ]
            found.append(np.array(own, np.float64).reshape(-1, 2))
        return found

    return {
        **statistic(rows(by_class=False), calibration_error),
        "by_class": statistic(rows(by_class=True), calibration_error),
    }
