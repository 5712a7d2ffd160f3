"""Where a servo of a whole robot shut itself down: what follows is of another robot.

Nobody writes such a change, so that replays of what was written know nothing of it. It is seen
where the register was read that a shutdown cuts.
"""

from __future__ import annotations

from collections.abc import Sequence

import pyarrow.compute as pc

from bench.recording import Recording
from bench.recording.rules import READ, WRITE
from busemu.tables import Robot, ServoMount


def before_shutdowns(
    robot: Robot, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """Recordings up to where the last servo was known to hold, and a sentence for each cut one."""
    kept, told = [], []
    for recording in recordings:
        cuts = [
            (held_s, mount)
            for mount in robot.servos
            if (held_s := _held_s(recording, robot, mount))
        ]
        if not cuts:
            kept.append(recording)
            continue
        held_s, mount = min(cuts, key=lambda cut: cut[0])
        table = recording.table.filter(pc.less_equal(recording.table.column("t_s"), held_s))
        kept.append(Recording.checked(table, recording.metadata, recording.path))
        told.append(
            f"{recording.name}: {mount.joint} shut itself down after {held_s:.2f} s; what follows "
            "is not compared"
        )
    return tuple(kept), tuple(told)


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
