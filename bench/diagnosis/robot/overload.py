"""Where a servo of a whole robot is at its limit, or shut itself down: what follows is left out.

A joint whose servo gives all it can yields, and when and how fast hangs on everything: a few per
cent of torque decide whether a leg holds or folds. Of that, a robot that stands tells its limit and
little else. After a shutdown it is another robot; nobody writes such a change, so that replays of
what was written know nothing of it. It is seen where the register was read that a shutdown cuts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow.compute as pc

from bench.experiments.position_error import TorqueSensor
from bench.recording import Recording, joint_track
from bench.recording.rules import READ, WRITE
from busemu.tables import Robot, ServoMount

from .features import STAND_UP_S
from .gait import WINDOW_S, gait_phase
from .replay import LEAST_SAMPLES

SAFE = 0.75  #: of the stall torque, which a servo holds; source: the thesis's safe torque
#: over that before what follows is left out. Assumed: robots that stand up take 0.7 s
OVERLOADED_S = 2.0
#: at its limit before a servo shuts itself down; assumed, as for the drive's ``overload_time_s``
YIELDING_S = 1.0


def before_overload(
    robot: Robot, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """Recordings up to where all servos hold, and a sentence for each that ends sooner so.

    Those of which that leaves too little to compare are left out.
    """
    kept, told = [], []
    for recording in recordings:
        ends = [*_shutdowns(robot, recording), *_overloads(robot, recording)]
        if not ends:
            kept.append(recording)
            continue
        last_s, what = min(ends)
        if not _tells(robot, recording, last_s):
            told.append(
                f"{recording.name} was left out: {what}, from {last_s - recording.t_s[0]:.2f} s "
                "after its beginning on: what is before that is too short to compare; record it "
                "with less load"
            )
            continue
        table = recording.table.filter(pc.less_equal(recording.table.column("t_s"), last_s))
        kept.append(Recording.checked(table, recording.metadata, recording.path))
        told.append(f"{recording.name}: {what}; what follows {last_s:.2f} s is not compared")
    return tuple(kept), tuple(told)


def _tells(robot: Robot, recording: Recording, last_s: float) -> bool:
    """Whether some joint was read often enough until then, and for a window after it stood up."""
    tracks = [joint_track(recording, mount.joint, robot) for mount in robot.servos]
    seen = [track.position_t_s[track.position_t_s <= last_s] for track in tracks]
    first_s = min((float(t_s[0]) for t_s in seen if len(t_s)), default=last_s)
    compared_s = first_s + STAND_UP_S + WINDOW_S
    return any(len(t_s) >= LEAST_SAMPLES and t_s[-1] >= compared_s for t_s in seen)


def _shutdowns(robot: Robot, recording: Recording) -> Iterator[tuple[float, str]]:
    """Until when servos held that shut themselves down later [s], and what to say."""
    for mount in robot.servos:
        held_s = _held_s(recording, robot, mount)
        if held_s is not None:
            yield held_s - YIELDING_S, f"{mount.joint} shut itself down after {held_s:.2f} s"


def _held_s(recording: Recording, robot: Robot, mount: ServoMount) -> float | None:
    """When a servo was last read that had not shut itself down yet [s], if it did later."""
    name = str(robot.tables[mount.servo_id].drive["shutdown_cuts"])
    times, raw = recording.series(mount.servo_id, name, READ)
    written_s, written = recording.series(mount.servo_id, name, WRITE)
    held_s: float | None = None
    for t_s, value in zip(times.tolist(), raw.tolist(), strict=True):
        if value:
            held_s = t_s
        elif held_s is not None:
            between = (written_s > held_s) & (written_s <= t_s) & (written == 0.0)
            if not between.any():
                return held_s
            held_s = None
    return None


def _overloads(robot: Robot, recording: Recording) -> Iterator[tuple[float, str]]:
    """When servos of a robot that stands begin to be near their limits for long [s]."""
    tracks = [joint_track(recording, mount.joint, robot) for mount in robot.servos]
    goals = {t.joint: (t.goal_t_s, t.goal_rad) for t in tracks if len(t.goal_t_s)}
    if not goals or gait_phase(goals, robot) is not None:
        return
    for track in tracks:
        sensor = TorqueSensor.of_recording(recording, robot, track.joint)
        over = np.abs(sensor.duty(track.error_rad)) > SAFE
        edges = np.flatnonzero(np.diff(over.astype(np.int8), prepend=0, append=0))
        times = track.position_t_s
        for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
            if times[last] - times[first] > OVERLOADED_S:
                yield float(times[first]), f"{track.joint} is near its stall torque for long"
                break
