"""What the rival methods share: positions alone, squared errors, plain least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.model import Blocks, Hypothesis, JointModel, Kind
from bench.diagnosis.knobs import Knob

Floats = NDArray[np.float64]

SIZES = (0.1, 0.3, 1.0, 2.0, 4.0)  #: of amplitudes, in typical sizes
SHAPES = (-1.0, 0.0, 1.0)
STEP = 0.02  #: of finite differences
DAMPINGS = (1e-4, 1e-2, 1.0)
NUISANCE_MOST = 3.0  #: deviations that a nuisance may take
UNSTABLE = 1e6  #: a mean square [rad^2] that is none


def blocks(model: JointModel, hypothesis: Hypothesis, vectors: Sequence[Floats]) -> list[Blocks]:
    """Residuals of positions for every vector."""
    return model.residuals(hypothesis, vectors, None, (Kind.POSITION,))


def mean_square(found: Blocks) -> float:
    """Mean square of positions [rad^2]."""
    values = np.concatenate([block.value for block in found.values()])
    square = float(np.mean(values**2))
    return square if np.isfinite(square) else UNSTABLE


def limits(model: JointModel, hypothesis: Hypothesis) -> tuple[Floats, Floats]:
    """The least and the greatest value of every number."""
    reach = [NUISANCE_MOST] * len(model.nuisances)
    low = [-r for r in reach] + [k.bounds[0] for k in hypothesis.knobs]
    high = reach + [k.bounds[1] for k in hypothesis.knobs]
    return np.array(low), np.array(high)


def grid(knobs: Sequence[Knob]) -> list[Floats]:
    """Sizes of an effect to try: amplitudes together, shapes in all combinations."""
    tried = []
    shapes = [SHAPES for k in knobs if k.parameter.shape]
    two_sided = any(not k.parameter.shape and k.bounds[0] < 0.0 for k in knobs)
    for size in (*SIZES, *(-s for s in SIZES)) if two_sided else SIZES:
        for shape in product(*shapes):
            left = list(shape)
            row = [left.pop(0) if k.parameter.shape else size for k in knobs]
            tried.append(np.array([np.clip(x, *k.bounds) for x, k in zip(row, knobs, strict=True)]))
    return tried


def least_squares(
    model: JointModel, hypothesis: Hypothesis, start: Floats, free: Sequence[int], rounds: int
) -> tuple[Floats, float]:
    """Levenberg and Marquardt on positions, every sample as if it were independent."""
    low, high = limits(model, hypothesis)
    z = np.clip(start, low, high)
    now = mean_square(blocks(model, hypothesis, [z])[0])
    for _ in range(rounds):
        steps = np.where(z + STEP > high, -STEP, STEP)
        moved = [z + np.eye(len(z))[k] * steps[k] for k in free]
        base, *rest = (
            np.concatenate([b.value for b in found.values()])
            for found in blocks(model, hypothesis, [z, *moved])
        )
        slope = np.stack(
            [(row - base) / steps[k] for row, k in zip(rest, free, strict=True)], axis=1
        )
        normal = slope.T @ slope
        scale = np.diag(np.diag(normal) + 1e-12)
        tries = []
        for damping in DAMPINGS:
            move = np.linalg.lstsq(normal + damping * scale, -slope.T @ base, rcond=None)[0]
            ahead = z.copy()
            ahead[list(free)] += move
            tries.append(np.clip(ahead, low, high))
        squares = [mean_square(found) for found in blocks(model, hypothesis, tries)]
        best = int(np.argmin(squares))
        if squares[best] >= now * (1.0 - 1e-4):
            break
        z, now = tries[best], squares[best]
    return z, now


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a method says: effects by rank with their values, and squares on what judges."""

    hypothesis: Hypothesis
    knobs: Floats  #: values of the hypothesis's knobs
    names: tuple[str, ...]
    before: float  #: mean square [rad^2] of the believed model, its nuisances fitted
    after: float
    budget: str  #: in words

    def document(self, recordings: Sequence[str]) -> dict[str, Any]:
        """In the form of a diagnosis; a method that states no probability has none but 1."""
        causes = []
        for name in self.names:
            own = zip(self.hypothesis.knobs, self.knobs.tolist(), strict=True)
            told = {k.parameter.name: _finite(k.value(z)) for k, z in own if k.effect == name}
            causes.append(
                {
                    "effect": name,
                    "probability": 1.0,
                    "indistinguishable_from": [],
                    "parameters": {
                        key: {"value": value, "ci95": [None, None]} for key, value in told.items()
                    },
                }
            )
        return {
            "verdict": "explained" if causes else "consistent",
            "causes": causes,
            "fit": {
                "before": float(np.sqrt(self.before)),
                "after": float(np.sqrt(self.after)),
                "held_out": True,
                "recordings": list(recordings),
            },
            "budget": self.budget,
        }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
