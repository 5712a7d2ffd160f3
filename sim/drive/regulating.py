"""What controllers make of angles that a servo showed: the duty alone. Compiled.

The jobs are those of rollouts (:mod:`sim.drive.lanes`), and so are commands and firmware; nothing
turns here, as motor and load play no part. So a controller is judged by itself, whatever else of a
servo is not as it is believed. Jobs go one after the other.
"""

from __future__ import annotations

from ..compiling import compiled
from .fields import DELAY, DUTY, Array, Arrays
from .firmware import control_one, hurry
from .lanes import Jobs, drives
from .lockstep import LANES
from .port import heard


@compiled
def regulate(
    groups: Array,
    skew: Array,
    jobs: Jobs,
    sensed: Array,
    tick_s: float,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Duty of some groups' controllers along given angles, into ``out`` (jobs, samples).

    ``sensed`` (jobs, samples) is what the servo showed at the job's samples, and sensed ``skew``
    (jobs) [s] after them; between those instants the shaft is taken to move evenly. What the motor
    makes of the duty plays no part.
    """
    for g in range(first, last):
        arrays = drives(groups[g])
        for k in range(LANES):
            job = jobs.number[g, k]
            if job >= 0:
                regulate_one(arrays, k, skew[job], jobs, sensed, tick_s, job, out)


@compiled
def regulate_one(
    arrays: Arrays,
    k: int,
    skew: float,
    jobs: Jobs,
    sensed: Array,
    tick_s: float,
    job: int,
    out: Array,
) -> None:
    """One job of :func:`regulate`."""
    recording = jobs.recording[job]
    event, last_event = jobs.event_range[recording], jobs.event_range[recording + 1]
    goal, delay = event, arrays.params[DELAY, k]
    first, last = jobs.sample_range[recording], jobs.sample_range[recording + 1]
    sample, seen, tick = first, first, 0
    while sample < last:
        now = tick * tick_s
        event, goal = heard(arrays, jobs.events, k, now, delay, event, goal, last_event)
        angle, pace = sensed[job, seen - first], 0.0
        if seen > first:
            span = max(jobs.samples[seen] - jobs.samples[seen - 1], 1e-6)
            pace = (angle - sensed[job, seen - 1 - first]) / span
            angle -= pace * (jobs.samples[seen] + skew - now)
        hurry(arrays, k, angle, pace, tick_s)
        control_one(arrays, k, angle, pace, tick_s)
        tick += 1
        while seen < last - 1 and jobs.samples[seen] + skew <= tick * tick_s:
            seen += 1
        while sample < last and jobs.samples[sample] <= tick * tick_s:
            out[job, sample - first] = arrays.states[DUTY, k]
            sample += 1
