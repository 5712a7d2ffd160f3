"""``python -m bench.soak``: hours of traffic with faults, to see whether anything grows or drifts.

A robot's own program sets goals and reads positions, 50 times a second, while packets are lost and
damaged at random and every 20 s something befalls a servo or the port. Once a minute all faults are
cleared and every servo has to answer. It runs in virtual time in this process, and in wall-clock
time against ``busemu serve`` in a process of its own::

    python -m bench.soak --virtual-s 3600 --wall-s 600
"""

from __future__ import annotations

import argparse
import contextlib
import math
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from busemu.control import ControlError
from busemu.tables import Robot, load_robot
from hal.bus_client import BusClient
from hal.bus_errors import BusError, PortError, PortLostError, ReplyError

from .figures.tables import aligned
from .soak_rigs import Rig, VirtualRig, WallRig
from .testing import BusFaults

#: The program's cycle, and how often something befalls the bus, and all is cleared [s].
CYCLE_S, TROUBLE_EVERY_S, CLEAR_EVERY_S = 0.02, 20.0, 60.0
#: Share of the packets that each fault strikes.
SHARE = 0.005
#: So long after clearing servos have started up and late replies have gone by [s].
SETTLE_S = 1.0
#: Memory is looked at after these shares of the run; by the first, all is loaded.
MARKS = (0.2, 0.4, 0.6, 0.8, 1.0)
#: A servo that answers no ping for so long is silent [s]: on a busy machine it may be late.
PATIENCE_S = 20.0
PACKET_FAULTS = ("drop", "delay", "corrupt", "truncate", "split", "duplicate", "noise", "latency")
TROUBLES: tuple[Mapping[str, Any], ...] = (
    {"kind": "dead", "servo": 4, "for_s": 2.0},
    {"kind": "brown_out"},
    {"kind": "overload", "servo": 5},
    {"kind": "overheat", "servo": 6, "for_s": 2.0},
    {"kind": "encoder_stuck", "servo": 7, "for_s": 2.0},
    {"kind": "duplicate_id", "servo": 8, "id": 9, "for_s": 2.0},
    {"kind": "unplug", "for_s": 0.5},
)


@dataclass(slots=True)
class Findings:
    """What a run has shown."""

    bus_s: float = 0.0
    wall_s: float = 0.0
    transactions: int = 0
    lost: int = 0  #: positions that the program asked for and did not get
    struck: int = 0
    replugs: int = 0
    busy: int = 0  #: times the server was too busy to be asked for faults
    exceptions: int = 0  #: of another kind than a robot's program has to expect
    silent: int = 0  #: servos that did not answer after all was cleared
    memory_kib: list[int] = field(default_factory=list)  #: at each of :data:`MARKS`
    drift_s: float = 0.0  #: farthest that the joints were behind the bus
    drift_end_s: float = 0.0

    def rows(self, name: str) -> list[list[str]]:
        """The findings as rows of a table: what, how much."""
        return [
            [name, ""],
            ["time of the bus", f"{self.bus_s:.0f} s"],
            ["time it took", f"{self.wall_s:.0f} s"],
            ["transactions", f"{self.transactions}"],
            ["faults that struck", f"{self.struck}"],
            ["positions lost", f"{self.lost}"],
            ["times the port was opened anew", f"{self.replugs}"],
            ["times the server was too busy to be asked", f"{self.busy}"],
            ["unexpected exceptions", f"{self.exceptions}"],
            ["servos silent after clearing", f"{self.silent}"],
            [
                f"memory after {', '.join(f'{mark:.0%}' for mark in MARKS)} of it",
                f"{', '.join(map(str, self.memory_kib))} KiB",
            ],
            ["joints behind the bus, at most", f"{self.drift_s * 1e3:.3f} ms"],
            ["joints behind the bus, at the end", f"{self.drift_end_s * 1e3:.3f} ms"],
        ]


def soak(rig: Rig, robot: Robot, seconds: float, tell: Callable[[float], None]) -> Findings:
    """Run a robot's program on ``rig`` for ``seconds`` of its clock; ``tell`` has those so far."""
    found = Findings()
    begun_s, wall_s = rig.clock.now_s(), time.monotonic()
    client, ids = rig.open(), tuple(robot.by_id)
    troubles = _troubles(robot)
    trouble_s, clear_s = TROUBLE_EVERY_S / 2, CLEAR_EVERY_S
    _strike(rig.faults)
    at_s = 0.0
    while at_s < seconds:
        try:
            if at_s >= clear_s:
                clear_s += CLEAR_EVERY_S
                client, found.silent = _clear(rig, client, ids, found)
                _strike(rig.faults)
            elif at_s >= trouble_s:
                trouble_s += TROUBLE_EVERY_S
                rig.faults.add(**dict(next(troubles)))
            found.lost += _cycle(client, robot, at_s)
        except PortLostError:
            with contextlib.suppress(PortError):
                client = _anew(rig, client, found)
        except ControlError:
            found.busy += 1
        except BusError:
            pass
        except Exception:
            found.exceptions += 1
            if found.exceptions == 1:
                traceback.print_exc()
        at_s = max(at_s + CYCLE_S, rig.clock.now_s() - begun_s)
        rig.run(begun_s + at_s)
        found.memory_kib += [
            rig.memory_kib() for mark in MARKS[len(found.memory_kib) :] if at_s >= mark * seconds
        ]
        tell(at_s)
    try:
        client, found.silent = _clear(rig, client, ids, found)
    except ControlError:
        found.busy += 1
    found.transactions += client.statistics.transactions
    found.bus_s, found.wall_s = at_s, time.monotonic() - wall_s
    found.drift_s, found.drift_end_s = rig.drift_s()
    return found


def _troubles(robot: Robot) -> Iterator[Mapping[str, Any]]:
    """What befalls the bus, over and over; where a servo is not on the robot, its first one."""
    while True:
        for trouble in TROUBLES:
            missing = "servo" in trouble and trouble["servo"] not in robot.by_id
            yield {**trouble, "servo": next(iter(robot.by_id))} if missing else trouble


def _strike(faults: BusFaults) -> None:
    for kind in PACKET_FAULTS:
        faults.add(kind, probability=SHARE)
    for kind in ("drop", "corrupt", "truncate", "noise"):
        faults.add(kind, probability=SHARE, on="instruction")


def _cycle(client: BusClient, robot: Robot, at_s: float) -> int:
    """Set all goals, read all positions, and keep torque on; how many positions did not come."""
    ids = tuple(robot.by_id)
    middle = {i: robot.tables[i]["goal_position"].maximum // 2 for i in ids}
    swing = round(40 * math.sin(2 * math.pi * at_s))
    client.sync_write("goal_position", {i: middle[i] + swing for i in ids})
    lost = sum(value is None for value in client.read_all("present_position", ids).values())
    with contextlib.suppress(ReplyError):
        client.write(ids[round(at_s / CYCLE_S) % len(ids)], "torque_enable", 1)
    return lost


def _anew(rig: Rig, client: BusClient, found: Findings) -> BusClient:
    """Open the port anew; raises :class:`PortError` while it is away."""
    anew = rig.open()
    found.transactions += client.statistics.transactions
    found.replugs += 1
    return anew


def _clear(
    rig: Rig, client: BusClient, ids: tuple[int, ...], found: Findings
) -> tuple[BusClient, int]:
    """Clear all faults and ask every servo; the client, and how many servos have been silent."""
    found.struck += sum(each.struck for each in rig.faults.standing())
    rig.faults.clear()
    rig.run(rig.clock.now_s() + SETTLE_S)
    silent = found.silent
    for servo_id in ids:
        until_s = rig.clock.now_s() + PATIENCE_S
        while True:
            try:
                client.ping(servo_id)
                break
            except PortLostError:
                client = _anew(rig, client, found)
            except BusError:
                if rig.clock.now_s() > until_s:
                    silent += 1
                    break
    return client, silent


def main() -> None:
    """Soak as the command line says, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.soak", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--robot", default="marvin", help="name or file; default marvin")
    parser.add_argument("--plant", default="ideal", help="ideal (default) or bullet")
    parser.add_argument("--virtual-s", type=float, default=3600.0, help="virtual time; 0: none")
    parser.add_argument("--wall-s", type=float, default=600.0, help="wall-clock time; 0: none")
    asked = parser.parse_args()
    robot = load_robot(asked.robot)
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder, Progress(console=Console(stderr=True)) as bars:
        if asked.virtual_s:
            bar = bars.add_task("virtual time", total=asked.virtual_s)
            rig: Rig = VirtualRig(robot, asked.plant)
            found = soak(rig, robot, asked.virtual_s, lambda s: bars.update(bar, completed=s))
            rows += found.rows(f"virtual time, {robot.name}, plant {asked.plant}")
        if asked.wall_s:
            bar = bars.add_task("wall-clock time", total=asked.wall_s)
            rig = WallRig(robot, asked.plant, Path(folder))
            try:
                found = soak(rig, robot, asked.wall_s, lambda s: bars.update(bar, completed=s))
                found.exceptions += rig.said().count("Traceback")
            finally:
                rig.close()
            rows += found.rows(f"wall-clock time, {robot.name}, plant {asked.plant}")
    print(aligned(["what", "how much"], rows))


if __name__ == "__main__":
    main()
