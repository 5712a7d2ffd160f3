"""Replays of a whole robot by several processes, each job told by names."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from sim.entries import PhysicsError
from sim.tree import PhysicalRobot

from .robot_effects import Placed, placed_effects
from .robot_features import Features
from .robot_nuisances import Trial, trials
from .robot_replay import Jitter, loaded, play

Floats = NDArray[np.float64]

WATCH_S = 1.0  #: how often a process looks whether the one that started it is still there


@dataclass(frozen=True, slots=True)
class Job:
    """A replay: of a recording, with effects at values of their knobs, a trial, another start."""

    recording: int
    effects: tuple[tuple[str, float], ...] = ()  #: placed effect and ``z``
    trial: str = ""
    jitter: int = 0  #: seed; 0 is the plain start


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Means of a replay as :class:`Features` has them; empty where the engine could not run it."""

    angle_rad: Floats
    height_m: Floats
    speed_rad_s: Floats
    turn_rad: Floats
    scatter_rad2: Floats


class _Bench:
    """What a process needs: the base robot and the recordings."""

    def __init__(self, base: PhysicalRobot, features: Sequence[Features]) -> None:
        self.base, self.features = base, features
        self.placed: dict[str, Placed] = placed_effects(base)
        self.trials: dict[str, Trial] = {trial.name: trial for trial in trials(base)}

    def run(self, job: Job) -> Outcome:
        """Replay."""
        found = self.features[job.recording]
        robot = loaded(self.base, found.course.condition)
        for name, z in job.effects:
            placed = self.placed[name]
            robot = placed.apply(robot, placed.knob.value(z))
        if job.trial:
            trial = self.trials[job.trial]
            robot = trial.change(robot, trial.size)
        try:
            track = play(robot, found.course, Jitter(job.jitter) if job.jitter else None)
        except PhysicsError:
            lost = np.full(len(found.bin), np.nan)
            return Outcome(lost, np.full(len(found.height_m), np.nan), lost, lost, lost)
        speed, turn = found.speeds(track)
        return Outcome(*found.of_track(track), speed, turn, found.scatter(track))


_bench: _Bench | None = None


def _begin(base: PhysicalRobot, features: Sequence[Features], parent: int) -> None:
    """Make a process ready; it ends with the one that started it, however that ends."""
    global _bench  # noqa: PLW0603 - one a process
    _bench = _Bench(base, features)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _run(job: Job) -> Outcome:
    assert _bench is not None
    return _bench.run(job)


class Replays:
    """Runs jobs on ``processes`` (as many as there are cores, if None), and keeps what came out."""

    def __init__(
        self, base: PhysicalRobot, features: Sequence[Features], processes: int | None = None
    ) -> None:
        self._known: dict[Job, Outcome] = {}
        self._here = _Bench(base, features)
        count = processes or len(os.sched_getaffinity(0))
        self._pool: ProcessPoolExecutor | None = None
        if count > 1:
            self._pool = ProcessPoolExecutor(
                count,
                multiprocessing.get_context("fork"),  # a robot's mappings cannot be pickled
                _begin,
                (base, features, os.getpid()),
            )
        self.count = 0  #: replays run so far

    def run(self, jobs: Iterable[Job]) -> list[Outcome]:
        """Outcomes of jobs, in their order; those known already cost nothing."""
        wanted = list(jobs)
        new = [job for job in dict.fromkeys(wanted) if job not in self._known]
        if self._pool is not None and len(new) > 1:
            found: Iterable[Outcome] = self._pool.map(_run, new)
        else:
            found = map(self._here.run, new)
        for job, outcome in zip(new, found, strict=True):
            self._known[job] = outcome
            self.count += 1
        return [self._known[job] for job in wanted]

    def close(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def __enter__(self) -> Replays:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
