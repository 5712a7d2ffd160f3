"""The diagnoses of an arm's joints as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..result import Diagnosis, FitSummary, verdict_of
from .diagnosis import JointFindings
from .shared import united


def together(findings: Sequence[JointFindings]) -> Diagnosis:
    """One diagnosis of all joints; that of a single joint as it is.

    Consistent only if all joints are; unexplained if something is left and no joint has a cause;
    partly explained if something is left at any joint. What the robot has once is one cause of all
    joints that found it. ``fit`` is the deviation over the positions of all joints; what each joint
    has by itself stands in ``details`` under ``joints``.
    """
    if len(findings) == 1:
        return findings[0].diagnosis
    each = [found.diagnosis for found in findings]
    explainable = {
        joint_of(one): _count(one) * max(0.0, d.fit.before**2 - d.fit.noise_floor**2)
        for one, d in zip(findings, each, strict=True)
    }
    causes = united([cause for d in each for cause in d.causes], explainable)
    unexplained = tuple(rest for d in each for rest in d.unexplained)
    verdict = verdict_of(bool(causes), bool(unexplained))
    return Diagnosis(
        verdict=verdict,
        mismatch=tuple(place for d in each for place in d.mismatch),
        causes=tuple(sorted(causes, key=lambda c: -c.held_out_gain_nats)),
        fit=_fit(findings),
        unexplained=unexplained,
        next_experiment=tuple(
            replace(n, arguments=dict(n.arguments) | {"joint": joint_of(found)})
            for found in findings
            for n in found.diagnosis.next_experiment
        ),
        limits=_limits(findings),
        channels=_channels(each),
        rejected=_of_joints(findings, "rejected"),
        ranking=_of_joints(findings, "ranking"),
        details={"joints": {joint_of(found): _row(found) for found in findings}},
    )


def joint_of(found: JointFindings) -> str:
    """The joint that was diagnosed."""
    return found.model.observed[0].joint


def _count(found: JointFindings) -> int:
    return sum(int(o.position.good.sum()) for o in found.judge.observed)


def _fit(findings: Sequence[JointFindings]) -> FitSummary:
    counts = np.array([_count(found) for found in findings], np.float64)
    fits = [found.diagnosis.fit for found in findings]

    def over_all(name: str) -> float:
        squares = np.array([getattr(fit, name) for fit in fits]) ** 2
        return float(np.sqrt(counts @ squares / counts.sum()))

    return FitSummary(
        before=over_all("before"),
        after=over_all("after"),
        noise_floor=over_all("noise_floor"),
        held_out=all(fit.held_out for fit in fits),
        recordings=tuple(dict.fromkeys(name for fit in fits for name in fit.recordings)),
    )


def _limits(findings: Sequence[JointFindings]) -> tuple[str, ...]:
    joints: dict[str, list[str]] = {}
    for found in findings:
        for limit in found.diagnosis.limits:
            joints.setdefault(limit, []).append(joint_of(found))
    told = [
        limit if len(own) == len(findings) else f"{', '.join(own)}: {limit}"
        for limit, own in joints.items()
    ]
    return (
        *told,
        "each joint by itself, under the recorded motion of the others: shocks shorter than a few "
        "reads are smoothed away, and masses found joint by joint are not in model.toml",
    )


def _channels(each: Sequence[Diagnosis]) -> tuple[Mapping[str, Any], ...]:
    rows: dict[str, list[Mapping[str, Any]]] = {}
    for diagnosis in each:
        for row in diagnosis.channels:
            rows.setdefault(str(row["channel"]), []).append(row)
    return tuple(
        dict(own[0])
        | {
            key: float(np.sqrt(np.mean([row[key] ** 2 for row in own if row[key] is not None])))
            for key in ("rms_before", "rms_after", "rounding", "noise")
            if any(row[key] is not None for row in own)
        }
        for own in rows.values()
    )


def _of_joints(findings: Sequence[JointFindings], name: str) -> tuple[Mapping[str, Any], ...]:
    return tuple(
        dict(row) | {"joint": joint_of(found)}
        for found in findings
        for row in getattr(found.diagnosis, name)
    )


def _row(found: JointFindings) -> dict[str, Any]:
    d = found.diagnosis
    return {
        "verdict": d.verdict,
        "before": d.fit.before,
        "after": d.fit.after,
        "noise_floor": d.fit.noise_floor,
        "effects": [cause.effect for cause in d.causes],
    } | dict(d.details)
