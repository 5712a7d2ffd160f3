"""What a search leaves behind: ``result.json``, ``best.toml``, ``landscape.png``, and its words."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from typing import Any

import tomli_w

from hal.cpg import Gait

from ..experiments.experiment import Comparison
from ..figures.style import save
from ..figures.tables import aligned
from ..files import finite, write_json, write_text
from .candidate import Candidate
from .figure import landscape
from .methods import Method
from .outcome import Outcome, Reason
from .search import Found, Result

FORMAT = "busemu-gait-search/1"
NUMBERS, PICTURE, BEST = "result.json", "landscape.png", "best.toml"
NOT_ITS = "the thesis's original stride and its recordings are not published"


def write_report(result: Result, folder: Path) -> list[Path]:
    """Write the files, each whole or not at all, and tell which. Raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / NUMBERS, document(result))
    save(landscape(result), folder / PICTURE)
    written = [folder / NUMBERS, folder / PICTURE]
    best = result.best
    if best is None or best.candidate is None:
        (folder / BEST).unlink(missing_ok=True)  # of an earlier, shorter search
        return written
    write_text(folder / BEST, tomli_w.dumps(best.candidate.document(result.robot)))
    return [*written, folder / BEST]


def document(result: Result) -> dict[str, Any]:
    """The content of ``result.json``; SI, and ``null`` for what is not known."""
    plan, best = result.plan, result.best
    told: dict[str, Any] = {
        "format": FORMAT,
        "robot": result.robot.name,
        "file": str(result.robot.path),
        "budget_a_method": plan.budget,
        "seconds": plan.seconds,
        "check_seconds": plan.check_s,
        "seed": plan.seed,
        "torque_limit_of_stall": result.original.torque_limit,
        "original": _walk(result.original, result),
        "methods": {found.method.value: _method(found, result) for found in result.found},
        "best_method": best.method.value if best is not None else None,
        "beside_the_thesis": [asdict(row) for row in comparisons(result)],
    }
    known: dict[str, Any] = finite(told)
    return known


def _method(found: Found, result: Result) -> dict[str, Any]:
    forbidden = {
        reason.value: sum(reason in outcome.reasons for outcome in found.outcomes)
        for reason in Reason
    }
    return {
        "walks": len(found.outcomes),
        "allowed": sum(outcome.allowed for outcome in found.outcomes),
        "forbidden_by": forbidden,
        "fastest_allowed_after_each_walk_m_s": found.course_m_s,
        "refuted_by_checks": [_walk(outcome, result) for outcome in found.refuted],
        "checks": [_walk(outcome, result) for outcome in found.checks],
        "gain": _gain(found, result) if found.checks else None,
    }


def _walk(outcome: Outcome, result: Result) -> dict[str, Any]:
    measured = asdict(outcome)
    job = measured.pop("job")
    del measured["torque_limit"]  # the same for all, and told once
    return {
        **job["candidate"],
        "seed": job["seed"],
        "seconds": job["seconds"],
        "stride_commanded_m": _stride_m(outcome.job.candidate, result),
        "stride_of_body_m": outcome.stride_m,
        **measured,
        "torque_margin_of_limit": outcome.torque_margin,
        "forbidden_by": [reason.value for reason in outcome.reasons],
    }


def _gain(found: Found, result: Result) -> dict[str, float]:
    """Means of the checks over the original walk."""
    checks, original = found.checks, result.original
    candidate = checks[0].job.candidate
    return {
        "stride_commanded": candidate.stride,
        "stride_of_body": fmean(c.stride_m for c in checks) / original.stride_m,
        "speed": found.speed_m_s / original.speed_m_s,
        "distance": fmean(c.distance_m for c in checks) / original.distance_m,
        "energy": fmean(c.energy_j for c in checks) / original.energy_j,
        "energy_a_metre": fmean(c.energy_j_m for c in checks) / original.energy_j_m,
    }


def _stride_m(candidate: Candidate, result: Result) -> float:
    return candidate.stride * Gait.of(result.robot).stride_m


def comparisons(result: Result) -> tuple[Comparison, ...]:
    """The best gait, and the grid's, beside the thesis's."""
    rows = []
    for found in result.found:
        if not found.checks:
            continue
        gain = _gain(found, result)
        rows.append(
            Comparison(
                f"stride over the original, {_named(found.method)}",
                f"{gain['stride_commanded']:.1f} x commanded, {gain['stride_of_body']:.1f} x by "
                f"the body; speed {gain['speed']:.1f} x",
                "4 x, by grid search over v_left and v_right",
                NOT_ITS,
            )
        )
    rows += _strides_that_touch(result)
    best = result.best
    if best is not None:
        margin = min(check.torque_margin for check in best.checks)
        true = max(check.true_torque_of_stall for check in best.checks)
        rows.append(
            Comparison(
                "torque of the best gait",
                f"largest {max(c.torque_of_stall for c in best.checks):.2f} x stall, "
                f"{margin:.0%} below the limit; with shocks, in the gear, {true:.2f}",
                "below 0.75 x stall",
                NOT_ITS,
            )
        )
    return tuple(rows)


def _strides_that_touch(result: Result) -> list[Comparison]:
    """The shortest stride of the grid at which links touch."""
    touching = [
        outcome.job.candidate
        for found in result.found
        if found.method is Method.GRID
        for outcome in found.outcomes
        if Reason.SELF_COLLISION in outcome.reasons
    ]
    if not touching:
        return []
    first = min(touching, key=lambda c: max(c.v_left, c.v_right))
    return [
        Comparison(
            "self-collision, all but the strides as it was",
            f"from v_left = {first.v_left:.1f}, v_right = {first.v_right:.1f} on",
            "at 6 x, none at 4 x",
            "the stride of the robot file was chosen to be so",
        )
    ]


def _named(method: Method) -> str:
    return {Method.CMA: "CMA-ES over the whole gait", Method.GRID: "grid"}[method]


def summary(result: Result) -> str:
    """The walks as a table, what was tried, and the numbers beside the thesis's."""
    rows = [_row("original", [result.original], result)]
    rows += [_row(_named(f.method), list(f.checks), result) for f in result.found if f.checks]
    head = ("gait", "v_left", "v_right", "period", "stride", "speed", "distance", "energy",
            "torque")  # fmt: skip
    lines = [aligned(head, rows), ""]
    for found in result.found:
        lines.append(f"- {_named(found.method)}: {_tried(found)}")
    table = aligned(
        ("beside the thesis", "here", "thesis"),
        [(row.what, row.ours, row.thesis) for row in comparisons(result)],
    )
    return "\n".join([*lines, "", table, f"not to be compared strictly: {NOT_ITS}"])


def _row(name: str, walks: list[Outcome], result: Result) -> tuple[str, ...]:
    """Means over walks, the largest torque."""
    candidate = walks[0].job.candidate
    return (
        name,
        f"{candidate.v_left:.2f}",
        f"{candidate.v_right:.2f}",
        f"{candidate.period_s:.2f} s",
        f"{_stride_m(candidate, result) * 1e3:.0f} mm",
        f"{fmean(w.speed_m_s for w in walks) * 1e3:.0f} mm/s",
        f"{fmean(w.distance_m for w in walks):.2f} m",
        f"{fmean(w.energy_j for w in walks):.0f} J",
        f"{max(w.torque_of_stall for w in walks):.2f} stall",
    )


def _tried(found: Found) -> str:
    allowed = sum(outcome.allowed for outcome in found.outcomes)
    said = f"{len(found.outcomes)} walks, {allowed} allowed"
    forbidden = [
        f"{count} {reason.value}"
        for reason in Reason
        if (count := sum(reason in outcome.reasons for outcome in found.outcomes))
    ]
    if forbidden:
        said += f" (forbidden: {', '.join(forbidden)})"
    if found.refuted:
        said += f"; {len(found.refuted)} faster did not stand the check"
    return said if found.checks else f"{said}; no gait stood the check"


def walk_command(result: Result, folder: Path) -> str | None:
    """The command that walks the best gait, but for its port."""
    best = result.best
    if best is None or best.candidate is None:
        return None
    found = best.candidate
    path = shlex.quote(str(folder / BEST))
    return f"busemu walk --robot {path} --v-left {found.v_left!r} --v-right {found.v_right!r}"
