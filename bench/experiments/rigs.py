"""The servo check and the leg step on rigs: which joints they move, from where, between what.

A rig has a fixed base and no legs, so nothing is raised or lifted: its joints start where its file
has them at rest, and a clamp about there is what a joint is blocked by.
"""

from __future__ import annotations

from busemu.tables import Robot
from sim.robot import read_physics
from sim.tree import Joint

from .experiment import ExperimentError
from .position_error import TorqueSensor

#: How far either side of where it rests a joint is clamped [rad]; assumed: well beyond the error of
#: a loaded joint, and no longer a way than the hand clears.
CLAMP_RAD = 0.15
#: Steps stay so far from a joint's stops [rad]; assumed: more than an overshoot.
CLEAR_RAD = 0.15


def is_rig(robot: Robot) -> bool:
    """Whether a robot file describes a rig: a tree of bodies on a fixed base."""
    return "body" in robot.document


def only_hexapods(robot: Robot, experiment: str) -> None:
    """Raise :class:`ExperimentError` for a robot without legs."""
    if not robot.document.get("leg"):
        raise ExperimentError(
            f"{experiment} needs a robot that walks, and {robot.name} has no legs: use servo-check "
            "or leg-step"
        )


def no_such_leg(robot: Robot, leg: str) -> ExperimentError:
    """The error for a leg that a robot does not have."""
    names = [str(row.get("name")) for row in robot.document.get("leg", ())]
    known = f"use --leg {' or --leg '.join(names)}" if names else "its file has no [[leg]]"
    return ExperimentError(f"{robot.name} has no leg {leg}: {known}")


def rest_rad(robot: Robot) -> dict[str, float]:
    """Where the joints of a rig are at rest [rad]. Raises :class:`sim.entries.PhysicsError`."""
    model = read_physics(robot)
    return {joint.name: model.rest_rad[joint.segment] for joint in model.joints}


def clamp_rad(robot: Robot, name: str, past: float) -> tuple[float, float]:
    """Between which angles a joint is clamped [rad], about where it rests.

    Its goal must be able to go on into either block by ``past`` times the error of full duty.
    Raises :class:`ExperimentError` where its servo's range has no room for that.
    """
    joint = _joint(robot, name)
    mount = robot.by_joint[name]
    deep = CLAMP_RAD + past * TorqueSensor.of(robot, mount, mount.registers).full_error_rad
    goal = robot.tables[mount.servo_id]["goal_position"]
    bounds = (goal.minimum, goal.maximum)
    ends = sorted(mount.to_joint((bound - goal.zero) * goal.si_scale) for bound in bounds)
    lower, upper = max(ends[0] + deep, joint.lower_rad), min(ends[1] - deep, joint.upper_rad)
    if lower > upper:
        raise ExperimentError(
            f"{name}: its servo turns from {ends[0]:.2f} to {ends[1]:.2f} rad, and full duty needs "
            f"an error of {deep - CLAMP_RAD:.2f} rad beyond a block on either side: raise its gain"
        )
    centre = min(upper, max(lower, rest_rad(robot)[name]))
    return centre - CLAMP_RAD, centre + CLAMP_RAD


def steps_rad(robot: Robot, size_rad: float) -> dict[str, tuple[float, float]]:
    """From where to where each joint of a rig steps [rad]: by a size, or what its stops leave."""
    found = {}
    for name, rest in rest_rad(robot).items():
        joint = _joint(robot, name)
        lower, upper = joint.lower_rad + CLEAR_RAD, joint.upper_rad - CLEAR_RAD
        if upper - lower < size_rad:
            raise ExperimentError(
                f"{name} turns from {joint.lower_rad:.2f} to {joint.upper_rad:.2f} rad: too little "
                f"for a step of {size_rad:g} rad, {CLEAR_RAD:g} rad clear of its stops"
            )
        start = min(upper, max(lower, rest))
        goal = start + size_rad if start + size_rad <= upper else start - size_rad
        found[name] = (start, goal)
    return found


def _joint(robot: Robot, name: str) -> Joint:
    return next(joint for joint in read_physics(robot).joints if joint.name == name)
