"""Recorded and modelled motion side by side: what the pictures of a report are drawn from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.diagnosis import JointFindings
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.joint.regimes import regimes, top_speed

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One joint in one recording; arrays of shape (n,), angles the servo's own.

    ``before`` and ``after`` are the modelled positions as the believed and the better model have
    them at the instants of ``measured_rad``; ``goal_rad`` is NaN where no goal is an angle;
    ``parts`` are masks over the same samples, by regime.
    """

    name: str
    group: str
    joint: str
    t_s: Floats
    goal_rad: Floats
    measured_rad: Floats
    before_rad: Floats
    after_rad: Floats
    parts: Mapping[str, Mask]

    @property
    def rms_before_rad(self) -> float:
        """Root mean square of what the believed model leaves."""
        return rms(self.measured_rad - self.before_rad)

    @property
    def rms_after_rad(self) -> float:
        """Root mean square of what the better model leaves."""
        return rms(self.measured_rad - self.after_rad)


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def traces_of(found: JointFindings) -> list[Trace]:
    """The recordings that judge, under both models."""
    judge = found.judge
    residuals = (
        judge.residuals(Hypothesis(), [found.before.z], kinds=(Kind.POSITION,))[0],
        judge.residuals(found.after.hypothesis, [found.after.z], kinds=(Kind.POSITION,))[0],
    )
    fastest = top_speed(judge.observed)
    traces = []
    for r, observed in enumerate(judge.observed):
        if (r, Kind.POSITION) not in residuals[0]:
            continue
        t, goals, measured = observed.motion
        before, after = (measured - blocks[r, Kind.POSITION].value for blocks in residuals)
        parts = {
            name: mask[observed.position.good] for name, mask in regimes(observed, fastest).items()
        }
        traces.append(
            Trace(
                observed.name, observed.group, observed.joint, t, goals, measured, before,
                after, parts,
            )
        )  # fmt: skip
    return traces


def worst(traces: Sequence[Trace]) -> Trace:
    """The recording that the believed model missed by most."""
    return max(traces, key=lambda trace: trace.rms_before_rad)


def typical(traces: Sequence[Trace]) -> Trace | None:
    """A recording that the believed model missed by a middling amount, of another group if any."""
    first = worst(traces)
    others = [t for t in traces if t.group != first.group] or [t for t in traces if t is not first]
    others.sort(key=lambda trace: trace.rms_before_rad)
    return others[len(others) // 2] if others else None
