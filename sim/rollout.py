"""One joint, many what-ifs: batches of compiled rollouts along recorded commands.

A *replay* is what happened at the port of one servo: commands with their times, and the instants at
which its registers were sampled. A *candidate* is what the servo and its load may be. Every pair of
them is a job of a :func:`sim.drive.lockstep.rollout_of`. Jobs that are alike are rolled out in
groups, in lockstep; groups are shared over threads.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .drive import fields, lanes, lockstep, regulating
from .drive.fields import Array
from .drive.lanes import Jobs
from .robot import PhysicalRobot
from .stepped import TICK_S

RIGID_SUBSTEPS = 5  #: of a tick, with rotor and load in one
GEAR_SUBSTEPS = 10  #: of a tick, with a gear between them
TURNS = 40  #: of the fixed point of a sensor's wave: each takes off amplitude x periods of the rest


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Commands and sample instants of one servo [s since the replay began]; servo frame.

    ``events`` (n, 3): time, field of :mod:`sim.drive.fields` (commands, or from
    ``lanes.SUPPLY_EVENT`` on supplies), value; ``samples`` (m,), both ascending. ``start`` is the
    column of commands at the beginning, ``position_rad`` and ``velocity_rad_s`` those of the output
    shaft. ``held_rad`` is a goal that was in force before; without one the position law begins with
    the replay, and a goal whose speed is limited starts where the joint is. ``rests``: the gear
    carries the load from the beginning; else it is not twisted then. ``path`` (ticks, 2) is what
    the servo showed at every tick of the drive, angle and speed, where a load on a leash is led.
    """

    start: Array
    events: Array
    samples: Array
    position_rad: float
    velocity_rad_s: float = 0.0
    held_rad: float | None = None
    rests: bool = False
    path: Array | None = None

    @property
    def end_s(self) -> float:
        """The last instant that matters [s]."""
        return float(self.samples[-1]) if len(self.samples) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """What hangs on a joint, servo frame: torque of gravity ``cosine cos q - sine sin q`` [N m].

    ``sine`` and ``cosine`` are of shape (n,), spread evenly over the replay; (1,) is constant.
    """

    inertia_kg_m2: float
    sine_nm: Array
    cosine_nm: Array
    moment_nm: float = 0.0  #: weight times lever: torque of gravity if the axis lay level

    @classmethod
    def pendulum(
        cls, inertia_kg_m2: float, gravity_nm: float, centre_rad: float, moment_nm: float
    ) -> Load:
        """Torque ``-gravity_nm sin(q - centre_rad)``: it hangs at ``centre_rad``."""
        sine = np.array([gravity_nm * np.cos(centre_rad)])
        cosine = np.array([gravity_nm * np.sin(centre_rad)])
        return cls(inertia_kg_m2, sine, cosine, moment_nm)

    def plus(self, other: Load, share: float) -> Load:
        """The load with a share of another added to it."""
        return Load(
            self.inertia_kg_m2 + share * other.inertia_kg_m2,
            self.sine_nm + share * other.sine_nm,
            self.cosine_nm + share * other.cosine_nm,
            self.moment_nm + share * other.moment_nm,
        )

    def tilted(self, along_rad: float, across_rad: float) -> Load:
        """The load on a stand that leans a little, about the joint's axis and across it.

        Across matters to first order only as far as the axis stands upright.
        """
        reach = abs(self.moment_nm)  # a tolerance may take more of a light load than there is
        pull = min(reach, math.hypot(float(self.sine_nm[0]), float(self.cosine_nm[0])))
        upright = math.sqrt(1.0 - (pull / reach) ** 2) if reach > 0.0 else 0.0
        return replace(
            self,
            cosine_nm=self.cosine_nm + self.moment_nm * along_rad,
            sine_nm=self.sine_nm + self.moment_nm * upright * across_rad,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A servo (column of :mod:`sim.drive.fields` parameters), its supply, its load, its reading."""

    drive: Array
    load: Load
    voltage_v: float
    source_ohm: float
    skew_s: float = 0.0  #: the position shown is of an instant this much later
    late_s: float = 0.0  #: so is all that is read; nothing but positions moves so fast
    load_refresh_s: float = 0.0
    load_phase_s: float = 0.0
    start_offset_rad: float = 0.0  #: of the shaft's first angle, over the replay's
    payload: Load | None = None  #: the part of the load that is a weight put on

    @classmethod
    def of(cls, robot: PhysicalRobot, joint: int, load: Load, *, rigid: bool) -> Candidate:
        """The servo of one joint (by its number). ``rigid`` makes rotor and load one mass."""
        drive = robot.joints[joint].drive.column()
        if rigid:
            drive[fields.GEAR_STIFFNESS] = np.inf
        return cls(
            drive,
            load,
            robot.supply.voltage_v,
            robot.supply.resistance_ohm,
            skew_s=robot.reading.skew_s,
            load_refresh_s=robot.reading.load_refresh_s,
        )


SOFT, FALLING, RAISED = 1, 2, 4  #: kinds of jobs: of their gears, and of how friction falls
ROLLOUTS = {
    kind: lockstep.rollout_of(
        rigid=not kind & SOFT, slow=bool(kind & FALLING), raised=bool(kind & RAISED)
    )
    for kind in (0, SOFT, FALLING, SOFT | FALLING, FALLING | RAISED, SOFT | FALLING | RAISED)
}


def _kinds(params: Array) -> NDArray[np.int64]:
    """What kinds jobs are of (jobs,), from their drives (jobs, fields)."""
    soft = np.isfinite(params[:, fields.GEAR_STIFFNESS])
    falling = (params[:, fields.FALLING] != 0.0).any(axis=1)
    raised = falling & (params[:, fields.STRIBECK_EXPONENT] != 1.0)
    kinds: NDArray[np.int64] = SOFT * soft + FALLING * falling + RAISED * raised
    return kinds


class Batch:
    """Replays that are run again and again with other candidates, on ``threads`` (all, if None)."""

    def __init__(self, replays: Sequence[Replay], threads: int | None = None) -> None:
        self.replays = tuple(replays)
        self._threads = threads or len(os.sched_getaffinity(0))
        self._events = np.concatenate([r.events.reshape(-1, 3) for r in replays])
        self._event_range = _ranges([len(r.events) for r in replays])
        self._samples = np.concatenate([r.samples for r in replays])
        self._sample_range = _ranges([len(r.samples) for r in replays])
        self._end_s = np.array([r.end_s for r in replays])
        paths = [np.zeros((0, 2)) if r.path is None else r.path for r in replays]
        self._path = np.concatenate(paths)
        self._path_range = _ranges([len(path) for path in paths])

    def run(
        self, candidates: Sequence[Candidate], replays: Sequence[int], leash_rad_s: float = 0.0
    ) -> list[Array]:
        """Run candidate ``k`` on replay ``replays[k]``; a (samples, CHANNELS) array for each.

        On a leash every load is led along its replay's path, by a spring and a critical damper that
        alone would bring it there at ``leash_rad_s``.
        """
        groups, jobs = self._jobs(candidates, replays, leash_rad_s)
        longest = max(len(self.replays[r].samples) for r in replays)
        out = np.full((len(candidates), longest, lanes.CHANNELS), np.nan)
        self._share(groups, jobs, out)
        return [out[j, : len(self.replays[r].samples)] for j, r in enumerate(replays)]

    def regulate(
        self, candidates: Sequence[Candidate], replays: Sequence[int], sensed_rad: Sequence[Array]
    ) -> list[Array]:
        """Duty of the controllers alone, along angles that were read: (samples,) for each.

        ``sensed_rad`` is what each replay's servo showed at the replay's samples. It is the
        controller's own sensor, so zero and linearity of the sensor play no part.
        """
        groups, jobs = self._jobs(candidates, replays)
        longest = max(len(self.replays[r].samples) for r in replays)
        out = np.full((len(candidates), longest), np.nan)
        sensed = np.zeros_like(out)
        for j, angles in enumerate(sensed_rad):
            sensed[j, : len(angles)] = angles
        skews = np.array([c.skew_s for c in candidates])
        given = groups, skews, jobs, sensed, TICK_S
        if self._threads == 1:  # here: no thread outlives a fork
            regulating.regulate(*given, 0, len(jobs.number), out)
        else:
            parts = self._parts(len(jobs.number))
            pool = _pool(self._threads)
            tasks = [pool.submit(regulating.regulate, *given, *part, out) for part in parts]
            for task in tasks:
                task.result()
        return [out[j, : len(self.replays[r].samples)] for j, r in enumerate(replays)]

    def _jobs(
        self, candidates: Sequence[Candidate], replays: Sequence[int], leash_rad_s: float = 0.0
    ) -> tuple[Array, Jobs]:
        rows = np.zeros((len(candidates), lanes.ROWS))
        supplies, loads = rows[:, lanes.OF_SUPPLIES :], rows[:, lanes.OF_LOADS :]
        for j, (c, r) in enumerate(zip(candidates, replays, strict=True)):
            replay = self.replays[r]
            rows[j, : fields.PARAMS] = c.drive
            rows[j, lanes.OF_COMMANDS : lanes.OF_SUPPLIES] = replay.start
            supplies[j, fields.SUPPLY_VOLTAGE] = c.voltage_v
            supplies[j, fields.SUPPLY_RESISTANCE] = c.source_ohm
            loads[j, lanes.LOAD_INERTIA] = c.load.inertia_kg_m2
            shown = replay.position_rad + c.start_offset_rad
            loads[j, lanes.SHAFT_POSITION] = shaft_at(c.drive, shown)
            if replay.held_rad is not None:
                _hold(rows[j], replay.held_rad, shown)
            loads[j, lanes.SHAFT_VELOCITY] = replay.velocity_rad_s
            if replay.rests:
                loads[j, lanes.TWIST] = _hanging(c, loads[j, lanes.SHAFT_POSITION])
            loads[j, lanes.SAMPLE_SKEW] = c.skew_s + c.late_s
            loads[j, lanes.DUTY_REFRESH] = c.load_refresh_s
            loads[j, lanes.DUTY_PHASE] = c.load_phase_s
            if leash_rad_s > 0.0 and replay.path is not None:
                inertia = c.load.inertia_kg_m2 + float(c.drive[fields.ROTOR_INERTIA])
                loads[j, lanes.LEASH] = inertia * leash_rad_s**2
                loads[j, lanes.LEASH_DAMPING] = 2.0 * inertia * leash_rad_s
        number = self._groups(rows[:, : fields.PARAMS], self._end_s[np.asarray(replays)])
        gravity = [np.stack([c.load.cosine_nm, c.load.sine_nm], axis=1) for c in candidates]
        jobs = Jobs(
            number,
            np.asarray(replays, np.int64),
            self._events,
            self._event_range,
            self._samples,
            self._sample_range,
            np.concatenate(gravity),
            _ranges([len(c.load.sine_nm) for c in candidates]),
            self._end_s,
            self._path,
            self._path_range,
        )
        return np.ascontiguousarray(rows[number].swapaxes(1, 2)), jobs

    def _groups(self, params: Array, end_s: Array) -> lanes.Integers:
        """Jobs that are rolled out together, the longest first: (groups, LANES), -1 is none."""
        kind = 2 * _kinds(params) + (params[:, fields.BACKLASH] != 0.0)
        order = np.lexsort((-end_s, kind))
        groups = [
            alike[k : k + lockstep.LANES]
            for alike in np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)
            for k in range(0, len(alike), lockstep.LANES)
        ]
        number = np.full((len(groups), lockstep.LANES), -1)
        for row, group in zip(number, groups, strict=True):
            row[: len(group)] = group
        return number

    def _share(self, groups: Array, jobs: Jobs, out: Array) -> None:
        kinds = _kinds(groups[:, : fields.PARAMS, 0])
        tasks = [
            _pool(self._threads).submit(
                ROLLOUTS[kinds[first]],
                groups,
                jobs,
                TICK_S,
                GEAR_SUBSTEPS if kinds[first] & SOFT else RIGID_SUBSTEPS,
                first,
                last,
                np.empty((lanes.PLACES, lockstep.LANES), np.int64),
                out,
            )
            for first, last in self._alike(kinds)
        ]
        for task in tasks:
            task.result()

    def _alike(self, kinds: NDArray[np.int64]) -> list[tuple[int, int]]:
        """Parts of groups of one kind."""
        edges = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]
        return [
            (first + begin, last + begin)
            for begin, end in itertools.pairwise(edges)
            for first, last in self._parts(end - begin)
        ]

    def _parts(self, count: int) -> list[tuple[int, int]]:
        """Groups dealt to the threads, a few parts each."""
        parts = max(1, min(count, 2 * self._threads))
        ends = [count * k // parts for k in range(parts + 1)]
        return list(itertools.pairwise(ends))


def _hanging(candidate: Candidate, shaft_rad: float) -> float:
    """How far the rotor leads the shaft of a joint at rest [rad]: its load hangs on the gear.

    Near where it hangs by itself, nearer than the play is wide, the load may be between the flanks.
    """
    drive, load = candidate.drive, candidate.load
    pull = load.cosine_nm[0] * math.cos(shaft_rad) - load.sine_nm[0] * math.sin(shaft_rad)
    pull += drive[fields.CABLE_STIFFNESS] * (drive[fields.CABLE_REST] - shaft_rad)
    half = 0.5 * float(drive[fields.BACKLASH])
    swing = load.moment_nm * half  # what gravity changes by over the play
    part = min(1.0, max(-1.0, float(pull) / swing)) if swing > 0.0 else 0.0
    return -part * half - float(pull) / float(drive[fields.GEAR_STIFFNESS])


def _hold(row: Array, goal_rad: float, shown_rad: float) -> None:
    """Have a job's position law be at a goal when it begins, where the servo shows an angle."""
    states = row[lanes.OF_STATES : lanes.OF_COMMANDS]
    row[lanes.OF_COMMANDS + fields.GOAL_POSITION] = states[fields.RAMP] = goal_rad
    step = float(row[fields.SENSOR_STEP])
    last = math.floor(shown_rad / step + 0.5) * step if step > 0.0 else shown_rad
    states[fields.LAST_POSITION], states[fields.WAS_REGULATING] = last, 1.0


def shaft_at(drive: Array, shown_rad: float) -> float:
    """The shaft's angle at which a servo shows an angle, both [rad]: :func:`firmware.sense` undone.

    ``drive`` is the column of its parameters. A wave as steep as the turn itself shows some angles
    more than once; then the shaft is only near one of them.
    """
    plain = shown_rad - float(drive[fields.ZERO_OFFSET])
    shaft = plain
    wave, periods, phase = drive[[fields.WAVE, fields.WAVE_PERIODS, fields.WAVE_PHASE]].tolist()
    for _ in range(TURNS if wave else 0):
        shaft = plain - wave * math.sin(periods * shaft + phase)
    return shaft


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "rollout")


def _ranges(lengths: Sequence[int]) -> lanes.Integers:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
