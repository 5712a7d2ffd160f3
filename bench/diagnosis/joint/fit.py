"""Fitting a hypothesis: nuisances under their priors, knobs within their bounds, noise in turns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ..journal import digest
from ..noise import Noise, cost, estimate, huber_weight, whiten
from .model import Blocks, Hypothesis, JointModel, Kind

Floats = NDArray[np.float64]

STEP = 0.1  #: of a knob in finite differences at first, in its unit or its value
NUISANCE_STEP = (
    0.7  #: in deviations of its prior, and less where that is longer than the range below
)
TICKS_S = 0.002  #: least step of times: firmware has a tick of 1 ms
SMOOTHEST = 0.25  #: share of the numbers that show roughness alone; others show bends, too
#: a finite difference shall be so many deviations of noise long, within this range: friction and
#: rounding in a position law make a rollout rough, and a short difference would see only that
LONG, RANGE = 10.0, (5.0, 25.0)
STEPS = (0.005, 1.0)  #: a knob's least and greatest step, in its unit or its value
#: that of a nuisance, which has a size of its own: shortened if it is longer, to so many, and to no
#: less than this share. A secant over a bend is a slope that nothing has: of several numbers that
#: make up for each other it leaves a rest, and a fit creeps along their valley
NUISANCE_LONG, NUISANCE_RANGE, SHORTEST = 30.0, 50.0, 0.04
ROUNDS = 8  #: of fitting and of estimating the noise in turns, at most
DAMPINGS = (1e-3, 0.03, 1.0, 30.0)  #: factors on the damping that are tried together
ENOUGH = 1.0  #: gain of a step [nats] at which a fit is done: the likelihood is rough by more
EDGE = 1e-3  #: how close to a bound a knob counts as at it


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A hypothesis at its likeliest values: ``z`` as in :class:`JointModel`, noise by kind."""

    hypothesis: Hypothesis
    z: Floats
    noise: Mapping[Kind, Noise]
    cost: float  #: negative log-likelihood with the priors [nats]
    costs: Mapping[tuple[int, Kind], float] = field(default_factory=dict)  #: by block, no priors


def bounds(model: JointModel, hypothesis: Hypothesis) -> tuple[Floats, Floats]:
    """The least and the greatest value of every number of a vector.

    A nuisance stays at 0 where it is idle.
    """
    idle = model.idle(hypothesis)
    ends = [(0.0, 0.0) if n.name in idle else n.ends for n in model.nuisances]
    low, high = zip(*ends, *(k.bounds for k in hypothesis.knobs), strict=True)
    return np.array(low), np.array(high)


def prior_cost(model: JointModel, z: Floats) -> float:
    """What the nuisances' values cost under their priors [nats]."""
    return 0.5 * float(np.sum(z[: len(model.nuisances)] ** 2))


def block_costs(blocks: Blocks, noise: Mapping[Kind, Noise]) -> dict[tuple[int, Kind], float]:
    """Negative log-likelihood of every block [nats]."""
    return {key: cost(block, noise[key[1]]) for key, block in blocks.items()}


def estimate_noise(
    model: JointModel, blocks: Blocks, start: Mapping[Kind, Noise] | None = None
) -> dict[Kind, Noise]:
    """The likeliest noise of every kind."""
    noise = {}
    for kind, floor in model.floors().items():
        some = [block for key, block in blocks.items() if key[1] is kind]
        if some:
            noise[kind] = estimate(some, floor, start.get(kind) if start else None)
    return noise


def whitened(blocks: Sequence[Blocks], noise: Mapping[Kind, Noise]) -> tuple[Floats, Floats]:
    """The first blocks' whitened residual (n,) and how the others differ from it (n, others)."""
    residuals, differences = [], []
    for key, block in blocks[0].items():
        columns = np.stack([b[key].value for b in blocks], axis=1)
        out, _ = whiten(block, noise[key[1]], columns)
        residuals.append(out[:, 0])
        differences.append(out[:, 1:] - out[:, :1])
    return np.concatenate(residuals), np.concatenate(differences)


def steps(
    model: JointModel, hypothesis: Hypothesis, z: Floats, relative: Floats | None = None
) -> Floats:
    """Signed steps of finite differences that stay within the bounds.

    ``relative`` are those of the knobs, in their units or, where they are greater, values.
    """
    low, high = bounds(model, hypothesis)
    count = len(model.nuisances)
    if relative is None:
        relative = np.full(len(hypothesis.knobs), STEP)
    least = np.array(
        [TICKS_S / k.unit if k.parameter.unit == "s" else 0.0 for k in hypothesis.knobs]
    )
    knobs = np.maximum(relative * np.maximum(1.0, np.abs(z[count:])), least)
    size = np.concatenate([np.full(count, NUISANCE_STEP), knobs])
    up, below = high - z, z - low
    down = (size > up) & ((size <= below) | (below > up))  # the side with more room, if any has
    most = np.maximum(np.maximum(up, below), 1e-9)
    signed: Floats = np.where(down, -1.0, 1.0) * np.minimum(size, most)
    return signed


def linearise(
    model: JointModel,
    hypothesis: Hypothesis,
    z: Floats,
    noise: Mapping[Kind, Noise],
    which: Sequence[int] | None = None,
) -> tuple[Floats, Floats]:
    """Whitened residual (n,) and its Jacobian (n, len(z)) at ``z``, without priors."""
    around = Around(model, hypothesis, z, noise, which)
    size, change = around.forward()
    return around.residual, change / size


class Around:
    """Whitened residuals at a vector, and how they differ in steps from there."""

    def __init__(
        self,
        model: JointModel,
        hypothesis: Hypothesis,
        z: Floats,
        noise: Mapping[Kind, Noise],
        which: Sequence[int] | None = None,
    ) -> None:
        self.model, self.hypothesis, self.z, self.noise = model, hypothesis, z, noise
        self.which = which
        self.base = model.residuals(hypothesis, [z], which)[0]
        self.residual, _ = whitened([self.base], noise)

    def change(self, size: Floats, columns: Sequence[int]) -> Floats:
        """How the residual changes when each of some numbers takes its step (n, columns)."""
        moved: list[Blocks] = [{}] * len(columns)
        for controller, kinds in ((True, tuple(Kind)), (False, (Kind.POSITION, Kind.VOLTAGE))):
            these = [
                i
                for i, k in enumerate(columns)
                if self.model.turns_controller(self.hypothesis, k) is controller
            ]
            if these:
                vectors = []
                for i in these:
                    vectors.append(self.z.copy())
                    vectors[-1][columns[i]] += size[columns[i]]
                found = self.model.residuals(self.hypothesis, vectors, self.which, kinds)
                for i, blocks in zip(these, found, strict=True):
                    moved[i] = self.base | blocks
        return whitened([self.base, *moved], self.noise)[1]

    def forward(self) -> tuple[Floats, Floats]:
        """Steps (len(z),) long enough to be seen, and what they change (n, len(z))."""
        model, hypothesis, z = self.model, self.hypothesis, self.z
        size = steps(model, hypothesis, z)
        change = self.change(size, range(len(z)))
        count = len(model.nuisances)
        length = np.linalg.norm(change, axis=0)
        again = self._of_knobs(length[count:])
        share = np.maximum(NUISANCE_LONG / np.maximum(length[:count], NUISANCE_LONG), SHORTEST)
        again[:count] = np.where(length[:count] > NUISANCE_RANGE, share, 1.0) * size[:count]
        columns = np.flatnonzero(np.abs(again) != np.abs(size)).tolist()
        if columns:
            change[:, columns] = self.change(again, columns)
            size[columns] = again[columns]
        return size, change

    def _of_knobs(self, length: Floats) -> Floats:
        """All steps, those of knobs (whose lengths were these) as long as they should be."""
        badly = (length < RANGE[0]) | (length > RANGE[1])
        wanted = np.clip(STEP * LONG / np.maximum(length, 1e-9), *STEPS)
        return steps(self.model, self.hypothesis, self.z, np.where(badly, wanted, STEP))

    def slopes(self) -> tuple[Floats, Floats]:
        """The Jacobian (n, len(z)) from steps both ways, and what roughness adds to its squares.

        Friction and rounding make a rollout rough: two that hardly differ come out a little apart.
        What the two steps of a number leave when they are added shows by how much; without it, a
        direction in which nothing changes would seem to be known.
        """
        low, high = bounds(self.model, self.hypothesis)
        size, change = self.forward()
        both = np.flatnonzero((self.z - size >= low) & (self.z - size <= high))
        back = self.change(-size, both.tolist())
        left = np.sum((change[:, both] + back) ** 2, axis=0) / 6.0  # of r+, r- and twice r
        rough = float(np.quantile(left, SMOOTHEST)) if len(both) else 0.0
        jacobian = change / size
        jacobian[:, both] = (change[:, both] - back) / (2.0 * size[both])
        added = 2.0 * rough / size**2
        added[both] = 0.5 * rough / size[both] ** 2
        return jacobian, added


def fit(
    model: JointModel,
    hypothesis: Hypothesis,
    start: Floats,
    noise: Mapping[Kind, Noise] | None = None,
    which: Sequence[int] | None = None,
    rounds: int = ROUNDS,
    evaluations: int = 3,
    held: Sequence[int] = (),
) -> Fit:
    """Fit a hypothesis from ``start`` on some recordings (all); numbers ``held`` stay there.

    A fit that was kept is not done again.
    """
    key = ""
    if model.journal is not None:
        told = sorted((k.value, n) for k, n in noise.items()) if noise else None
        numbers = (told, which and list(which), rounds, evaluations, list(held))
        key = digest("fit", model.key, hypothesis.knobs, start, numbers)
        if (kept := model.journal.get(key)) is not None:
            return _recalled(hypothesis, kept)
    found = _fitted(model, hypothesis, start, noise, which, rounds, evaluations, held)
    if model.journal is not None:
        model.journal.put(key, _kept(found))
    return found


def _kept(found: Fit) -> dict[str, Any]:
    return {
        "z": found.z.tolist(),
        "noise": {k.value: [n.white, n.coloured, n.memory_s] for k, n in found.noise.items()},
        "cost": found.cost,
        "costs": [[r, kind.value, x] for (r, kind), x in found.costs.items()],
    }


def _recalled(hypothesis: Hypothesis, kept: Mapping[str, Any]) -> Fit:
    return Fit(
        hypothesis,
        np.array(kept["z"], np.float64),
        {Kind(name): Noise(*numbers) for name, numbers in kept["noise"].items()},
        kept["cost"],
        {(r, Kind(name)): x for r, name, x in kept["costs"]},
    )


def _fitted(
    model: JointModel,
    hypothesis: Hypothesis,
    start: Floats,
    noise: Mapping[Kind, Noise] | None,
    which: Sequence[int] | None,
    rounds: int,
    evaluations: int,
    held: Sequence[int],
) -> Fit:
    low, high = bounds(model, hypothesis)
    z = np.clip(start, low, high)
    low[list(held)] = high[list(held)] = z[list(held)]
    blocks = model.residuals(hypothesis, [z], which)[0]
    noise = estimate_noise(model, blocks, noise)
    best: Fit | None = None
    for _ in range(rounds):
        z = least_squares(model, hypothesis, z, noise, which, (low, high), evaluations)
        blocks = model.residuals(hypothesis, [z], which)[0]
        noise = estimate_noise(model, blocks, noise)
        costs = block_costs(blocks, noise)
        found = Fit(
            hypothesis,
            z,
            noise,
            sum(costs.values()) + prior_cost(model, z),
            costs,
        )
        if best is not None and found.cost > best.cost - ENOUGH:
            return found if found.cost < best.cost else best
        best = found
    assert best is not None
    return best


def bounded_step(
    system: Floats, slope: Floats, z: Floats, box: tuple[Floats, Floats], method: str = "trf"
) -> Floats:
    """The step from ``z`` within a box of the least of ``x system x / 2 + slope x``.

    ``method`` is that of :func:`scipy.optimize.lsq_linear`. Raises ``numpy.linalg.LinAlgError`` for
    a system that is not positive definite.
    """
    root = np.linalg.cholesky(system).T
    wanted = np.linalg.solve(root.T, -slope)
    ends = box[0] - z - 1e-9, box[1] - z + 1e-9
    step: Floats = lsq_linear(root, wanted, ends, method=method).x
    return step


def least_squares(
    model: JointModel,
    hypothesis: Hypothesis,
    start: Floats,
    noise: Mapping[Kind, Noise],
    which: Sequence[int] | None,
    box: tuple[Floats, Floats],
    evaluations: int,
) -> Floats:
    """Levenberg and Marquardt's way within bounds; several dampings are tried in one batch."""
    count = len(model.nuisances)
    prior = np.zeros(len(start))
    prior[:count] = 1.0

    def costs(vectors: Sequence[Floats]) -> list[float]:
        found = model.residuals(hypothesis, vectors, which)
        return [
            sum(block_costs(b, noise).values()) + 0.5 * float(np.sum(prior * v * v))
            for b, v in zip(found, vectors, strict=True)
        ]

    def equations(z: Floats) -> tuple[Floats, Floats]:
        residual, jacobian = linearise(model, hypothesis, z, noise, which)
        weight = huber_weight(residual)
        normal = (jacobian * weight[:, None]).T @ jacobian + np.diag(prior)
        return normal, jacobian.T @ (weight * residual) + prior * z

    z, damping = start, 1e-2
    now = costs([z])[0]
    normal, slope = equations(z)
    moved = False
    for _ in range(evaluations):
        if moved:
            normal, slope = equations(z)
            moved = False
        scale = np.maximum(np.diag(normal), 1e-9)
        tried, factors = [], []
        for factor in DAMPINGS:
            system = normal + np.diag(damping * factor * scale)
            try:
                step = bounded_step(system, slope, z, box)
            except np.linalg.LinAlgError:  # too near singular: only more damping helps
                continue
            tried.append(np.clip(z + step, *box))
            factors.append(factor)
        if not tried:
            damping *= 100.0
            continue
        values = costs(tried)
        best = int(np.argmin(values))
        if not values[best] < now:
            damping *= 100.0
            if damping > 1e6:
                break
            continue
        gained, now = now - values[best], values[best]
        z, moved = tried[best], True
        damping = max(1e-6, damping * factors[best])
        if gained < ENOUGH:
            break
    return z
