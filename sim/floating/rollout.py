"""A robot on legs through a whole recording, in one compiled call."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiling import compiled
from ..drive.bank import DriveBank
from ..drive.fields import VOLTAGE, Array, Arrays
from ..drive.kernel import move
from ..entries import PhysicsError
from ..shapes import Vector
from ..stability import bearable
from ..stepped import STEPS_PER_TICK, SUBSTEPS, TICK_S
from ..tree import PhysicalRobot
from .arrays import FREE, Motion, Tree, Work
from .arrays import motion as still
from .arrays import tree as tree_of
from .arrays import work as room
from .contact import NORMALLY, couple, gather, pass_on, press
from .dynamics import bias_forces, factor, mass_matrix, place_bodies, solve_down, solve_up

#: of a look at a robot: the trunk's place, its frame row by row, the mean voltage
PLACE, FRAME, VOLTS, LOOK = slice(0, 3), slice(3, 12), 12, 13


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where a robot is at first, at rest: joints by name [rad], its trunk's frame in the world.

    ``held``: the trunk stays there, and no foot touches anything.
    """

    joints_rad: Mapping[str, float]
    origin_m: Vector
    yaw_rad: float = 0.0
    held: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Rolled:
    """Where a robot was: joints' angles at every tick (ticks, joints), in the robot's order.

    The rest is of every so many ticks, ``look_s`` after the beginning: the trunk's origin in the
    world (looks, 3), its frame (looks, 3, 3), the drives' mean voltage (looks,), and whether a body
    pressed on the ground (looks,), by its name.
    """

    angle_rad: Array
    look_s: Array
    origin_m: Array
    frame: Array
    voltage_v: Array
    pressed: Mapping[str, NDArray[np.bool_]]


def rollout(
    robot: PhysicalRobot,
    start: Start,
    commands: Array,
    events: Array,
    ticks: int,
    every: int,
    steps_per_tick: int | None = None,
) -> Rolled:
    """Let a robot do what its drives are told.

    ``commands`` (fields, joints) are the drives' at first, ``events`` (n, 4), in order: tick from
    which it holds, joint, field of :mod:`sim.drive.fields`, value. Steps are as many a tick as the
    gears ask for, if not given. Raises :class:`sim.entries.PhysicsError` for a gear too stiff for
    any step, or joints that move without bounds.
    """
    tree = tree_of(robot)
    motion, work = still(tree), room(tree)
    motion.turned[:2, :2] = _turn(start.yaw_rad)
    motion.origin[:] = start.origin_m
    motion.angle[1:] = [start.joints_rad[body.name] for body in robot.bodies]
    joints = np.zeros((3, len(robot.joints)))
    joints[0] = [start.joints_rad[joint.name] for joint in robot.joints]
    mount = np.array(
        [[float(j.direction) for j in robot.joints], [j.zero_rad for j in robot.joints]]
    )
    steps = steps_per_tick or _steps(robot, start)
    bank = DriveBank(
        [joint.drive for joint in robot.joints],
        (joints[0] - mount[1]) * mount[0],
        supply_voltage_v=robot.supply.voltage_v,
        supply_resistance_ohm=robot.supply.resistance_ohm,
        step_s=TICK_S / steps,
        substeps=SUBSTEPS,
        tick_s=TICK_S,
    )
    bank.commands[:] = commands
    angles = np.empty((ticks, len(robot.joints)))
    count = -(-ticks // every)
    looks, pressed = np.empty((count, LOOK)), np.empty((count, len(tree.parent)))
    roll(
        *(tree, motion, work, bank.arrays, mount, joints, np.zeros_like(joints), events),
        *(TICK_S, steps, SUBSTEPS, every, not start.held, angles, looks, pressed),
    )
    if not np.isfinite(angles).all():
        raise PhysicsError(f"{robot.name}: its joints move without bounds; look at its drives")
    names = ("trunk", *(body.name for body in robot.bodies))
    return Rolled(
        angles,
        np.arange(count, dtype=np.float64) * (every * TICK_S),
        looks[:, PLACE],
        looks[:, FRAME].reshape(-1, 3, 3),
        looks[:, VOLTS],
        {name: pressed[:, b] > 0.0 for b, name in enumerate(names)},
    )


def inverse_mass(robot: PhysicalRobot, joints_rad: Mapping[str, float], *, held: bool) -> Array:
    """The joints' part of the inverse mass matrix [1/(kg m^2)] at a posture, in joints' order.

    ``held``: of the legs on a trunk that does not move.
    """
    tree = tree_of(robot)
    motion, work = still(tree), room(tree)
    motion.angle[1:] = [joints_rad[body.name] for body in robot.bodies]
    place_bodies(tree, motion, work)
    mass_matrix(tree, work)
    lower = np.tril(work.mass)
    whole = lower + np.tril(lower, -1).T
    of_joints = whole[FREE:, FREE:] if held else whole
    last = 0 if held else FREE
    rows = last + np.argsort(tree.servo[1:])
    return np.asarray(np.linalg.inv(of_joints)[np.ix_(rows, rows)])


def _steps(robot: PhysicalRobot, start: Start) -> int:
    """How many steps a tick must be for the gears of a robot as it starts."""
    inverse = inverse_mass(robot, start.joints_rad, held=start.held)
    drives = {joint.name: joint.drive for joint in robot.joints}
    return bearable(drives, [inverse], TICK_S, STEPS_PER_TICK, robot.name)[0]


def _turn(yaw_rad: float) -> Array:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s], [s, c]])


@compiled
def turn_trunk(motion: Motion, step_s: float) -> None:
    """Turn the trunk's frame by its angular velocity over one step."""
    x, y, z = motion.pace[0] * step_s, motion.pace[1] * step_s, motion.pace[2] * step_s
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    share = 0.5 if angle < 1e-9 else math.sin(half) / angle
    # as a quaternion, so that the frame stays one
    a, b, c, d = math.cos(half), share * x, share * y, share * z
    t = motion.turned
    for j in range(3):
        p, q, r = t[0, j], t[1, j], t[2, j]
        # v + 2 u x (u x v + a v)
        e, f, g = c * r - d * q + a * p, d * p - b * r + a * q, b * q - c * p + a * r
        t[0, j] = p + 2.0 * (c * g - d * f)
        t[1, j] = q + 2.0 * (d * e - b * g)
        t[2, j] = r + 2.0 * (b * f - c * e)
    for j in range(3):  # what rounding adds up to
        for k in range(j):
            along = t[0, j] * t[0, k] + t[1, j] * t[1, k] + t[2, j] * t[2, k]
            for i in range(3):
                t[i, j] -= along * t[i, k]
        size = math.sqrt(t[0, j] ** 2 + t[1, j] ** 2 + t[2, j] ** 2)
        for i in range(3):
            t[i, j] /= size


@compiled
def step(tree: Tree, motion: Motion, work: Work, torque: Array, step_s: float, free: bool) -> None:
    """Move all bodies by one step; ``torque`` [N m] by servo."""
    place_bodies(tree, motion, work)
    bias_forces(tree, motion, work)
    mass_matrix(tree, work)
    factor(tree, work, free)
    push, pace = work.push, motion.pace
    for i in range(FREE):
        push[i] = -push[i]
    for b in range(1, len(tree.parent)):
        push[FREE + b - 1] = torque[tree.servo[b]] - push[FREE + b - 1]
    solve_down(tree, work, push, len(push) - 1, free)
    solve_up(tree, work, push, free)
    # the trunk's origin moves on, and with it the point that accelerations are about
    push[3] += pace[1] * pace[5] - pace[2] * pace[4]
    push[4] += pace[2] * pace[3] - pace[0] * pace[5]
    push[5] += pace[0] * pace[4] - pace[1] * pace[3]
    for i in range(0 if free else FREE, len(push)):
        pace[i] += step_s * push[i]
    count = gather(tree, motion, work, pace, step_s, free)
    if count > 0:
        couple(tree, work, count, free)
        press(work, count)
        pass_on(tree, motion, work, count)
        solve_up(tree, work, push, free)
        for i in range(len(push)):
            pace[i] += push[i]
    for i in range(3):
        motion.origin[i] += step_s * pace[3 + i]
    turn_trunk(motion, step_s)
    for b in range(1, len(tree.parent)):
        motion.angle[b] += step_s * pace[FREE + b - 1]


@compiled
def roll(
    tree: Tree,
    motion: Motion,
    work: Work,
    arrays: Arrays,
    mount: Array,
    joints: Array,
    shafts: Array,
    events: Array,
    tick_s: float,
    steps: int,
    substeps: int,
    every: int,
    free: bool,
    angles: Array,
    looks: Array,
    pressed: Array,
) -> None:
    """Ticks from the first to the last; angles at each, looks at every so many of them."""
    k = 0
    for tick in range(len(angles)):
        while k < len(events) and events[k, 0] <= tick:
            arrays.commands[int(events[k, 2]), int(events[k, 1])] = events[k, 3]
            k += 1
        for i in range(joints.shape[1]):
            angles[tick, i] = joints[0, i]
        if tick % every == 0:
            look(tree, motion, arrays, looks[tick // every], pressed[tick // every])
        for s in range(steps):
            move(arrays, mount, joints, shafts, tick_s if s == 0 else 0.0, tick_s / steps, substeps)
            step(tree, motion, work, joints[2], tick_s / steps, free)
            for b in range(1, len(tree.parent)):
                joints[0, tree.servo[b]] = motion.angle[b]
                joints[1, tree.servo[b]] = motion.pace[FREE + b - 1]


@compiled
def look(tree: Tree, motion: Motion, arrays: Arrays, out: Array, pressed: Array) -> None:
    """Where the trunk is, what voltage drives have, and which bodies press on the ground."""
    for i in range(3):
        out[i] = motion.origin[i]
        for j in range(3):
            out[3 + 3 * i + j] = motion.turned[i, j]
    total = 0.0
    for i in range(arrays.states.shape[1]):
        total += arrays.states[VOLTAGE, i]
    out[VOLTS] = total / arrays.states.shape[1]
    for b in range(len(pressed)):
        pressed[b] = 0.0
    for p in range(len(tree.owner)):
        pressed[tree.owner[p]] += motion.impulse[NORMALLY, p]
