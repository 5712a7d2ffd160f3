"""Other ways to name a cause, on the same data: what is in use, each with its budget.

``python -m bench.proof.baselines STAGE OUT METHOD`` runs one of them as a diagnosis is run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import cma
import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from bench.diagnosis.running import without_effects
from bench.files import write_json
from bench.recording import read
from busemu.tables import load_robot
from sim.effects import Effect
from sim.model import read_model

from .answering import ANSWER
from .diagnosing import joint_names, left_out, split_of
from .fitting import Outcome, blocks, grid, least_squares, limits, mean_square
from .staging import TOLD
from .terms import EFFECT_OF, lagged, library

Floats = NDArray[np.float64]

WORTH = 0.10  #: of the squared error that a named effect must remove; assumed
NUISANCE_ROUNDS, EFFECT_ROUNDS = 4, 4
REFINED = 5  #: effects that BIC fits after a look at a grid
MOST_EFFECTS = 3
EVOLVED = 1500  #: candidates of the evolution
SPREAD = 0.3  #: of its first candidates, in typical sizes
RIDGE = 1e-3
SPARSE_ROUNDS = 10
SPARSE_LEAST = 0.15  #: of the residual's deviation that a kept term must move


@dataclass(frozen=True, eq=False)
class Bench:
    """The recordings of a case, to fit and to judge, and the effects that may be named."""

    model: JointModel
    judge: JointModel
    effects: Mapping[str, Effect]
    nuisances: Floats  #: fitted to the believed model by least squares

    def judged(self, hypothesis: Hypothesis, knobs: Floats, nuisances: Floats) -> float:
        """Mean square on what judges."""
        return mean_square(blocks(self.judge, hypothesis, [np.concatenate([nuisances, knobs])])[0])

    @property
    def before(self) -> float:
        """Mean square of the believed model on what judges, nuisances fitted."""
        return self.judged(Hypothesis(), np.zeros(0), self.nuisances)

    @property
    def start(self) -> float:
        """Mean square of the believed model on what is fitted."""
        return mean_square(blocks(self.model, Hypothesis(), [self.nuisances])[0])

    def nothing(self, budget: str) -> Outcome:
        """A method that names nothing."""
        return Outcome(Hypothesis(), np.zeros(0), (), self.before, self.before, budget)

    def tried(self, base: Hypothesis, z: Floats) -> list[tuple[float, str, Floats]]:
        """Every effect at its best size on a grid, added to a hypothesis: square, name, vector."""
        found = []
        for name, effect in self.effects.items():
            if name in base.effects:
                continue
            knobs = effect_knobs(effect)
            vectors = [np.concatenate([z, x]) for x in grid(knobs)]
            squares = [mean_square(b) for b in blocks(self.model, base + knobs, vectors)]
            best = int(np.argmin(squares))
            found.append((squares[best], name, vectors[best]))
        return sorted(found, key=lambda row: row[0])


def grid_search(bench: Bench) -> Outcome:
    """The effect and the size with the least RMSE on a grid, nothing else fitted."""
    zero = np.zeros(len(bench.model.nuisances))
    believed = mean_square(blocks(bench.model, Hypothesis(), [zero])[0])
    best, name, z = bench.tried(Hypothesis(), zero)[0]
    count = sum(len(grid(effect_knobs(effect))) for effect in bench.effects.values())
    budget = f"{count} candidates"
    before = bench.before
    if best > (1.0 - WORTH) * believed:
        after = bench.judged(Hypothesis(), np.zeros(0), zero)
        return Outcome(Hypothesis(), np.zeros(0), (), before, after, budget)
    hypothesis = Hypothesis(effect_knobs(bench.effects[name]))
    knobs = z[len(zero) :]
    return Outcome(
        hypothesis, knobs, (name,), before, bench.judged(hypothesis, knobs, zero), budget
    )


def evolution(bench: Bench) -> Outcome:
    """Everything at once by CMA-ES on the squared error; named is what is missed most when off."""
    knobs = tuple(k for effect in bench.effects.values() for k in effect_knobs(effect))
    hypothesis = Hypothesis(knobs)
    low, high = limits(bench.model, hypothesis)
    off = np.concatenate([bench.nuisances, [np.clip(0.0, *k.bounds) for k in knobs]])
    search = cma.CMAEvolutionStrategy(
        off,
        SPREAD,
        {
            "bounds": [low.tolist(), (high + 1e-9).tolist()],
            "maxfevals": EVOLVED,
            "seed": 1,
            "verbose": -9,
        },
    )
    while not search.stop():
        candidates = search.ask()
        vectors = [np.clip(np.asarray(c), low, high) for c in candidates]
        search.tell(candidates, [mean_square(b) for b in blocks(bench.model, hypothesis, vectors)])
    z = np.clip(np.asarray(search.result.xbest), low, high)
    count = len(bench.model.nuisances)
    best = mean_square(blocks(bench.model, hypothesis, [z])[0])
    losses = []
    for name in bench.effects:
        without = z.copy()
        own = [count + i for i, k in enumerate(knobs) if k.effect == name]
        without[own] = off[own]
        loss = mean_square(blocks(bench.model, hypothesis, [without])[0]) - best
        losses.append((loss, name))
    names = tuple(n for loss, n in sorted(losses, reverse=True) if loss > WORTH * bench.start)
    after = bench.judged(hypothesis, z[count:], z[:count])
    budget = f"{EVOLVED} candidates of {len(z)} numbers"
    return Outcome(hypothesis, z[count:], names[:MOST_EFFECTS], bench.before, after, budget)


def information(bench: Bench) -> Outcome:
    """Effects added one by one while BIC falls, every sample taken for independent."""
    count = len(bench.nuisances)
    found = blocks(bench.model, Hypothesis(), [bench.nuisances])[0]
    samples = sum(len(block.value) for block in found.values())
    hypothesis, z, square = Hypothesis(), bench.nuisances, mean_square(found)
    names: list[str] = []

    def criterion(square: float, numbers: int) -> float:
        return float(samples * np.log(square) + numbers * np.log(samples))

    while len(names) < MOST_EFFECTS:
        fitted = []
        for _, name, start in bench.tried(hypothesis, z)[:REFINED]:
            more = hypothesis + effect_knobs(bench.effects[name])
            vector, left = least_squares(bench.model, more, start, range(len(start)), EFFECT_ROUNDS)
            fitted.append((criterion(left, len(vector)), name, more, vector, left))
        best = min(fitted, key=lambda row: row[0], default=None)
        if best is None or best[0] >= criterion(square, len(z)):
            break
        _, name, hypothesis, z, square = best
        names.append(name)
    budget = f"{REFINED} fits a step after a grid of all effects"
    after = bench.judged(hypothesis, z[count:], z[:count])
    return Outcome(hypothesis, z[count:], tuple(names), bench.before, after, budget)


def sparse(bench: Bench) -> Outcome:
    """Least squares on equation terms, small ones dropped in turns (Brunton et al., PNAS 2016)."""
    terms, residual = library(bench.model, blocks(bench.model, Hypothesis(), [bench.nuisances])[0])
    scale = np.std(terms, axis=0)
    scale[0] = 1.0
    keep = scale > 1e-9
    weights = np.zeros(terms.shape[1])
    for _ in range(SPARSE_ROUNDS):
        weights[:] = 0.0
        if not keep.any():
            break
        weights[keep] = np.linalg.lstsq(terms[:, keep], residual, rcond=None)[0]
        small = np.abs(weights) * scale < SPARSE_LEAST * np.std(residual)
        if not (keep & small).any():
            break
        keep &= ~small
    other, rest = library(bench.judge, blocks(bench.judge, Hypothesis(), [bench.nuisances])[0])
    before, after = float(np.mean(rest**2)), float(np.mean((rest - other @ weights) ** 2))
    budget = f"{len(EFFECT_OF)} terms"
    if after > (1.0 - WORTH) * before:
        return bench.nothing(budget)
    strength = dict(zip(EFFECT_OF.values(), np.abs(weights) * scale, strict=True))
    ranked = sorted((n for n in strength if strength[n] > 0.0), key=lambda n: -strength[n])
    names = tuple(name for name in ranked if name in bench.effects)[:1]
    return Outcome(Hypothesis(), np.zeros(0), names, before, after, budget)


def black_box(bench: Bench) -> Outcome:
    """Ridge regression of the residual on goals now and before; it names nothing."""
    rows, residual = lagged(bench.model, blocks(bench.model, Hypothesis(), [bench.nuisances])[0])
    middle, spread = rows.mean(axis=0), rows.std(axis=0) + 1e-9
    scaled = np.column_stack([np.ones(len(rows)), (rows - middle) / spread])
    normal = scaled.T @ scaled + RIDGE * len(rows) * np.eye(scaled.shape[1])
    weights = np.linalg.solve(normal, scaled.T @ residual)
    other, rest = lagged(bench.judge, blocks(bench.judge, Hypothesis(), [bench.nuisances])[0])
    told = np.column_stack([np.ones(len(other)), (other - middle) / spread]) @ weights
    before, after = float(np.mean(rest**2)), float(np.mean((rest - told) ** 2))
    budget = f"{scaled.shape[1]} features"
    return Outcome(Hypothesis(), np.zeros(0), (), before, after, budget)


#: by name; each with what it is in a word
METHODS: Mapping[str, Callable[[Bench], Outcome]] = MappingProxyType(
    {
        "grid": grid_search,
        "evolution": evolution,
        "information": information,
        "sparse": sparse,
        "black_box": black_box,
    }
)


def bench_of(stage: Path) -> tuple[Bench, list[str]]:
    """The recordings that are staged, and the names of those that judge."""
    told = json.loads((stage / TOLD).read_text("utf-8"))
    robot = load_robot(stage / "robot.toml")
    recordings = [read(path) for path in sorted((stage / "recordings").glob("*.parquet"))]
    parts = split_of(recordings, told["held_out"])
    base = read_model(robot)
    joint = base.joints[0].name
    model, judge = (
        JointModel(base, robot, observe(part, robot, joint))
        for part in (parts.fitted, parts.judging)
    )
    zero = np.zeros(len(model.nuisances))
    nuisances, _ = least_squares(model, Hypothesis(), zero, range(len(zero)), NUISANCE_ROUNDS)
    effects = without_effects(left_out(told, joint_names()))
    return Bench(model, judge, effects, nuisances), [r.name for r in parts.judging]


def main(stage: Path, out: Path, method: str) -> None:
    """Run one method on what is staged."""
    bench, judging = bench_of(stage)
    write_json(out / ANSWER, METHODS[method](bench).document(judging))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
