"""A search from beginning to end: the original gait, one or both methods, a check of the best.

What a method finds fastest is walked again from other start states of the pattern generators, for
ten seconds, and counts only if it keeps every rule there, too; else the next fastest is tried.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from busemu.tables import Robot

from .candidate import Candidate, GaitSearchError, Space
from .ledger import Ledger
from .methods import Method, evolution, grid_search, grid_values
from .outcome import Job, Outcome
from .walks import Walks

#: The thesis's walks took so long; no check is shorter [s].
CHECK_S = 10.0
#: A checked gait has walked from so many start states.
CHECKS = 3
#: So many of a method's fastest gaits are checked at most.
FASTEST = 5

#: Told of every finished walk, and whether it is new or from an earlier run.
Tell = Callable[[Outcome, bool], None]


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be searched."""

    budget: int = 100  #: walks a method
    seconds: float = 10.0  #: of a walk
    seed: int = 0
    methods: tuple[Method, ...] = (Method.CMA, Method.GRID)
    begin: Candidate | None = None  #: a gait from which CMA-ES goes on; else the robot file's own

    @property
    def check_s(self) -> float:
        """Length of the walks that check [s]."""
        return max(self.seconds, CHECK_S)

    @property
    def walks(self) -> int:
        """About how many walks that takes, if the first gait of each method stands the check."""
        of = {Method.CMA: self.budget, Method.GRID: grid_values(self.budget) ** 2}
        return sum(of[method] + CHECKS for method in self.methods) + 1


@dataclass(frozen=True, slots=True)
class Found:
    """What one method found."""

    method: Method
    outcomes: tuple[Outcome, ...]  #: in the order they were asked for
    checks: tuple[Outcome, ...]  #: of the fastest gait that stood the check; empty if none did
    refuted: tuple[Outcome, ...]  #: faster ones that did not: the walk that broke a rule

    @property
    def candidate(self) -> Candidate | None:
        """The fastest checked gait."""
        return self.checks[0].job.candidate if self.checks else None

    @property
    def speed_m_s(self) -> float:
        """Mean speed of the checks; 0 if nothing was found."""
        return sum(c.speed_m_s for c in self.checks) / len(self.checks) if self.checks else 0.0

    @property
    def course_m_s(self) -> list[float]:
        """Speed of the fastest allowed walk after each walk [m/s]."""
        fastest, course = 0.0, []
        for outcome in self.outcomes:
            fastest = max(fastest, outcome.speed_m_s if outcome.allowed else 0.0)
            course.append(fastest)
        return course


@dataclass(frozen=True, slots=True)
class Result:
    """A whole search."""

    robot: Robot
    plan: Plan
    original: Outcome  #: the robot file's own gait, walked as long as the checks
    found: tuple[Found, ...]

    @property
    def best(self) -> Found | None:
        """The method whose checked gait is the fastest."""
        checked = [found for found in self.found if found.checks]
        return max(checked, key=lambda found: found.speed_m_s, default=None)


class GaitSearch:
    """Runs a plan on a robot; walks in the ledger are not made again."""

    def __init__(
        self, robot: Robot, plan: Plan, ledger: Ledger, walks: Walks, tell: Tell | None = None
    ) -> None:
        self.robot = robot
        self.plan = plan
        self._ledger = ledger
        self._walks = walks
        self._tell = tell or (lambda _outcome, _new: None)

    def run(self) -> Result:
        """Search. Raises :class:`GaitSearchError`; walks finished until then are kept."""
        original = Candidate.original(self.robot)
        if not original.reachable(self.robot):
            raise GaitSearchError(
                f"{self.robot.path}: its own gait is out of the legs' reach: mend [gait] first"
            )
        (first,) = self._outcomes([Job(original, self.plan.check_s, self.plan.seed)])
        found = tuple(self._search(method, Space(original)) for method in self.plan.methods)
        return Result(self.robot, self.plan, first, found)

    def _search(self, method: Method, space: Space) -> Found:
        plan = self.plan

        def evaluate(candidates: Sequence[Candidate]) -> list[Outcome]:
            return self._outcomes([Job(c, plan.seconds, plan.seed) for c in candidates])

        def reachable(candidate: Candidate) -> bool:
            return candidate.reachable(self.robot)

        if method is Method.GRID:
            outcomes = grid_search(space, evaluate, reachable, plan.budget)
        else:
            outcomes = evolution(space, evaluate, reachable, plan.budget, plan.seed, plan.begin)
        return self._checked(Found(method, tuple(outcomes), (), ()))

    def _checked(self, found: Found) -> Found:
        allowed = [outcome for outcome in found.outcomes if outcome.allowed]
        fastest = sorted(allowed, key=lambda outcome: outcome.rank)[:FASTEST]
        refuted: list[Outcome] = []
        for outcome in fastest:
            seeds = range(self.plan.seed, self.plan.seed + CHECKS)
            jobs = [Job(outcome.job.candidate, self.plan.check_s, seed) for seed in seeds]
            checks = self._outcomes(jobs)
            broken = [check for check in checks if not check.allowed]
            if not broken:
                return replace(found, checks=tuple(checks), refuted=tuple(refuted))
            refuted.append(broken[0])
        return replace(found, refuted=tuple(refuted))

    def _outcomes(self, jobs: Sequence[Job]) -> list[Outcome]:
        """Outcomes in the order of the jobs."""
        known = {job: outcome for job in jobs if (outcome := self._ledger.get(job)) is not None}
        for outcome in known.values():
            self._tell(outcome, False)
        for outcome in self._walks.run([job for job in dict.fromkeys(jobs) if job not in known]):
            known[outcome.job] = judged = self._ledger.add(outcome)
            self._tell(judged, True)
        return [known[job] for job in jobs]
