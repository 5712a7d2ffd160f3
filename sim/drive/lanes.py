"""What stands where in rollouts: jobs, what they are given, and the lanes of the groups they go in.

A job is a servo of :mod:`sim.drive.kernel` with a supply and a load of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiling import inlined
from .fields import COMMANDS, PARAMS, STATES, SUPPLIES, Array, Arrays

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
FASTER = 22  #: acceleration of the shaft in the last substep [rad/s^2]
MEMORIES = 23

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
OF_STATES = PARAMS
OF_COMMANDS = OF_STATES + STATES
OF_SUPPLIES = OF_COMMANDS + COMMANDS
OF_LOADS = OF_SUPPLIES + SUPPLIES
OF_LANES = OF_LOADS + LOADS
ROWS = OF_LANES + MEMORIES

SUPPLY_EVENT = 100  #: an event's field from here on is one of the supplies'


class Jobs(NamedTuple):
    """What the jobs of one rollout have to do; jobs of one recording share its events.

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


@inlined
def drives(group: Array) -> Arrays:
    """The part of a group that ``kernel.drive`` and ``firmware.control`` know, too."""
    return Arrays(
        group[:OF_STATES],
        group[OF_STATES:OF_COMMANDS],
        group[OF_COMMANDS:OF_SUPPLIES],
        group[OF_SUPPLIES:OF_LOADS],
    )
