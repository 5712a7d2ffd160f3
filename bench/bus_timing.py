"""How long a bus takes for each kind of transaction: measured through the robot's own client.

Run on a port it measures wall-clock time as the program sees it; run in process it gives the times
of the model, since virtual time is nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .running import Session

#: What the thesis measured, in ms: (robot, kind) -> (figure, whether it is only an upper bound).
#: Source: Nguyenova, High-Fidelity Modeling of Hexapod Walking Robot Locomotion, CTU 2019.
THESIS_MS = {
    ("phantomx", "read one"): (1.0, False),
    ("phantomx", "write all"): (1.0, True),
    ("phantomx", "control cycle"): (19.0, False),
    ("marvin", "read one"): (3.0, False),
    ("marvin", "write all"): (1.0, True),
    ("marvin", "read all"): (13.0, False),
}


#: What the star at a sync_write stands for.
WRITE_NOTE = "* modelled until its last byte is on the wire, measured until the program goes on"


@dataclass(frozen=True, slots=True)
class Timed:
    """Times of one kind of transaction [s], shape (repeats,)."""

    kind: str
    what: str
    times_s: NDArray[np.float64]

    @property
    def median_s(self) -> float:
        """The median [s]."""
        return float(np.median(self.times_s))

    def thesis_ms(self, robot: str) -> tuple[float, bool] | None:
        """The thesis's figure [ms] and whether it is an upper bound, if it gives one."""
        return THESIS_MS.get((robot, self.kind))


def time_bus(
    session: Session, repeats: int = 100, progress: Callable[[], None] | None = None
) -> list[Timed]:
    """Time every kind of transaction of the robot's control loop, ``repeats`` times each.

    Nothing moves: goals are written as they are, with the torque as it is. ``progress`` is called
    after each repeat. Raises :class:`hal.bus_errors.BusError` where a servo does not answer.
    """
    client, clock, bus = session.client, session.clock, session.bus
    ids = [servo.servo_id for servo in session.robot.servos]
    one = ids[0]
    goals = {i: client.read(i, "goal_position") for i in ids}
    count = len(ids)
    sync = session.robot.protocol == 2.0

    def cycle() -> None:
        client.sync_write("goal_position", goals)
        client.read_all("present_position", ids)

    kinds: list[tuple[str, str, Callable[[], object]]] = [
        ("ping", "ping of one servo", lambda: client.ping(one)),
        (
            "read one",
            "read of one position",
            lambda: client.read(one, "present_position"),
        ),
        (
            "write one",
            "write of one goal, answered",
            lambda: client.write(one, "goal_position", goals[one]),
        ),
        (
            "write all",
            f"sync_write of {count} goals *",
            lambda: client.sync_write("goal_position", goals),
        ),
        (
            "read all",
            f"sync_read of {count} positions" if sync else f"{count} reads, one after another",
            lambda: client.read_all("present_position", ids),
        ),
        ("control cycle", "sync_write of all goals, then all positions", cycle),
    ]
    timed = []
    for kind, what, act in kinds:
        times_s = np.empty(repeats)
        for index in range(repeats):
            before_s = clock.now_s()
            act()
            after_s = clock.now_s()
            if kind == "write all":
                if bus is not None:
                    after_s = bus.line_free_s
                clock.sleep_until(clock.now_s() + 0.003)  # the next one finds the line free
            times_s[index] = after_s - before_s
            if progress is not None:
                progress()
        timed.append(Timed(kind, what, times_s))
    return timed
