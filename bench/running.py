"""Running a robot's own program: on a port in wall-clock time, or in process in virtual time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from busemu.assemble import assemble
from busemu.bus import Bus
from busemu.chance import seeded
from busemu.clock import Clock, MonotonicClock, VirtualClock
from busemu.faults import Faults
from busemu.plant import Plant, reading_of
from busemu.ports.sdk import SdkPort
from busemu.tables import Robot
from busemu.timing import Profile
from busemu.wording import amount
from hal.bus_client import BusClient, open_port
from hal.cpg import LocomotionController
from hal.robot_control import RobotControl
from hal.walk import Progress, WalkInterrupted, WalkReport, walk

from .recording import Recorder, Recording
from .recording.metadata import of_robot, source_of

#: So many things that were noticed are kept with a recording.
MOST_NOTICED = 500


@dataclass(frozen=True, slots=True)
class Steering:
    """How a robot shall walk."""

    seconds: float = 10.0
    v_left: float = 1.0
    v_right: float = 1.0
    cycle_s: float | None = None
    seed: int = 0


@dataclass(slots=True)
class Session:
    """A robot's program at a bus: the client, what it recorded, and the clock it ran by."""

    robot: Robot
    client: BusClient
    recorder: Recorder
    clock: Clock
    source: str  #: of its recording: ``real`` or ``emulator``
    bus: Bus | None = None  #: the bus itself, where it is in this process
    observed: Recorder = field(default_factory=Recorder)

    def recording(self, name: str, group: str, **condition: Any) -> Recording:
        """What the program wrote and read so far."""
        return self.recorder.recording(self.metadata(name, group, **condition))

    def metadata(self, name: str, group: str, **condition: Any) -> dict[str, Any]:
        """Metadata of a recording of what this program did, and what was noticed on the way."""
        robot, source = self.robot, self.source
        told = of_robot(robot, name=name, source=source, group=group, condition=condition)
        if events := _events(self):
            told["noticed"] = [
                {"t_s": e.t_s, "what": e.what.value, "bodies": list(e.bodies), "note": e.note}
                for e in events[:MOST_NOTICED]
            ]
        return told


@contextmanager
def on_port(robot: Robot, path: str) -> Iterator[Session]:
    """A session on a serial port: an emulated one or a real one, there is no difference."""
    clock = MonotonicClock()
    recorder = Recorder()
    port = open_port(path, robot.baud_rate)
    try:
        client = BusClient(port, robot.tables, robot.protocol, clock, recorder)
        yield Session(robot, client, recorder, clock, source_of(path))
    finally:
        port.closePort()


def in_process(
    robot: Robot, plant: Plant, profile: Profile, *, observe_every_s: float = 0.0
) -> Session:
    """A session in virtual time: the same client, the bus behind it in this process.

    With ``observe_every_s`` [s], what an observer beside the robot sees is kept as well.
    """
    clock: VirtualClock = VirtualClock()
    bus = assemble(robot, plant, profile)
    if reading_of(plant).lost_share:
        Faults(bus, robot, seeded(0))
    recorder = Recorder()
    observed = Recorder()
    if observe_every_s > 0.0:

        def look(now_s: float) -> None:
            for name, value in plant.observe().items():
                observed.observe(now_s, name, value)

        bus.every(observe_every_s, look)
    client = BusClient(SdkPort(bus, clock), robot.tables, robot.protocol, clock, recorder)
    return Session(robot, client, recorder, clock, "emulator", bus, observed)


def walk_in(
    session: Session, steering: Steering, progress: Progress | None = None
) -> tuple[WalkReport, bool]:
    """Walk; returns the report, and whether the walk came to its end (Ctrl-C ends it early)."""
    controller = LocomotionController.of(session.robot, steering.seed)
    control = RobotControl(session.robot, session.client, controller.joints)
    try:
        report = walk(
            control,
            controller,
            session.clock,
            steering.seconds,
            v_left=steering.v_left,
            v_right=steering.v_right,
            cycle_s=steering.cycle_s,
            progress=progress,
        )
    except WalkInterrupted as interrupted:
        return interrupted.report, False
    return report, True


def describe(report: WalkReport) -> list[str]:
    """A walk in words, a line a fact."""
    ms = 1e3
    lines = [
        f"{amount(report.cycles, 'cycle')} in {report.walked_s:.2f} s: "
        f"mean {report.cycle_mean_s * ms:.2f} ms, median {report.cycle_median_s * ms:.2f} ms, "
        f"longest {report.cycle_max_s * ms:.2f} ms",
        f"{amount(report.missed_deadlines, 'missed deadline')}, "
        f"{amount(report.lost_replies, 'lost reply', 'lost replies')}, "
        f"{amount(report.clipped_goals, 'goal')} clipped",
    ]
    lines += [f"{count} x {what}" for what, count in report.errors.items()]
    lines += [f"{joint}: {what}" for joint, what in report.alerts.items()]
    if report.torque_left_on:
        lines.append(f"torque may still be on: {', '.join(report.torque_left_on)}; cut the supply")
    return lines


def _events(session: Session) -> Sequence[Any]:
    """What was noticed of the robot, where its joints are in this process (``sim.watch.Event``)."""
    found: Sequence[Any] = getattr(session.bus.plant, "events", ()) if session.bus else ()
    return found


def noticed(session: Session, most: int = 8) -> list[str]:
    """Falls, self-contacts and links on the ground, where the joints are in this process."""
    events = _events(session)
    lines = [f"noticed at {event}" for event in events[:most]]
    if len(events) > most:
        lines.append(f"and {len(events) - most} more events of the kind")
    return lines
