"""What pulls at a lane's load, and how rotor and load turn within a tick. Compiled.

Gravity, a cable and a leash pull as they do when the tick begins; rotor and load are then moved in
substeps, as one mass where the gear is rigid.
"""

from __future__ import annotations

from ..compiling import inlined
from .fields import (
    BENT,
    CABLE_STIFFNESS,
    LOAD_OF_GEAR,
    ROTOR_POSITION,
    ROTOR_VELOCITY,
    Array,
    Arrays,
)
from .kernel import cable_torque
from .lanes import (
    CONDUCTANCE,
    COSINE,
    CURRENT_SUM,
    FASTER,
    HALT,
    LEASH,
    LEASH_DAMPING,
    LOAD_HALT,
    LOAD_INERTIA,
    LOAD_PUSH,
    PULL,
    PUSH,
    SAMPLE_SKEW,
    SHAFT_FRICTION,
    SHAFT_POSITION,
    SHAFT_VELOCITY,
    SINE,
    SLOPE,
    SQUARE_SUM,
    TICK_COSINE,
    TICK_POSITION,
    TICK_SENSED,
    TICK_SINE,
    TICK_VELOCITY,
    VOLTS,
    Jobs,
)
from .rotor import bend, friction, friction_level, gear_torque, motor_current, motor_torque, train


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
            load, passed = -outer, loads[LOAD_INERTIA, k] * lanes[FASTER, k] - outer
            if not rigid:
                load = passed = gear_torque(t, angle - shaft, speed - pace)
            external = outer - params[LOAD_OF_GEAR, k] * (outer + passed)
            level = friction_level(t, speed, motor, external)
            stop = -(lanes[HALT, k] * speed + motor - load)
            bent, push = states[BENT, k], lanes[PUSH, k]
            held = friction(t, level, bent, stop, push, dt)
            speed += push * (motor - load + held)
            angle += dt * speed
            states[BENT, k] = bend(t, bent, dt * speed)
            if rigid:
                lanes[FASTER, k] = (speed - pace) / dt
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
