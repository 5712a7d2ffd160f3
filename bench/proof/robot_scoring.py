"""Rows of whole robots: where a misfit was found, and the joints' rows on their own cases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .judging import UNKNOWN_KINDS, Judged
from .places import Place
from .scoring import (
    AT_3,
    LEFT_1,
    LEFT_3,
    Row,
    beside,
    mean,
    median,
    naming,
    score,
    set_goal,
    share,
)

#: good and great by row; more is better
GOALS: Mapping[str, tuple[float, float, bool]] = {
    "joint_group_f1": (0.80, 0.97, True),
    "phase_right": (0.90, 0.98, True),
}
WITHOUT = "the proof was run without --robots"
#: rows of the joints that no robot's case speaks for: the plan asks for no triple, and what is left
#: beside tolerances is measured after a robot's score is written (:mod:`bench.proof.robots_left`)
NOT_OF_ROBOTS = ("full_set_triples", "named_at_3_floor_left", "named_at_1_to_3_floor_left")


def place_rows(cases: Sequence[Judged]) -> dict[str, Row]:
    """Where what is hidden was found, of all cases in which something is."""
    rows = {"joint_group_f1": _f1(cases), "phase_right": _phase(cases)}
    for name, row in rows.items():
        set_goal(row, *GOALS[name])
    return rows


def robot_score(cases: Sequence[Judged]) -> dict[str, Any]:
    """The joints' rows of robots' cases, and what is beside them."""
    rows = {name: row for name, row in score(cases).items() if name not in NOT_OF_ROBOTS}
    by_scene = {
        scene: place_rows([c for c in cases if c.rig == scene])
        for scene in sorted({c.rig for c in cases})
    }
    return {
        "cases": len(cases),
        "rows": rows,
        "beside": {
            **beside(cases),
            "named_at_3_floor_walking": naming(
                c for c in cases if c.kind == "single" and c.walking >= LEFT_3
            ),
            "named_at_1_to_3_floor_walking": naming(
                c for c in cases if c.kind == "single" and LEFT_1 <= c.walking < LEFT_3
            ),
            "place_by_scene": by_scene,
        },
    }


def _f1(cases: Sequence[Judged]) -> Row:
    large = [c for c in cases if c.ratio >= AT_3]

    def of(some: Sequence[Judged], number: Callable[[Place], float]) -> Row:
        return mean([np.array([number(c.place)]) for c in some if c.place is not None])

    return {
        **of(large, lambda p: p.f1),
        "in_some_joints": of(
            [c for c in large if c.place is not None and not c.place.everywhere], lambda p: p.f1
        ),
        "nameable": of([c for c in large if c.kind not in UNKNOWN_KINDS], lambda p: p.f1),
        "of_mismatch": of(large, lambda p: p.mismatch_f1),
        "at_all_sizes": of(cases, lambda p: p.f1),
    }


def _phase(cases: Sequence[Judged]) -> Row:
    walked = [c for c in cases if c.place is not None and c.place.true_phase]
    every = [(c.place, c.ratio >= AT_3) for c in walked if c.place is not None]
    return {
        **share(place.phase_right for place, large in every if large),
        "told_at_all": share(bool(place.told_phase) for place, large in every if large),
        "at_all_sizes": share(place.phase_right for place, _ in every),
        "share_off": median(
            [np.array([abs(p.told_stance - p.true_stance)]) for p, _ in every if p.told_phase]
        ),
    }
