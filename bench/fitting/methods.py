"""The ways of fitting, each from what it needs to a vector; the ledger sees every candidate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

import cma
import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.fit import fit, least_squares
from bench.diagnosis.joint.model import Hypothesis, Kind
from bench.diagnosis.noise import Noise

from .problem import Ledger, OutOfTimeError, Problem, Reached, SameModel, mae_rmse, unseen
from .replays import KernelReplay, LoopReplay, Residuals

Floats = NDArray[np.float64]

ROUNDS, STEPS = 12, 4  #: of least squares, the noise estimated between them
STILL = 1e-3  #: share of the error that a round must take off
MIDDLE, SPREAD = 0.5, 1.0 / 6.0  #: of the first generation in the box; source: optuna's sampler
#: steps as shares of the box, and changes of the error [rad], at which a search has ended; assumed
CONVERGED, CONVERGED_RAD = 1e-4, 1e-6
OURS, EVOLUTION = "ours, least squares", "CMA-ES on our kernel"
LIKELIHOOD = "ours, as a diagnosis"
LOOP = "bam's: CMA-ES, Python loop"

Search = Callable[[Problem, Residuals], Floats]


@dataclass(frozen=True, slots=True)
class Way:
    """A way of fitting; ``absolute`` if mean absolute errors are what it minimises."""

    search: Search
    replay: Callable[[SameModel, Hypothesis], Residuals]
    absolute: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """What a way came to: its numbers and errors in its own simulator, and what it took."""

    z: Floats
    fitted: tuple[float, float]  #: mean absolute error and root mean square [rad]
    judged: tuple[float, float]
    ledger: Ledger
    ended: Reached
    cut: bool  #: whether its time was up before it had ended

    @property
    def near(self) -> Reached:
        """When the error was first within 1 % of where it ended."""
        return self.ledger.reached(1.01 * self.ended.error)


def run(way: Way, problem: Problem, limit_s: float, tell: Callable[[float], None]) -> Fitted:
    """Fit a problem one way, for ``limit_s`` of processor time; ``tell`` hears the error [rad]."""
    replay = way.replay(problem.fitted, problem.hypothesis)
    replay([np.mean(problem.box, axis=0)])  # nothing is compiled or loaded on the clock
    ledger = Ledger(limit_s, way.absolute, tell)

    def watched(vectors: Sequence[Floats]) -> list[Floats]:
        found = replay(vectors)
        if not isinstance(replay, KernelReplay):  # whose model tells the ledger itself
            ledger.note(vectors, found)
        return found

    problem.fitted.watch = ledger.note
    cut = False
    try:
        z = way.search(problem, watched)
    except OutOfTimeError:
        z, cut = ledger.best, True
    finally:
        problem.fitted.watch = unseen
    ended = ledger.now((0.0, 0.0))
    judge = way.replay(problem.judge, problem.hypothesis)
    errors = [mae_rmse(simulate([z])[0]) for simulate in (replay, judge)]
    ended = ended._replace(error=errors[0][not way.absolute], rmse=errors[0][1])
    return Fitted(z, errors[0], errors[1], ledger, ended, cut)


def by_likelihood(problem: Problem, replay: Residuals) -> Floats:
    """As a diagnosis fits: what is left is noise with a memory, and wild samples count less."""
    return fit(problem.fitted, problem.hypothesis, problem.start).z


def by_squares(problem: Problem, replay: Residuals) -> Floats:
    """As the better model is fitted: what is left is noise without a memory."""
    z, before = problem.start, math.inf
    for _ in range(ROUNDS):
        now = mae_rmse(replay([z])[0])[1]
        if now > (1.0 - STILL) * before:
            break
        before, noise = now, {Kind.POSITION: Noise(now, 0.0, 1.0)}
        z = least_squares(problem.fitted, problem.hypothesis, z, noise, None, problem.box, STEPS)
    return z


def by_evolution(problem: Problem, replay: Residuals) -> Floats:
    """As bam does: CMA-ES from the middle of the box, one candidate after another."""
    low, high = problem.box
    search = cma.CMAEvolutionStrategy(
        np.full(len(low), MIDDLE),
        SPREAD,
        {
            "bounds": [0.0, 1.0],
            "seed": 1,
            "verbose": -9,
            "tolx": CONVERGED,
            "tolfun": CONVERGED_RAD,
        },
    )
    while not search.stop():
        shares = search.ask()
        errors = [mae_rmse(replay([low + np.asarray(x) * (high - low)])[0])[0] for x in shares]
        search.tell(shares, errors)
    return np.asarray(low + np.asarray(search.result.xbest) * (high - low))


def ways() -> dict[str, Way]:
    """All ways by name; the first is what the others are compared with.

    MuJoCo's is missing where the engine (of the extra ``proof``) is.
    """
    found = {
        OURS: Way(by_squares, KernelReplay),
        LIKELIHOOD: Way(by_likelihood, KernelReplay),
        EVOLUTION: Way(by_evolution, KernelReplay, absolute=True),
        LOOP: Way(by_evolution, LoopReplay, absolute=True),
    }
    if find_spec("mujoco") is not None:
        from .engine import LONG_STEP, MujocoReplay, by_differences  # noqa: PLC0415

        found["MuJoCo's, default step"] = Way(by_differences, MujocoReplay)
        longer = partial(by_differences, step=LONG_STEP)
        found[f"MuJoCo's, step {LONG_STEP:g}"] = Way(longer, MujocoReplay)
    return found
