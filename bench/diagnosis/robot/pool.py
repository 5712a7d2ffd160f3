"""Replays of a whole robot by several processes, each job told by names."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, field, fields
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from bench.starter import end_with_starter
from busemu.tables import Robot
from sim.entries import PhysicsError
from sim.model import read_model
from sim.tree import PhysicalRobot

from ..journal import Journal, code, digest
from ..sense import DiagnosisError
from .effects import Placed, placed_effects
from .features import Features
from .nuisances import RobotNuisance, Trial, trials, with_nuisances
from .replay import Course, Jitter, loaded, play
from .rise import Rise

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Job:
    """A replay: of a recording, with effects at values of their knobs, trials, another start.

    ``nuisances`` are values of deviations, of all or of none. ``short``: only of a few cycles of
    the gait, where there is one; ``rise``: only until it walks, for windows of :class:`Rise`.
    """

    recording: int
    effects: tuple[tuple[str, float], ...] = ()  #: placed effect and ``z``
    trials: tuple[tuple[str, float], ...] = ()  #: name and how much of its size
    nuisances: tuple[float, ...] = ()
    jitter: int = 0  #: seed; 0 is the plain start
    short: bool = False
    rise: bool = False


def _nothing() -> Floats:
    return np.empty(0)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Means of a replay as :class:`Features` has them; NaN where the engine could not run it.

    What a replay was not asked for is empty.
    """

    angle_rad: Floats = field(default_factory=_nothing)
    height_m: Floats = field(default_factory=_nothing)
    lean_rad: Floats = field(default_factory=_nothing)
    voltage_v: Floats = field(default_factory=_nothing)
    shaken: Floats = field(default_factory=_nothing)
    duty: Floats = field(default_factory=_nothing)
    speed_rad_s: Floats = field(default_factory=_nothing)
    turn_rad: Floats = field(default_factory=_nothing)
    scatter_rad2: Floats = field(default_factory=_nothing)
    #: share of samples at which the leg's foot pressed
    pressed: Floats = field(default_factory=_nothing)
    risen_rad: Floats = field(default_factory=_nothing)


ROWS = tuple(one.name for one in fields(Outcome))


def _key(robot: Robot, course: Course) -> str:
    """A hash of all that a replay of a recording depends on, but the job."""
    arrays = [*course.sample_s, *course.wait_s, *course.position_rad]
    arrays += [*(course.height or ()), *(course.lean or ()), *(course.voltage or ())]
    arrays += [part for told in course.duty for part in told]
    goals = [part for goal in course.goals.values() for part in goal]
    told = sorted(course.condition.items(), key=str)
    return digest(code(), robot.document, told, course.start, course.events, *arrays, *goals)


class _Bench:
    """What a process needs: the robot as believed and the recordings."""

    def __init__(
        self, robot: Robot, features: Sequence[Features], every: Sequence[RobotNuisance]
    ) -> None:
        self.features, self.nuisances = features, every
        base = read_model(robot)
        self.rises = [Rise.of(found) for found in features]
        self._believed = [loaded(robot, found.course.condition) for found in features]
        self.placed: dict[str, Placed] = placed_effects(base)
        self.trials: dict[str, Trial] = {trial.name: trial for trial in trials(base)}

    def _built(self, job: Job) -> PhysicalRobot:
        """The robot of a job. Raises :class:`PhysicsError` for one that there cannot be."""
        robot = self._believed[job.recording]
        for name, z in job.effects:
            placed = self.placed[name]
            robot = placed.apply(robot, placed.knob.value(z))
        if job.nuisances:
            robot = with_nuisances(robot, self.nuisances, job.nuisances)
        for name, share in job.trials:
            trial = self.trials[name]
            robot = trial.change(robot, share * trial.size)
        return robot

    def run(self, job: Job) -> Outcome:
        """Replay."""
        if job.rise:
            return Outcome(risen_rad=self._risen(job))
        found = self.features[job.recording]
        try:
            robot = self._built(job)
            jitter = Jitter(job.jitter) if job.jitter else None
            track = play(robot, found.course, jitter, found.span if job.short else None)
        except PhysicsError:
            lost = np.full(len(found.bin), np.nan)
            watched = found.height_m, found.lean_rad, found.voltage_v
            own = (*watched, found.shaken, found.regulated.recorded)
            others = [np.full(len(x), np.nan) for x in own]
            height, lean, volts, shaken, duty = others
            return Outcome(lost, height, lean, volts, shaken, duty, lost, lost, lost, lost)
        means = (*found.of_track(track), found.regulated.rows(robot))
        if job.short:
            return Outcome(*means)
        pressed = found.pressed(track, robot)
        return Outcome(*means, *found.speeds(track), found.scatter(track), pressed)

    def _risen(self, job: Job) -> Floats:
        """Rows of how a robot stands up; NaN where the engine could not run it."""
        rise = self.rises[job.recording]
        assert rise is not None
        jitter = Jitter(job.jitter) if job.jitter else None
        course = self.features[job.recording].course
        try:
            track = play(self._built(job), course, jitter, (0.0, rise.end_s))
        except PhysicsError:
            return np.full(len(rise.recorded), np.nan)
        return rise.rows([track.at(j, t) for j, t in enumerate(rise.sample_s)])


_bench: _Bench | None = None


def _begin(
    robot: Robot, features: Sequence[Features], every: Sequence[RobotNuisance], parent: int
) -> None:
    """Make a process ready; it ends with the one that started it, however that ends."""
    global _bench  # noqa: PLW0603 - one a process
    _bench = _Bench(robot, features, every)

    end_with_starter(parent)


def _run(job: Job) -> Outcome:
    assert _bench is not None
    return _bench.run(job)


class Replays:
    """Runs jobs on ``processes`` (as many as there are cores, if None), and keeps what came out."""

    def __init__(
        self,
        robot: Robot,
        features: Sequence[Features],
        every: Sequence[RobotNuisance],
        processes: int | None = None,
        journal: Journal | None = None,
    ) -> None:
        self._journal = journal
        self._keys = [_key(robot, found.course) for found in features] if journal else []
        self._known: dict[Job, Outcome] = {}
        self._here = _Bench(robot, features, every)
        count = processes or len(os.sched_getaffinity(0))
        self._pool: ProcessPoolExecutor | None = None
        if count > 1:
            with suppress(PermissionError):  # a confined process gets no semaphores: it does all
                self._pool = ProcessPoolExecutor(
                    count,
                    multiprocessing.get_context("fork"),  # a robot's mappings cannot be pickled
                    _begin,
                    (robot, features, every, os.getpid()),
                )
        self.processes = 1 if self._pool is None else count  #: that replay at a time
        self.count = 0  #: replays run so far

    def run(self, jobs: Iterable[Job]) -> list[Outcome]:
        """Outcomes of jobs, in their order; those known already cost nothing.

        Raises :class:`DiagnosisError` if a process has died.
        """
        wanted = list(jobs)
        new = [job for job in dict.fromkeys(wanted) if job not in self._known]
        new = [job for job in new if not self._recalled(job)]
        try:
            self._keep(new)
        except BrokenProcessPool:
            raise DiagnosisError(
                "a process that replayed recordings has died (out of memory?): the same command "
                "goes on from there; on one core (taskset -c 0 ...) it needs less memory"
            ) from None
        return [self._known[job] for job in wanted]

    def _keep(self, new: Sequence[Job]) -> None:
        """Run jobs; what came of them is known from then on."""
        if self._pool is not None and len(new) > 1:
            found: Iterable[Outcome] = self._pool.map(_run, new)
        else:
            found = map(self._here.run, new)
        for job, outcome in zip(new, found, strict=True):
            self._known[job] = outcome
            self.count += 1
            if self._journal is not None:
                given = {name: getattr(outcome, name).tolist() for name in ROWS}
                self._journal.put(digest(self._keys[job.recording], job), given)

    def _recalled(self, job: Job) -> bool:
        """Whether an earlier run has kept it."""
        if self._journal is None:
            return False
        kept = self._journal.get(digest(self._keys[job.recording], job))
        if kept is None:
            return False
        self._known[job] = Outcome(*(np.array(kept[name], np.float64) for name in ROWS))
        return True

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
