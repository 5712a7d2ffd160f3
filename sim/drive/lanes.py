"""Many drives with a load each, rolled out in lockstep along recorded commands. Compiled.

A job is a servo of :mod:`sim.drive.kernel` with a supply and a load of its own, which is moved here
in the same substeps as the rotor. Jobs go in groups, in lockstep: the compiler makes one vector of
the same number of several jobs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiling import compiled, inlined
from .elementary import sine_cosine
from .fields import (
    BACKLASH,
    BENT,
    CABLE_STIFFNESS,
    COMMANDS,
    CURRENT,
    DELAY,
    DUTY,
    ENABLED,
    GEAR_STIFFNESS,
    GOALS,
    HEAT,
    PARAMS,
    ROTOR_INERTIA,
    ROTOR_POSITION,
    ROTOR_VELOCITY,
    STATES,
    SUPPLIES,
    VOLTAGE,
    WINDING_HEAT,
    Array,
    Arrays,
)
from .firmware import control_one, hurry, sense
from .kernel import bridge, cable_torque, share_supply, warm, winding_resistance
from .rotor import bend, friction, friction_level, gear_torque, motor_current, motor_torque, train

Integers = NDArray[np.int64]

# --- loads of rollouts: loads[field, job]
LOAD_INERTIA = 0  #: about the joint's axis [kg m^2]
SHAFT_POSITION = 1  #: of the output shaft, at the start and then as it moves [rad]
SHAFT_VELOCITY = 2  #: [rad/s]
SHAFT_FRICTION = 3  #: Coulomb friction of the load's own bearing [N m]
SAMPLE_SKEW = 4  #: angle and speed are of an instant this much later than their samples' [s]
DUTY_REFRESH = 5  #: what a sample shows of the duty is made anew in this period [s], 0 is always
DUTY_PHASE = 6  #: when that first happens [s]
TWIST = 7  #: of the rotor over the shaft at the start [rad]
LEASH = 8  #: stiffness with which the load is led along what was recorded [N m/rad], 0 is free
LEASH_DAMPING = 9  #: [N m s/rad]
LOADS = 10

# --- what a rollout gives of a sample: out[job, sample, channel]
OUT_POSITION = 0  #: as the servo senses it, without quantisation [rad]
OUT_VELOCITY = 1  #: [rad/s]
OUT_DUTY = 2
OUT_VOLTAGE = 3  #: at the terminals [V]
OUT_CURRENT = 4  #: of the motor [A]
OUT_HEAT = 5  #: winding over ambient [K]
CHANNELS = 6

# --- what a rollout remembers of its lanes: lanes[field, lane]
NEXT_EVENT = 0  #: when there is something new to hear [s]
NEXT_SEEN = 1  #: of what instant the next sample's angle is [s]
NEXT_SAMPLE = 2  #: when the rest of the next sample is taken [s]
DUTY_DUE = 3  #: when what a sample shows of the duty is made anew [s]
DUTY_SHOWN = 4
COSINE = 5  #: gravity's torque at an angle of 0, see Jobs [N m]
SINE = 6  #: gravity's torque at a quarter turn, negative [N m]
TICK_POSITION = 7  #: of the shaft at the beginning of the tick [rad]
TICK_SENSED = 8  #: of the shaft, as sensed [rad]
TICK_VELOCITY = 9  #: of the shaft [rad/s]
PULL = 10  #: of gravity and cable at the beginning of the tick [N m]
SLOPE = 11  #: of that over the shaft's angle [N m/rad]
VOLTS = 12  #: see Train
CONDUCTANCE = 13  #: see Train
HALT = 14  #: torque that stops a speed of the rotor within a substep [N m s/rad]
PUSH = 15  #: speed that a torque on the rotor makes within a substep [rad/(s N m)]
LOAD_HALT = 16  #: the same of the load
LOAD_PUSH = 17
CURRENT_SUM = 18  #: over the tick's substeps [A]
SQUARE_SUM = 19  #: over the tick's substeps [A^2]
TICK_COSINE = 20  #: of the shaft's angle at the beginning of the tick
TICK_SINE = 21  #: of the shaft's angle
MEMORIES = 22

# --- how far a rollout's lanes are: at[field, lane]
EVENT = 0  #: number of the next event that is no goal
GOAL_EVENT = 1  #: number of the next event that is a goal
SEEN = 2  #: number of the next sample whose angle is to be seen
SAMPLE = 3  #: number of the next sample whose rest is to be taken
TICKS = 4  #: how many ticks there are
GRAVITIES = 5  #: how many rows of gravity there are, 1 where it does not turn
PLACES = 6

# --- a group of jobs, rolled out in lockstep: group[row, lane]. All is in one array: the compiler
# then knows how far rows lie apart, and that a vector of lanes can be read, moved and written
LANES = 16  #: in a group; two vectors of eight hide each other's latency
FEW = 4  #: jobs that are done one after the other rather than as a whole group
OF_STATES = PARAMS
OF_COMMANDS = OF_STATES + STATES
OF_SUPPLIES = OF_COMMANDS + COMMANDS
OF_LOADS = OF_SUPPLIES + SUPPLIES
OF_LANES = OF_LOADS + LOADS
ROWS = OF_LANES + MEMORIES

SUPPLY_EVENT = 100  #: an event's field from here on is one of the supplies'


class Jobs(NamedTuple):
    """What the jobs of one :func:`rollout` have to do; jobs of one recording share its events.

    ``number`` (groups, LANES) says which job a lane has; lanes without one come last and say -1.
    ``recording`` (jobs,) says which. ``events`` (n, 3) are time [s], field and value, ``samples``
    (n,) times [s], both ascending within a recording and from ``event_range`` and ``sample_range``
    (recordings + 1,). The torque of gravity is ``cos(q) gravity[0] - sin(q) gravity[1]`` with the
    columns of ``gravity`` (n, 2) from ``gravity_range`` (jobs + 1,), spread evenly over the job's
    time and interpolated; one row is a constant. ``end_s`` (recordings,) ends the rollout. ``path``
    (n, 2) is what the servo showed at the beginning of every tick, angle [rad] and speed [rad/s],
    from ``path_range`` (recordings + 1,): where a load on a leash is led.
    """

    number: Integers
    recording: Integers
    events: Array
    event_range: Integers
    samples: Array
    sample_range: Integers
    gravity: Array
    gravity_range: Integers
    end_s: Array
    path: Array
    path_range: Integers


Rollout = Callable[[Array, Jobs, float, int, int, int, Integers, Array], None]


@inlined
def drives(group: Array) -> Arrays:
    """The part of a group that the kernel's ``drive`` and ``control`` know, too."""
    return Arrays(
        group[:OF_STATES],
        group[OF_STATES:OF_COMMANDS],
        group[OF_COMMANDS:OF_SUPPLIES],
        group[OF_SUPPLIES:OF_LOADS],
    )


@inlined
def rigid_gear(params: Array, i: int) -> bool:
    """Whether a rotor and its load are one mass."""
    return bool(math.isinf(params[GEAR_STIFFNESS, i]) and params[BACKLASH, i] == 0.0)


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
        lanes[LOAD_HALT, k], lanes[LOAD_PUSH, k] = load_inertia / dt, dt / load_inertia
    return live


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
def weigh(jobs: Jobs, job: int, k: int, now: float, lanes: Array) -> None:
    """Gravity on a lane's load that turns during its job."""
    low, rows = jobs.gravity_range[job], jobs.gravity_range[job + 1] - jobs.gravity_range[job]
    place = now / jobs.end_s[jobs.recording[job]] * (rows - 1)
    row = min(int(place), rows - 2)
    part = place - row
    row += low
    lanes[SINE, k] = (1.0 - part) * jobs.gravity[row, 1] + part * jobs.gravity[row + 1, 1]
    lanes[COSINE, k] = (1.0 - part) * jobs.gravity[row, 0] + part * jobs.gravity[row + 1, 0]


@inlined
def hang(params: Array, loads: Array, k: int, lanes: Array) -> None:
    """Where a shaft is when a tick begins, and what gravity and its cable pull there.

    Both are linear within a tick: a joint moves some mrad.
    """
    shaft, sin, cos = loads[SHAFT_POSITION, k], lanes[TICK_SINE, k], lanes[TICK_COSINE, k]
    sine, cosine = lanes[SINE, k], lanes[COSINE, k]
    lanes[TICK_POSITION, k], lanes[TICK_VELOCITY, k] = shaft, loads[SHAFT_VELOCITY, k]
    lanes[PULL, k] = cosine * cos - sine * sin + cable_torque(params, k, shaft)
    lanes[SLOPE, k] = -cosine * sin - sine * cos - params[CABLE_STIFFNESS, k]


@inlined
def lead(
    jobs: Jobs, job: int, k: int, tick: int, tick_s: float, loads: Array, lanes: Array
) -> None:
    """Add a leash's pull on a lane's load, towards what the servo showed when the tick begins."""
    recording = jobs.recording[job]
    first, last = jobs.path_range[recording], jobs.path_range[recording + 1]
    row = first + tick - round(loads[SAMPLE_SKEW, k] / tick_s)
    row = min(last - 1, max(first, row))
    away = jobs.path[row, 0] - lanes[TICK_SENSED, k]
    faster = jobs.path[row, 1] - lanes[TICK_VELOCITY, k]
    lanes[PULL, k] += loads[LEASH, k] * away + loads[LEASH_DAMPING, k] * faster


@inlined
def turn(
    arrays: Arrays,
    loads: Array,
    lanes: Array,
    count: int,
    dt: float,
    substeps: int,
    rigid: bool,
    slow: bool,
    raised: bool,
) -> None:
    """Move the rotors and shafts of the first ``count`` lanes by one tick."""
    params, states = arrays.params, arrays.states
    for _ in range(substeps):
        for k in range(count):
            t = train(params, k, lanes[VOLTS, k], lanes[CONDUCTANCE, k], slow, raised)
            angle, speed = states[ROTOR_POSITION, k], states[ROTOR_VELOCITY, k]
            shaft, pace = loads[SHAFT_POSITION, k], loads[SHAFT_VELOCITY, k]
            outer = lanes[PULL, k] + lanes[SLOPE, k] * (shaft - lanes[TICK_POSITION, k])
            current = motor_current(t, speed)
            motor = motor_torque(t, current)
            load = -outer
            if not rigid:
                load = gear_torque(t, angle - shaft, speed - pace)
            level = friction_level(t, speed, motor, -load)
            stop = -(lanes[HALT, k] * speed + motor - load)
            bent, push = states[BENT, k], lanes[PUSH, k]
            held = friction(t, level, bent, stop, push, dt)
            speed += push * (motor - load + held)
            angle += dt * speed
            states[BENT, k] = bend(t, bent, dt * speed)
            if rigid:
                shaft, pace = angle, speed
            else:
                bearing = loads[SHAFT_FRICTION, k]
                stop = -(lanes[LOAD_HALT, k] * pace + load + outer)
                held = min(bearing, max(-bearing, stop))
                pace += lanes[LOAD_PUSH, k] * (load + outer + held)
                shaft += dt * pace
            states[ROTOR_POSITION, k], states[ROTOR_VELOCITY, k] = angle, speed
            loads[SHAFT_POSITION, k], loads[SHAFT_VELOCITY, k] = shaft, pace
            lanes[CURRENT_SUM, k] += current
            lanes[SQUARE_SUM, k] += current * current


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
