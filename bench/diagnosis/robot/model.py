"""A whole robot in several recordings: residuals for any values of nuisances and knobs.

Replays of a whole robot take the time of hundreds of one joint's, so a vector is not replayed. What
a nuisance does is a trace replayed once a motion; what an effect does is replayed at a few values
of its knob and interpolated; traces add up. Contacts make traces rough: where a fit has led
somewhere, :meth:`RobotModel.recentre` replays exactly there, nuisances and all, and keeps the
difference, so that the next fit starts from truth and traces only say which way to go.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.tree import PhysicalRobot

from ..joint.nuisances import PUNCH, STALL, UNDOCUMENTED, has_punch
from ..journal import Journal
from ..noise import Block
from .curves import Curves, Rows
from .doubts import doubted
from .effects import Placed, placed_effects
from .features import APART_S, Features, RobotKind, by_kind, first_of, shown_by
from .leaning import AXES, nearest, turned
from .nuisances import RobotNuisance, nuisances, replayable, trials
from .pool import Job, Outcome, Replays
from .regulated import DUTY_FLOOR, with_loads
from .replay import Course
from .shaking import ENGINES_SHAKING
from .spread import of_starts, of_tolerances
from .weighing import Settings, Shown, Weighing

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Progress = Callable[[str], None]
RobotBlocks = dict[tuple[int, RobotKind], Block]
Told = tuple[Settings, tuple[float, ...]]  #: effects and nuisances, as a job has them

RATTLES = 3  #: replays with other starts of a robot whose teeth have play, of which means count
RATTLING = frozenset({"backlash"})  #: effects that make a leg in the air rattle
#: what two engines leave of the same walk when nuisances are fitted: nothing is said of less, as
#: reality is no nearer to one of them; source: measured, docs/explanation/two-engines.md
ENGINES_RAD = 1.0e-3
#: what is noise of a row of means in any case, rounding aside; source: measured of nulls of the
#: other engine, fits leave 0.6 mrad of a PhantomX (rounding and all) and 1.0 mrad of a Marvin
LEAST_NOISE_RAD = 0.5e-3
HEIGHT_FLOOR_M = 2e-4  #: of an observer's height; assumed of motion capture
LEAN_FLOOR_RAD = 1e-3  #: of a mean of a trunk's lean; assumed of an inertial sensor
#: of a mean of the servos' voltage registers: half a count of 0.1 V, and how a model's current
#: differs within a gait; assumed
VOLTAGE_FLOOR_V = 0.05
#: of the level that all of them show, as a share of the supply's: dividers of 1 %; assumed
VOLTAGE_SENSE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """What a search asks of a recording."""

    name: str
    group: str


def rows_of(outcome: Outcome) -> Rows:
    """The rows of a replay by kind."""
    watched = outcome.height_m, outcome.lean_rad, outcome.voltage_v
    return by_kind(outcome.angle_rad, *watched, outcome.shaken, outcome.duty)


def _rattles(job: Job) -> bool:
    return any(is_play(name) and z > 0.0 for name, z in job.effects)


def is_play(name: str) -> bool:
    """Whether a placed effect makes teeth rattle."""
    return name.partition("@")[0] in RATTLING


def _mean(every: Sequence[Rows]) -> Rows:
    return {kind: np.mean([rows[kind] for rows in every], axis=0) for kind in every[0]}


class RobotModel:
    """Residuals of a whole robot; a vector is the nuisances, then the knobs of some effects.

    Knobs are those of effects at places (:mod:`bench.diagnosis.robot.effects`), in the order of
    their names. ``without`` are nuisances that are taken to be known, by the first word of their
    names (``zero``). What nuisances do to recordings that are only ``judging`` is taken from a walk
    that is fitted. Replays are kept in the ``journal``. Close it, or use it with ``with``.
    """

    def __init__(
        self,
        base: PhysicalRobot,
        robot: Robot,
        courses: Sequence[Course],
        say: Progress = lambda _: None,
        processes: int | None = None,
        without: Collection[str] = (),
        judging: Collection[int] = (),
        journal: Journal | None = None,
    ) -> None:
        self.base, self.robot = base, robot
        self.features = tuple(Features.of(course, robot) for course in courses)
        self.observed = tuple(Observed(c.name, c.group) for c in courses)
        self.quantum_rad = courses[0].quantum_rad
        if not undocumented_punch(robot, courses):
            without = {*without, PUNCH}
        if all("torque_constant_nm_a" in drive for drive in robot.document["drive"].values()):
            without = {*without, STALL}
        some = [trial for trial in trials(base) if trial.name.split()[0] not in without]
        every = doubted(robot, nuisances(base, self.quantum_rad))
        self.nuisances = tuple(n for n in every if n.name.split()[0] not in without)
        self.placed: dict[str, Placed] = placed_effects(base)
        #: for each recording, the first like it
        self.motion = first_of(self.features, Features.like)
        self._repeated = first_of(self.features, Features.repeats)
        self._following = False
        #: for each recording, the motion whose traces and curves are taken for its own
        self.like = shown_by(self.features, self.motion, judging)
        self._own = [self._rows_in(m, r) for r, m in enumerate(self.like)]
        self.replays = Replays(robot, self.features, self.nuisances, processes, journal)
        self._joints = [joint.name for joint in base.joints]
        say("replaying the recordings")
        self._exact = self.replays.run([Job(r) for r in self._every])  #: that of each centre
        self.centre: list[Rows] = [rows_of(outcome) for outcome in self._exact]
        self._plain = {m: self._run([Job(m, short=True)])[0] for m in sorted(set(self.motion))}
        self.curves = Curves(self.placed, self._plain, self._run)
        nothing: tuple[Settings, Floats] = ((), np.zeros(len(self.nuisances)))
        self._centred_on = [nothing] * len(self.features)
        say("replaying from slightly other starts")
        self.spread = of_starts(self._plain, self._run)
        say("replaying with what is never exactly as believed")
        self._weighing = Weighing(some, self.features, self._run)
        self.traces = self._traces((), ())
        self._chance = of_tolerances(self, judging, self._run)  #: of each recording
        for m, chance in zip(self.motion, self._chance, strict=True):
            if self.features[m].phase is None:
                self.spread[m][RobotKind.JOINTS] = chance.total
        self._data = [f.recorded for f in self.features]
        self._face(self._every)
        self._extra = [self._variance(r) for r in self._every]

    def _face(self, which: Iterable[int]) -> None:
        """Take recorded leans for those of the robot that exact replays of some come nearest to."""
        every = {r: f.lean_rad for r, f in enumerate(self.features) if len(f.lean_rad)}
        some = [r for r in which if r in every]
        if some:
            told = [self.centre[r][RobotKind.LEAN] for r in some]
            turn = nearest([every[r] for r in some], told)
            for r, rows in every.items():
                self._data[r][RobotKind.LEAN] = turned(rows, turn)

    @property
    def _every(self) -> range:
        return range(len(self.features))

    def _run(self, jobs: Sequence[Job]) -> list[Rows]:
        """Rows of jobs; means of some replays where legs rattle, as when they do is chance."""
        starts = [range(RATTLES) if _rattles(job) else (job.jitter,) for job in jobs]
        every = [replace(job, jitter=j) for job, own in zip(jobs, starts, strict=True) for j in own]
        found = (rows_of(outcome) for outcome in self.replays.run(every))
        return [_mean([next(found) for _ in own]) for own in starts]

    def _variance(self, r: int) -> Rows:
        """What each row scatters by itself: turns of the gait, starts, counts of what stands."""
        (outcome,) = self.replays.run([Job(r)])
        spread, features = self.spread[self.motion[r]], self.features[r]
        own = outcome.scatter_rad2 + features.rounding_rad2 + spread[RobotKind.JOINTS]
        own -= self._chance[r].lasting
        alike = with_loads(self.features, self._repeated, r)  # each of which shows the same counts
        return spread | {RobotKind.JOINTS: own, RobotKind.DUTY: alike * features.regulated.extra}

    def retrace(self, settings: Sequence[tuple[str, float]], z: Floats) -> None:
        """Take what nuisances and knobs do from replays around them where a fit has led.

        The same small things move a robot otherwise that is changed much. Play is left out: when
        teeth rattle is chance, and beside small things one would see that.
        """
        self.traces = self._traces(*self.bend(settings, z))

    def bend(self, settings: Sequence[tuple[str, float]], z: Floats) -> Told:
        """Take what knobs do from replays around them, and nuisances as they are known.

        Returns what these replays were told: settings without play, and nuisances.
        """
        told = self.told([(name, x) for name, x in settings if not is_play(name)], z)
        self.curves.bend(*told, sorted(set(self.like)))
        return told

    def _traces(self, settings: Settings, at: tuple[float, ...]) -> list[Rows]:
        """By recording and kind: rows x nuisances, each for one deviation of its prior."""
        traces = {}
        for m in sorted(set(self.like)):
            known = self._weighing.known(m, settings, at)
            columns = [self._trace(m, nuisance, known) for nuisance in self.nuisances]
            traces[m] = {kind: np.stack([c[kind] for c in columns], axis=1) for kind in columns[0]}
        return [self._read(self._of(r, traces[m]), r) for r, m in enumerate(self.like)]

    def _rows_in(self, m: int, r: int) -> Mapping[RobotKind, Ints]:
        rows = self.features[m].rows_of(self.features[r])
        assert rows is not None
        return rows

    def _of(self, r: int, rows: Rows) -> Rows:
        """A recording's own rows of those of the motion that is taken for it."""
        return {kind: rows[kind][own] for kind, own in self._own[r].items()}

    def trace_at(self, name: str, z: float, r: int) -> Rows:
        """What an effect does to a recording at a value of its knob, for one unit of it."""
        return self._of(r, self.curves.trace_at(name, z, self.like[r]))

    def _read(self, traces: Rows, r: int) -> Rows:
        """Traces with what a later instant and a later turn do to a recording's own centre."""
        outcome, own = self._exact[r], traces | {RobotKind.JOINTS: traces[RobotKind.JOINTS].copy()}
        for k, nuisance in enumerate(self.nuisances):
            rows = {"sampling": outcome.speed_rad_s, "turn": outcome.turn_rad}.get(nuisance.name)
            if rows is not None:
                own[RobotKind.JOINTS][:, k] = nuisance.deviation * np.nan_to_num(rows)
        return own

    def _trace(self, m: int, nuisance: RobotNuisance, shown: Shown) -> Rows:
        features = self.features[m]
        own = np.ones(len(features.bin), bool)
        if nuisance.joint:
            own = features.joint_row == self._joints.index(nuisance.joint)
        if nuisance.trial:
            rows = shown[nuisance.trial]
        else:
            rows = {kind: np.zeros_like(base) for kind, base in self._plain[m].items()}
            rows[RobotKind.JOINTS] = np.ones(len(features.bin))
        if nuisance.joint:
            zero = {kind: np.zeros_like(values) for kind, values in rows.items()}
            rows = zero | {RobotKind.JOINTS: np.where(own, rows[RobotKind.JOINTS], 0.0)}
        # what tolerances make joints shake is in what engines differ by
        still = {RobotKind.SHAKING: np.zeros_like(rows[RobotKind.SHAKING])}
        return {kind: values * nuisance.deviation for kind, values in rows.items()} | still

    def floors(self, least_rad: float = ENGINES_RAD) -> Mapping[RobotKind, float]:
        """The least white deviation: rounding, averaged over a row, and what engines differ by."""
        count = float(np.median(np.concatenate([f.count for f in self.features])))
        rounding = self.quantum_rad / np.sqrt(12.0 * count)
        floors = {
            RobotKind.JOINTS: float(np.hypot(rounding, least_rad)),
            RobotKind.SHAKING: ENGINES_SHAKING,
        }
        if any(len(f.height_m) for f in self.features):
            floors[RobotKind.HEIGHT] = HEIGHT_FLOOR_M
        if any(len(f.lean_rad) for f in self.features):
            floors[RobotKind.LEAN] = LEAN_FLOOR_RAD
        if any(len(f.voltage_v) for f in self.features):
            floors[RobotKind.VOLTAGE] = VOLTAGE_FLOOR_V
        if any(np.isfinite(f.regulated.recorded).any() for f in self.features):
            floors[RobotKind.DUTY] = DUTY_FLOOR
        return floors

    def modelled(self, settings: Sequence[tuple[str, float]], z: Floats, r: int) -> Rows:
        """Rows of a recording under effects and nuisances."""
        m = self.like[r]
        middle, centre = self._centred_on[r]
        now, then = (self._of(r, self.curves.effects(m, s)) for s in (settings, middle))
        away = z - centre
        return {
            kind: rows + now[kind] - then[kind] + self.traces[r][kind] @ away
            for kind, rows in self.centre[r].items()
        }

    def recentre(
        self,
        settings: Sequence[tuple[str, float]],
        z: Floats,
        which: Sequence[int] | None = None,
    ) -> float:
        """Replay some recordings (all) exactly there, and take that for the middle of the curves.

        ``z`` are the nuisances. Returns how far the curves were off, RMS over joint rows [rad].
        """
        at = replayable(self.nuisances, z)
        first = self._leaders(self._every if which is None else which)
        leaders = sorted(set(first.values()))
        guessed = [self.modelled(settings, at, r)[RobotKind.JOINTS] for r in leaders]
        told = self.told(settings, z)
        found = self._run([Job(r, told[0], nuisances=told[1]) for r in leaders])
        if not all(np.isfinite(rows[RobotKind.JOINTS]).all() for rows in found):
            return float("inf")
        apart = [rows[RobotKind.JOINTS] - guess for rows, guess in zip(found, guessed, strict=True)]
        there = dict(zip(leaders, found, strict=True))
        before = {r: self.centre[r] for r in leaders}
        for r, leader in first.items():
            own = self.centre[r]
            self.centre[r] = (
                there[r]
                if r == leader
                else {
                    k: own[k] + np.nan_to_num(rows - before[leader][k])  # 0 where that has no row
                    for k, rows in there[leader].items()
                }
            )
            self._centred_on[r] = told[0], at
            (self._exact[r],) = self.replays.run([Job(leader, told[0], nuisances=told[1])])
            self.traces[r] = self._read(self.traces[r], r)
        self._face(first)
        return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))

    def ahead(
        self,
        robots: Iterable[tuple[Sequence[tuple[str, float]], Floats]],
        which: Sequence[int],
    ) -> None:
        """Replay robots side by side at which :meth:`recentre` will look one after another.

        Only where one of them would leave processes without work.
        """
        leaders = sorted(set(self._leaders(which).values()))
        if len(leaders) % self.replays.processes:
            told = [self.told(settings, z) for settings, z in robots]
            self._run([Job(r, effects, nuisances=z) for effects, z in told for r in leaders])

    def told(self, settings: Sequence[tuple[str, float]], z: Floats) -> Told:
        """Effects and nuisances of a replay, as a job has them."""
        at = replayable(self.nuisances, z)
        return tuple(settings), tuple(at.tolist()) if at.any() else ()

    @contextmanager
    def following(self) -> Iterator[None]:
        """Meanwhile one recording of each motion is replayed; its repeats move as it does."""
        self._following = True
        try:
            yield
        finally:
            self._following = False

    def _leaders(self, chosen: Iterable[int]) -> dict[int, int]:
        """For some recordings those that are replayed for them: themselves, mostly."""
        if not self._following:
            return {r: r for r in chosen}
        leaders: dict[int, int] = {}
        return {r: leaders.setdefault(self._repeated[r], r) for r in chosen}

    def residuals(self, names: Sequence[str], z: Floats, which: Sequence[int]) -> RobotBlocks:
        """Residual blocks (recorded less modelled) of some recordings for a vector."""
        count = len(self.nuisances)
        settings = tuple(zip(names, z[count:].tolist(), strict=True))
        blocks: RobotBlocks = {}
        for r in which:
            for kind, rows in self.modelled(settings, z[:count], r).items():
                blocks[r, kind] = self.block(r, kind, self._data[r][kind] - rows)
        return blocks

    def pressed(self, r: int) -> Floats:
        """Share of each row's samples at which the leg's foot pressed, in the last exact replay."""
        return self._exact[r].pressed

    def chance(self, r: int) -> Floats:
        """What of joint rows no trace foretells of sound robots that stand (rows,) [rad^2]."""
        return self._chance[r].total

    def recorded(self, r: int, kind: RobotKind) -> Floats:
        """Rows of a recording as it was; NaN where nobody saw."""
        return self._data[r][kind]

    def block(self, r: int, kind: RobotKind, value: Floats) -> Block:
        """Rows of a recording, as many as it has, as a block; those nobody saw are left out."""
        features = self.features[r]
        bins = {RobotKind.HEIGHT: features.height_bins, RobotKind.VOLTAGE: features.voltage_bins}
        if kind is RobotKind.JOINTS:
            times = features.t_s
        elif kind is RobotKind.LEAN and features.lean_bins is not None:
            times = np.concatenate([k * APART_S + features.lean_bins.t_s for k in range(AXES)])
        elif (own := bins.get(kind)) is not None:
            times = own.t_s
        else:
            times = APART_S * np.arange(len(value), dtype=np.float64)
        known = np.isfinite(self._data[r][kind])
        sways = None
        if kind is RobotKind.JOINTS and self._chance[r].lasting.any():
            repeats = self.motion.count(self.motion[r])
            sways = self._chance[r].sways(features.joint_row, len(self._joints), repeats)[known]
        return Block(times[known], value[known], self._extra[r][kind][known], sways)

    def close(self) -> None:
        """End the processes."""
        self.replays.close()

    def __enter__(self) -> RobotModel:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def undocumented_punch(robot: Robot, courses: Sequence[Course]) -> bool:
    """Whether servos are told a punch of which nobody says that their position law adds it."""
    laws = {str(table.drive.get("law")) for table in robot.tables.values()}
    return laws == {UNDOCUMENTED} and any(has_punch(c.start, *c.events.T[2:]) for c in courses)
