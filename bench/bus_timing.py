"""How long a bus takes for each kind of transaction: measured through the robot's own client.

Run on a port it measures wall-clock time as the program sees it; run in process it gives the times
of the model, since virtual time is nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from busemu.clock import Clock
from hal.bus_errors import CorruptReplyError, NoReplyError

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


#: How often a transaction is tried before its servo is said to be mute. Assumed: a busy machine
#: holds a server up for some timeouts, not for so many in a row.
TRIES = 10

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
    after each repeat. A reply that is lost or damaged, as on a busy machine, is asked for again and
    not timed; the client's statistics count it. Raises :class:`hal.bus_errors.BusError` where a
    servo does not answer in :data:`TRIES` tries.
    """
    client, clock, bus = session.client, session.clock, session.bus
    ids = [servo.servo_id for servo in session.robot.servos]
    one = ids[0]
    goals: dict[int, int] = {}

    def learn() -> None:
        goals.update({i: client.read(i, "goal_position") for i in ids if i not in goals})

    _answered(learn, clock)
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
            before_s, after_s = _answered(act, clock)
            if kind == "write all":
                if bus is not None:
                    after_s = bus.line_free_s
                clock.sleep_until(clock.now_s() + 0.003)  # the next one finds the line free
            times_s[index] = after_s - before_s
            if progress is not None:
                progress()
        timed.append(Timed(kind, what, times_s))
    return timed


def _answered(act: Callable[[], object], clock: Clock) -> tuple[float, float]:
    """Do ``act`` until it is answered: when the answered one began and ended [s]."""
    for _ in range(TRIES - 1):
        before_s = clock.now_s()
        with suppress(NoReplyError, CorruptReplyError):
            act()
            return before_s, clock.now_s()
    before_s = clock.now_s()
    act()
    return before_s, clock.now_s()
