"""The port of a lane: what it is told until a tick begins, and what it shows of the tick. Compiled.

Commands and supplies come as events; goals hold late, by the drive's delay. Samples are put down as
they are passed, their angles apart from the rest, as those may be of another instant.
"""

from __future__ import annotations

import math

from ..compiling import inlined
from .fields import CURRENT, DELAY, ENABLED, GOALS, HEAT, VOLTAGE, WINDING_HEAT, Array, Arrays
from .firmware import sense
from .lanes import (
    DUTY_SHOWN,
    EVENT,
    GOAL_EVENT,
    NEXT_EVENT,
    NEXT_SAMPLE,
    NEXT_SEEN,
    OUT_CURRENT,
    OUT_DUTY,
    OUT_HEAT,
    OUT_POSITION,
    OUT_VELOCITY,
    OUT_VOLTAGE,
    SAMPLE,
    SAMPLE_SKEW,
    SEEN,
    SHAFT_POSITION,
    SHAFT_VELOCITY,
    SUPPLY_EVENT,
    TICK_SENSED,
    TICK_VELOCITY,
    Integers,
    Jobs,
)


@inlined
def hear(
    arrays: Arrays, jobs: Jobs, job: int, k: int, now: float, lanes: Array, at: Integers
) -> None:
    """Let what a lane was told until now hold."""
    recording = jobs.recording[job]
    first, last = at[EVENT, k], jobs.event_range[recording + 1]
    delay = arrays.params[DELAY, k]
    at[EVENT, k], at[GOAL_EVENT, k] = heard(
        arrays, jobs.events, k, now, delay, first, at[GOAL_EVENT, k], last
    )
    lanes[NEXT_EVENT, k] = math.inf
    if at[EVENT, k] < last:
        lanes[NEXT_EVENT, k] = jobs.events[at[EVENT, k], 0]
    if at[GOAL_EVENT, k] < last:
        due = jobs.events[at[GOAL_EVENT, k], 0] + delay
        lanes[NEXT_EVENT, k] = min(lanes[NEXT_EVENT, k], due)


@inlined
def heard(
    arrays: Arrays,
    events: Array,
    k: int,
    now: float,
    delay: float,
    event: int,
    goal: int,
    last: int,
) -> tuple[int, int]:
    """Let events of a lane hold, goals late by its delay; the numbers of those that come next.

    A drive that is switched on knows its goal at once.
    """
    known = -math.inf  # goals up to here hold, however late
    while event < last and events[event, 0] <= now:
        field = int(events[event, 1])
        if field >= SUPPLY_EVENT:
            arrays.supplies[field - SUPPLY_EVENT, k] = events[event, 2]
        elif field not in GOALS:
            arrays.commands[field, k] = events[event, 2]
            if field == ENABLED and events[event, 2] > 0.0:
                known = events[event, 0]
        event += 1
    while goal < last and (events[goal, 0] + delay <= now or events[goal, 0] <= known):
        field = int(events[goal, 1])
        if field in GOALS:
            arrays.commands[field, k] = events[goal, 2]
        goal += 1
    while event < last and int(events[event, 1]) in GOALS:
        event += 1
    while goal < last and int(events[goal, 1]) not in GOALS:
        goal += 1
    return event, goal


@inlined
def show(
    arrays: Arrays,
    loads: Array,
    jobs: Jobs,
    job: int,
    k: int,
    now: float,
    tick_s: float,
    lanes: Array,
    at: Integers,
    out: Array,
) -> None:
    """Put down the samples of a lane that are taken within a tick."""
    states = arrays.states
    recording = jobs.recording[job]
    first, last = jobs.sample_range[recording], jobs.sample_range[recording + 1]
    seen, skew = at[SEEN, k], loads[SAMPLE_SKEW, k]
    before, before_pace = lanes[TICK_SENSED, k], lanes[TICK_VELOCITY, k]
    after, pace = sense(arrays.params, k, loads[SHAFT_POSITION, k]), loads[SHAFT_VELOCITY, k]
    while seen < last and jobs.samples[seen] + skew <= now + tick_s:
        part = max(0.0, (jobs.samples[seen] + skew - now) / tick_s)
        row = out[job, seen - first]
        row[OUT_POSITION] = before + part * (after - before)
        row[OUT_VELOCITY] = before_pace + part * (pace - before_pace)
        seen += 1
    sample = at[SAMPLE, k]
    while sample < last and jobs.samples[sample] <= now + tick_s:
        row = out[job, sample - first]
        row[OUT_DUTY] = lanes[DUTY_SHOWN, k]
        row[OUT_VOLTAGE] = states[VOLTAGE, k]
        row[OUT_CURRENT] = states[CURRENT, k]
        row[OUT_HEAT] = states[HEAT, k] + states[WINDING_HEAT, k]
        sample += 1
    at[SEEN, k], at[SAMPLE, k] = seen, sample
    lanes[NEXT_SEEN, k] = jobs.samples[seen] + skew if seen < last else math.inf
    lanes[NEXT_SAMPLE, k] = jobs.samples[sample] if sample < last else math.inf
