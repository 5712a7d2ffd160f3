"""What is left that the recordings agree about, and no hypothesis predicts.

A free function of the joint's state is fitted to what a hypothesis leaves, on some groups of
recordings, and judged on the others; of a single group, on some of its recordings. What it predicts
there is structure the catalogue lacks; what it cannot predict is noise, however large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..observed import held_at
from .model import Blocks, JointModel, Kind
from .search import folds

Floats = NDArray[np.float64]

WAVES = 60  #: random features of position and velocity
RIDGE = 3.0  #: penalty, in samples a feature
INDEPENDENT_S = 0.1  #: assumed: samples closer than this count as one


@dataclass(frozen=True, slots=True)
class Remainder:
    """What a free function predicts of the rest: deviation [rad], share, and which terms count."""

    predicted_rad: float
    share: float  #: of the squared rest on recordings not used to fit it; below 0 is none
    agreeing: float  #: share of the recordings in which it predicts anything
    terms: tuple[tuple[str, float], ...]  #: correlation with the rest, the strongest first


def remainder(model: JointModel, blocks: Blocks, seed: int = 0) -> Remainder:
    """What is left of the positions that can be predicted in recordings left out."""
    tables, values, names = [], [], [""]
    random = np.random.default_rng(seed)
    waves = random.normal(size=(5, WAVES)), random.uniform(0.0, 2.0 * np.pi, WAVES)
    keys = [r for r in range(len(model.observed)) if (r, Kind.POSITION) in blocks]
    scales = _scales(model, keys)
    for r in keys:
        block = blocks[r, Kind.POSITION]
        names, plain = _terms(model, r, scales)
        free = np.cos(plain[:, :5] @ waves[0] + waves[1]) * np.sqrt(2.0 / WAVES) * 3.0
        thin = max(1, round(INDEPENDENT_S / max(1e-3, float(np.median(np.diff(block.t_s))))))
        thin = min(thin, len(block.value))
        kept = len(block.value) // thin * thin
        table = np.concatenate([plain, free], axis=1)[:kept]
        tables.append(table.reshape(-1, thin, table.shape[1]).mean(axis=1))
        values.append(block.value[:kept].reshape(-1, thin).mean(axis=1))
    parts = _parts(model, keys)
    if len(parts) == 1:  # a recording alone: each half is judged by the other
        tables = [half for table in tables for half in np.array_split(table, 2)]
        values = [half for value in values for half in np.array_split(value, 2)]
        parts = [[0], [1]]
    pieces = range(len(values))
    predicted: dict[int, Floats] = {}
    for part in parts:
        rest = [i for i in pieces if i not in part]
        weights = _ridge(
            np.concatenate([tables[i] for i in rest]), np.concatenate([values[i] for i in rest])
        )
        for i in part:
            predicted[i] = tables[i] @ weights
    y = np.concatenate(values)
    guess = np.concatenate([predicted[i] for i in pieces])
    total = float(np.sum(y**2)) + 1e-300
    gains = [
        float(np.sum(values[i] ** 2) - np.sum((values[i] - predicted[i]) ** 2)) for i in pieces
    ]
    stacked = np.concatenate(tables)[:, : len(names)]
    terms = sorted(
        ((name, _correlation(stacked[:, k], y)) for k, name in enumerate(names)),
        key=lambda pair: -abs(pair[1]),
    )
    return (
        Remainder(
            predicted_rad=float(np.sqrt(max(0.0, sum(gains)) / len(y))),
            share=1.0 - float(np.sum((y - guess) ** 2)) / total,
            agreeing=float(np.mean([gain > 0.0 for gain in gains])),
            terms=tuple(terms[:4]),
        )
        if total > 0.0
        else Remainder(0.0, 0.0, 0.0, ())
    )


def _parts(model: JointModel, keys: Sequence[int]) -> list[list[int]]:
    """Places in ``keys`` by parts that judge each other: by group, of one group by recording."""
    place = {r: i for i, r in enumerate(keys)}
    parts = [[place[r] for r in part if r in place] for part in folds(model)]
    parts = [part for part in parts if part]
    return parts if len(parts) > 1 else [[i] for i in range(len(keys))]


def _scales(model: JointModel, keys: Sequence[int]) -> Floats:
    columns = [_state(model, r) for r in keys]
    scale: Floats = np.asarray(np.std(np.concatenate(columns), axis=0) + 1e-9, np.float64)
    return scale


def _state(model: JointModel, r: int) -> Floats:
    """Position, velocity, error, goal's velocity and acceleration at the good samples."""
    one = model.observed[r]
    good = one.position.good
    t, q = one.position.t_s[good], one.position.value[good]
    smooth: Floats = np.convolve(np.pad(q, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
    velocity: Floats = np.asarray(np.gradient(smooth, t), np.float64)
    slow: Floats = np.convolve(np.pad(velocity, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
    goal = held_at(one.goal, t)
    goal_velocity = np.gradient(goal, t)
    return np.stack([q, slow, goal - q, goal_velocity, np.gradient(slow, t)], axis=1)


def _terms(model: JointModel, r: int, scales: Floats) -> tuple[list[str], Floats]:
    q, v, e, gv, a = (_state(model, r) / scales).T
    names = ["position", "velocity", "error", "goal velocity", "acceleration", "direction"]
    names += ["speed", "direction x error", "square of velocity", "constant"]
    way: Floats = np.tanh(5.0 * v)
    columns = [q, v, e, gv, a, way, np.abs(v), way * np.abs(e), v * np.abs(v), np.ones_like(q)]
    return names, np.stack(columns, axis=1)


def _ridge(table: Floats, values: Floats) -> Floats:
    normal = table.T @ table + RIDGE * np.eye(table.shape[1])
    weights: Floats = np.asarray(np.linalg.solve(normal, table.T @ values), np.float64)
    return weights


def _correlation(a: Floats, b: Floats) -> float:
    spread = np.std(a) * np.std(b)
    return float(np.mean((a - a.mean()) * (b - b.mean())) / spread) if spread > 0.0 else 0.0
