"""The buses of one server: each with its robot, plant, port and clock, and the files beside it.

`busemu serve` turns its options into one :class:`Wanted` a bus, has each opened by :class:`Served`,
and gives their stations to the loop of :mod:`busemu.serve`.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from .assemble import assemble, plants
from .chance import seeded
from .control import Control, ControlError
from .faults import FaultError, Faults, Scenario, load_scenario
from .observe import Observation
from .plant import Plant
from .ports.device import SerialDevice
from .ports.line import UartLine, servo_side
from .ports.port import Port, plug_of
from .ports.pty import PtyPort
from .ports.tcp import TcpPort
from .serve import ServerState, Station
from .state import State, StateError
from .tables import Robot, load_robot
from .timing import Profile, load_profile
from .traffic.tracing import TracedPort, Tracing
from .wording import amount

#: How often an observer looks [s]: fast enough for pictures of a gait.
OBSERVE_EVERY_S = 0.02
#: So many things that were noticed are told at once at most.
MOST_NOTICED = 8
#: What a value of an option says that one bus shall do without.
NONE = "-"


class ServingError(ValueError):
    """Options that cannot be served: says which and what to do."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """One bus as the options ask for it; what is ``None`` is not wanted."""

    robot: str
    timing: str | None = None
    plant: str | None = None  #: by default bullet for a robot with bodies, else ideal
    link: Path | None = None
    tcp: str | None = None
    device: str | None = None
    state: Path | None = None
    observe: Path | None = None
    trace: Path | None = None
    trace_size: float = 64.0
    faults: Path | None = None
    world: Path | None = None
    echo: bool = False


def each(name: str, values: Sequence[str] | None, count: int, *, shared: bool = False) -> list[str]:
    """The value of an option for each of ``count`` buses; empty where a bus does without.

    Given once a robot, in the same order; a ``shared`` one may be given once for all. Raises
    :class:`ServingError`.
    """
    given = ["" if value == NONE else value for value in values or ()]
    if not given:
        return [""] * count
    if len(given) == count:
        return given
    if shared and len(given) == 1:
        return given * count
    rest = ", or once for all" if shared else f"; {name} {NONE} leaves a robot out"
    raise ServingError(
        f"{name} is given {amount(len(given), 'time')} and --robot {amount(count, 'time')}: "
        f"give it once a robot, in the same order{rest}"
    )


class Served:
    """One bus, opened: its port is there from the beginning, the rest with :meth:`assemble`.

    Raises the errors of its parts, which are the user's to mend.
    """

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.robot = load_robot(wanted.robot)
        self.profile = _profile(wanted, self.robot)
        self.plant = wanted.plant or ("bullet" if self.robot.has_bodies else "ideal")
        if self.plant not in plants():
            raise ServingError(f"no plant named {self.plant!r}: use one of {', '.join(plants())}")
        if self.plant == "bullet" and not self.robot.has_bodies:
            raise ServingError(
                f"--plant bullet: {self.robot.path} names servos and no bodies that they could "
                "move: leave --plant away, or give a robot file that describes them"
            )
        self._scenario = load_scenario(wanted.faults, self.robot) if wanted.faults else Scenario()
        self._control: Control | None = None
        self.tracing: Tracing | None = None
        self._state: State | None = None
        self._observation: Observation | None = None
        self._plant: Plant | None = None
        self._noticed = 0
        self.port = _open(wanted, self.robot)
        try:
            if wanted.trace:
                self.tracing = Tracing(
                    wanted.trace, wanted.trace_size, self.robot, self.profile.name
                )
        except BaseException:
            self.port.close()
            raise

    def make_joints(self) -> None:
        """Make the plant, which may take a while."""
        wanted = self.wanted
        self._plant = plants()[self.plant](self.robot, world=wanted.world)
        if wanted.observe is not None:
            self._observation = Observation(wanted.observe, self.robot, self._plant)

    def assemble(self) -> Station:
        """The bus, whose time begins now, as a station of the loop."""
        if self._plant is None:
            self.make_joints()
        assert self._plant is not None
        self.bus = assemble(self.robot, self._plant, self.profile, start_s=time.monotonic())
        if self.wanted.state is not None:
            self._state = State(self.wanted.state, self.robot, self.bus.servos)
        line = self.bus if self.wanted.device is None else UartLine(self.bus)
        if self.tracing is not None:
            self.tracing.join(self.bus)
        self._take_faults()
        return Station(
            TracedPort(self.port, self.tracing.log) if self.tracing else self.port,
            line,
            observe_every_s=OBSERVE_EVERY_S,
            observe=self._observation.row if self._observation else None,
            idle=self._idle,
        )

    def _take_faults(self) -> None:
        """Have the faults of the scenario, and listen for more."""
        plug = self._plug if plug_of(self.port) is not None else None
        faults = Faults(self.bus, self.robot, seeded(self._scenario.seed), plug)
        for number, fault in enumerate(self._scenario.faults, 1):
            try:
                faults.add(fault)
            except FaultError as error:
                where = f"{self.wanted.faults}: [[fault]] {number}"
                raise FaultError(f"{where}: {error}") from None
        link = self.wanted.link
        names = [self.port.path] if link is None else [os.path.abspath(link), self.port.path]
        try:
            self._control = Control(names, faults, self.robot)
        except ControlError as error:
            sys.stderr.write(f"busemu: {error}; busemu fault will not find this server\n")

    def _plug(self, plugged: bool) -> None:
        plug = plug_of(self.port)
        assert plug is not None
        plug(plugged)
        line = f"port {self.port.path} is there again" if plugged else "port unplugged"
        os.write(sys.stdout.fileno(), f"{line}\n".encode())

    def _idle(self, now_s: float) -> None:
        if self._control is not None:
            self._control.idle(now_s)
        if self.tracing is not None:
            self.tracing.idle(now_s)
        if self._state is not None and self.bus.next_reply_s() is None:
            self._save()

    def _save(self, *, closing: bool = False) -> None:
        """Keep the EEPROM, or say that the disk does not take it and go on."""
        if self._state is None:
            return
        try:
            self._state.save(again=closing)
        except StateError as error:
            goes_on = "" if closing else ", the bus goes on"
            sys.stderr.write(f"busemu: {error}; the EEPROM is not kept{goes_on}\n")

    def describe(self) -> Iterator[str]:
        """Lines for the user: what it is, where, and what to try."""
        robot, link = self.robot, self.wanted.link
        yield (
            f"{robot.name}: {amount(len(robot.servos), 'servo')}, Protocol {robot.protocol}, "
            f"{robot.baud_rate} baud; timing {self.profile.name}, plant {self.plant}"
        )
        yield f"port {self.port.path}" + (f" (also {link})" if link else "")
        if self._state is not None:
            yield from self._state.describe()
        if self.plant == "ideal" and (left_out := robot.document.get("effect")):
            effects = amount(len(left_out), "effect")
            yield f"{effects} of {robot.path.name} left out: the ideal plant has no physics"
        yield f"try: {self._suggestion()}"

    def _suggestion(self) -> str:
        if isinstance(self.port, TcpPort):
            return f'serial.serial_for_url("{self.port.path}")'
        if isinstance(self.port, SerialDevice):
            return f"the control board's program, at {self.port.baud_rate()} baud"
        where = self.wanted.link or self.port.path
        if "gait" not in self.robot.document:
            return f"busemu timing --robot {self.wanted.robot} --port {where}"
        return f"busemu walk --robot {self.wanted.robot} --port {where}"

    def noticed(self) -> list[str]:
        """Falls, self-contacts and links on the ground that have not been told of yet.

        Times are those since the plant was made, as a world's pushes are.
        """
        events = getattr(self._plant, "events", ())[self._noticed :]
        self._noticed += len(events)
        lines = [f"{self.robot.name}: noticed at {event}" for event in events[:MOST_NOTICED]]
        if len(events) > MOST_NOTICED:
            lines.append(f"and {len(events) - MOST_NOTICED} more events of the kind")
        return lines

    def close(self) -> None:
        """Give everything up; what is to be kept is on the disk afterwards."""
        if self._control is not None:
            self._control.close()
        self.port.close()
        if self.tracing is not None:
            self.tracing.close()
        if self._state is not None:
            self._save(closing=True)
            self._state.close()
        if self._observation is not None:
            self._observation.close()


def _profile(wanted: Wanted, robot: Robot) -> Profile:
    profile = load_profile(wanted.timing or robot.timing)
    if wanted.device is not None:
        if wanted.echo:
            raise ServingError("--echo is for a virtual port: on a real line the adapter decides")
        return servo_side(profile)
    return replace(profile, echo=profile.echo or wanted.echo)


def _open(wanted: Wanted, robot: Robot) -> Port:
    """The end of the wire that the options ask for."""
    ends = (("--link", wanted.link), ("--tcp", wanted.tcp), ("--device", wanted.device))
    given = [name for name, value in ends if value is not None]
    if len(given) > 1:
        raise ServingError(
            f"{' and '.join(given)} exclude each other: a bus has one end; choose one"
        )
    if wanted.tcp is not None:
        return TcpPort(wanted.tcp)
    if wanted.device is not None:
        return SerialDevice(wanted.device, robot.baud_rate, low_latency=True)
    return PtyPort(wanted.link)


@contextlib.contextmanager
def opened(wanted: Sequence[Wanted]) -> Iterator[list[Served]]:
    """All buses that are wanted, with their ports open; closed afterwards, whatever happens."""
    with contextlib.ExitStack() as stack:
        found = []
        for one in wanted:
            served = Served(one)
            stack.callback(served.close)
            found.append(served)
        yield found


@dataclass(slots=True)
class Teller:
    """Says on one line what the buses are doing; on a terminal the line renews itself.

    What was noticed of their robots stands above it, and stays.
    """

    served: Sequence[Served]
    _before: int = 0
    _told_s: float = field(default_factory=time.monotonic)

    def __call__(self, state: ServerState) -> None:
        """Tell of the time since the last call."""
        counts = [served.bus.counts for served in self.served]
        transactions = sum(count.transactions for count in counts)
        now_s = time.monotonic()
        rate = (transactions - self._before) / (now_s - self._told_s)
        self._before, self._told_s = transactions, now_s
        late = sorted(state.replies_late_s)
        replies = f"{late[len(late) // 2] * 1e6:.0f} us" if late else "none yet"
        errors = amount(sum(count.errors for count in counts), "error")
        line = (
            f"{rate:6.0f} transactions/s, {errors}, "
            f"replies late by {replies} (median), "
            f"physics behind by {state.physics_late_s * 1e3:.1f} ms at most"
        )
        start, end = ("\r\x1b[K", "") if sys.stdout.isatty() else ("", "\n")
        noticed = "".join(f"{said}\n" for served in self.served for said in served.noticed())
        os.write(sys.stdout.fileno(), f"{start}{noticed}{line}{end}".encode())
