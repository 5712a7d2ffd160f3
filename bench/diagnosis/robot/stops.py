"""Stops that a walking robot has gone past, so that they cannot be where its file assumes them.

A joint that ran into a stop in every replay, and in no recording, looked like physics that is left
out: a PhantomX whose tibiae swing 39 mrad past an assumed stop was 25 mrad aside once a cycle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bench.recording import Recording, joint_track
from busemu.tables import Robot
from sim.tree import SEGMENTS

#: what is read no farther beyond a stop may stand at it: a zero is +-1 deg; as in robot_nuisances
BEYOND_RAD = math.radians(1.0)
ROOM_RAD = math.radians(5.0)  #: from the farthest that was read to the stop then; assumed
READS = 3  #: of one joint that must be so far: one may be damaged
SIDES = (("lower_rad", -1.0), ("upper_rad", 1.0))


def past_stops(robot: Robot, recordings: Sequence[Recording]) -> tuple[Robot, tuple[str, ...]]:
    """The robot with stops out of the way of what was read, and a sentence for each that moved.

    All legs share the stops of a segment, so one leg that went past one moves it for all of them.
    """
    links: dict[str, Any] = dict(robot.document["link"])
    told = []
    for segment in SEGMENTS:
        read = [_reads(recording, robot, segment) for recording in recordings]
        for key, side in SIDES:
            entry = links[segment][key]
            stop = float(entry["value"] if isinstance(entry, dict) else entry)
            reached = max((_third(side * angle) for one in read for angle in one), default=-math.pi)
            if reached <= side * stop + BEYOND_RAD:
                continue
            moved = side * min(math.pi, reached + ROOM_RAD)
            source = f"assumed: recordings read it at {side * reached:.3f} rad, past {stop:g} rad"
            links[segment] = links[segment] | {key: {"value": moved, "source": source}}
            told.append(
                f"{segment} joints were read at {side * reached:.3f} rad, past their stop of the "
                f"robot file ({key} = {stop:g} rad): replays have it at {moved:.3f} rad"
            )
    if not told:
        return robot, ()
    return replace(robot, document={**robot.document, "link": links}), tuple(told)


def _reads(recording: Recording, robot: Robot, segment: str) -> list[Any]:
    """Angles of every joint of a segment that was read often enough [rad]."""
    names = [mount.joint for mount in robot.servos if mount.joint.endswith(f".{segment}")]
    angles = [joint_track(recording, name, robot).position_rad for name in names]
    return [angle for angle in angles if len(angle) >= READS]


def _third(angle_rad: Any) -> float:
    """The third largest angle [rad]."""
    return float(np.partition(angle_rad, -READS)[-READS])
