"""Many drives with a load each, rolled out in lockstep along recorded commands. Compiled.

The load of a job (:mod:`sim.drive.lanes`) is moved here in the same substeps as the rotor. Jobs go
in groups, in lockstep: the compiler makes one vector of the same number of several jobs.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ..compiling import compiled, inlined
from .elementary import sine_cosine
from .fields import (
    BACKLASH,
    CURRENT,
    DUTY,
    GEAR_STIFFNESS,
    ROTOR_INERTIA,
    ROTOR_POSITION,
    ROTOR_VELOCITY,
    Array,
)
from .firmware import control_one, hurry, sense
from .kernel import bridge, share_supply, warm, winding_resistance
from .lanes import (
    CONDUCTANCE,
    COSINE,
    CURRENT_SUM,
    DUTY_DUE,
    DUTY_PHASE,
    DUTY_REFRESH,
    DUTY_SHOWN,
    EVENT,
    FASTER,
    GOAL_EVENT,
    GRAVITIES,
    HALT,
    LEASH,
    LOAD_HALT,
    LOAD_INERTIA,
    LOAD_PUSH,
    NEXT_EVENT,
    NEXT_SAMPLE,
    NEXT_SEEN,
    OF_LANES,
    OF_LOADS,
    PUSH,
    ROWS,
    SAMPLE,
    SAMPLE_SKEW,
    SEEN,
    SHAFT_POSITION,
    SHAFT_VELOCITY,
    SINE,
    SQUARE_SUM,
    TICK_COSINE,
    TICK_SENSED,
    TICK_SINE,
    TICK_VELOCITY,
    TICKS,
    TWIST,
    VOLTS,
    Integers,
    Jobs,
    drives,
)
from .port import hear, show
from .turning import hang, lead, turn, weigh

LANES = 16  #: in a group; two vectors of eight hide each other's latency
FEW = 4  #: jobs that are done one after the other rather than as a whole group

Rollout = Callable[[Array, Jobs, float, int, int, int, Integers, Array], None]


@inlined
def rollout(
    groups: Array,
    jobs: Jobs,
    tick_s: float,
    substeps: int,
    first: int,
    last: int,
    at: Integers,
    out: Array,
    rigid: bool,
    slow: bool,
    raised: bool,
) -> None:
    """Run the groups ``first`` to ``last - 1``, each job from its start, into ``out[job, sample]``.

    ``groups`` (groups, ROWS, LANES): a lane is a job with a supply of its own. The rotor's inertia
    and a rigid gear (infinite stiffness) make one mass with the load. The gears are all rigid or
    none is; so it is with friction that falls with velocity (``slow``), and
    with whether that is ``raised`` to another power than 1. ``at`` (PLACES, LANES) is
    written on. What a job gives depends on the job alone.
    """
    for g in range(first, last):
        live = begin(groups[g], jobs, jobs.number[g], tick_s, substeps, at)
        roll(groups[g], jobs, jobs.number[g], live, tick_s, substeps, at, out, rigid, slow, raised)


@inlined
def begin(
    group: Array, jobs: Jobs, number: Integers, tick_s: float, substeps: int, at: Integers
) -> int:
    """Put the lanes of one group at their jobs' beginnings; how many have a job."""
    params, states = drives(group).params, drives(group).states
    loads, lanes = group[OF_LOADS:OF_LANES], group[OF_LANES:]
    dt = tick_s / substeps
    live = 0
    for k in range(LANES):
        job = number[k]
        if job < 0:
            break
        live += 1
        recording = jobs.recording[job]
        end, skew = jobs.end_s[recording], loads[SAMPLE_SKEW, k]
        at[TICKS, k] = math.ceil((end + max(0.0, skew)) / tick_s) + 1
        at[EVENT, k] = at[GOAL_EVENT, k] = jobs.event_range[recording]
        at[SEEN, k] = at[SAMPLE, k] = jobs.sample_range[recording]
        lanes[NEXT_EVENT, k] = lanes[NEXT_SEEN, k] = lanes[NEXT_SAMPLE, k] = -math.inf
        lanes[DUTY_DUE, k], lanes[DUTY_SHOWN, k] = loads[DUTY_PHASE, k], 0.0
        low = jobs.gravity_range[job]
        at[GRAVITIES, k] = jobs.gravity_range[job + 1] - low if end > 0.0 else 1
        lanes[COSINE, k], lanes[SINE, k] = jobs.gravity[low, 0], jobs.gravity[low, 1]
        states[ROTOR_POSITION, k] = loads[SHAFT_POSITION, k] + loads[TWIST, k]
        states[ROTOR_VELOCITY, k] = loads[SHAFT_VELOCITY, k]
        inertia, load_inertia = params[ROTOR_INERTIA, k], loads[LOAD_INERTIA, k]
        if rigid_gear(params, k):
            inertia += load_inertia
        lanes[HALT, k], lanes[PUSH, k] = inertia / dt, dt / inertia  # as in drive()
        lanes[FASTER, k] = 0.0
        lanes[LOAD_HALT, k], lanes[LOAD_PUSH, k] = load_inertia / dt, dt / load_inertia
    return live


@inlined
def rigid_gear(params: Array, i: int) -> bool:
    """Whether a rotor and its load are one mass."""
    return bool(math.isinf(params[GEAR_STIFFNESS, i]) and params[BACKLASH, i] == 0.0)


@inlined
def roll(  # noqa: PLR0912 - one tick, in loops that the compiler makes vectors of
    group: Array,
    jobs: Jobs,
    number: Integers,
    live: int,
    tick_s: float,
    substeps: int,
    at: Integers,
    out: Array,
    rigid: bool,
    slow: bool,
    raised: bool,
) -> None:
    """Roll out one group, whose first ``live`` lanes have a job.

    What is different in every lane is done lane by lane, the rest in loops over all: lanes without
    a job or beyond its end go along, and nobody looks at them.
    """
    if group.shape[0] != ROWS or group.shape[1] != LANES:
        return  # never, but the compiler knows the shape from here on
    arrays, loads, lanes = drives(group), group[OF_LOADS:OF_LANES], group[OF_LANES:]
    params, states = arrays.params, arrays.states
    dt = tick_s / substeps
    tick = 0
    while live > 0:
        now = tick * tick_s
        for k in range(live):
            if now >= lanes[NEXT_EVENT, k]:
                hear(arrays, jobs, number[k], k, now, lanes, at)
            if at[GRAVITIES, k] > 1:
                weigh(jobs, number[k], k, now, lanes)
            shaft = loads[SHAFT_POSITION, k]
            lanes[TICK_SENSED, k] = sense(params, k, shaft)
            hurry(arrays, k, lanes[TICK_SENSED, k], loads[SHAFT_VELOCITY, k], tick_s)
        for k in range(at.shape[1]):  # LANES; told so, the compiler would write out all sixteen
            lanes[TICK_SINE, k], lanes[TICK_COSINE, k] = sine_cosine(loads[SHAFT_POSITION, k])
        for k in range(LANES):
            hang(params, loads, k, lanes)
            control_one(arrays, k, lanes[TICK_SENSED, k], lanes[TICK_VELOCITY, k], tick_s)
        for k in range(live):
            if loads[LEASH, k] > 0.0:
                lead(jobs, number[k], k, tick, tick_s, loads, lanes)
        for k in range(LANES):
            if now >= lanes[DUTY_DUE, k]:
                lanes[DUTY_SHOWN, k] = states[DUTY, k]
                lanes[DUTY_DUE, k] += loads[DUTY_REFRESH, k]
        for k in range(LANES):
            share_supply(arrays, k, k, k + 1)
        for k in range(LANES):
            lanes[VOLTS, k], lanes[CONDUCTANCE, k] = bridge(arrays, k)
            lanes[CURRENT_SUM, k], lanes[SQUARE_SUM, k] = 0.0, 0.0
        # the same each time; told what does not change, the compiler makes vectors of the second
        if raised or live < FEW:
            turn(arrays, loads, lanes, live, dt, substeps, rigid, slow, raised)
        else:
            turn(arrays, loads, lanes, LANES, dt, substeps, rigid, slow, False)
        for k in range(LANES):
            states[CURRENT, k] = lanes[CURRENT_SUM, k] / substeps
            power = winding_resistance(arrays, k) * lanes[SQUARE_SUM, k] / substeps
            warm(arrays, k, power, tick_s)
        for k in range(live):
            if min(lanes[NEXT_SEEN, k], lanes[NEXT_SAMPLE, k]) <= now + tick_s:
                show(arrays, loads, jobs, number[k], k, now, tick_s, lanes, at, out)
        tick += 1
        while live > 0 and at[TICKS, live - 1] <= tick:
            live -= 1


def rollout_of(*, rigid: bool, slow: bool, raised: bool) -> Rollout:
    """:func:`rollout` of groups of one kind, compiled for it: what never is so, is not asked."""

    @compiled
    def rollout_kind(
        groups: Array,
        jobs: Jobs,
        tick_s: float,
        substeps: int,
        first: int,
        last: int,
        at: Integers,
        out: Array,
    ) -> None:
        rollout(groups, jobs, tick_s, substeps, first, last, at, out, rigid, slow, raised)

    return rollout_kind
