"""Transactions that tell the parts of a bus's time apart, and a prober that times them.

Everything goes through the official SDK, on a real port, on an emulated one, or in process in
virtual time, where the times are those of the model. Nothing moves: what is written is a register
that no joint follows, with the value that is there.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from busemu.assemble import assemble
from busemu.bus import Bus
from busemu.clock import Clock, MonotonicClock, VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.tables import ControlTable, Register, Robot
from busemu.timing import Profile
from hal.bus_client import STATUS_OVERHEAD, BusClient, open_port
from hal.bus_errors import NoReplyError
from hal.port import Port

Floats = NDArray[np.float64]

#: Lengths of data that are read from one servo [byte].
READ_BYTES = (1, 2, 4, 8, 16, 32, 48, 96)
LONGEST = max(READ_BYTES)
#: Numbers of servos that are read with one sync_read; all of them come on top.
SYNC_SERVOS = (1, 2, 3, 4, 6, 8, 11, 14, 18, 24, 32)
#: Bytes that an FTDI adapter hands up without waiting for its timer. Source: FTDI AN232B-04.
CHUNK_BYTES = 62
#: Registers that may be written as they are, nothing following them, in order of preference.
STILL_REGISTERS = ("moving_speed", "profile_velocity", "punch", "led")
#: After a packet that nobody answers the line is left alone for so long beyond it [s].
REST_S = 0.003


class Kind(enum.Enum):
    """What a probe does."""

    HAND_OVER = "sync_write, until the program goes on"
    PING = "ping"
    READ = "read"
    WRITE = "write"
    SYNC_READ = "sync_read"
    QUEUED_READ = "read right behind a sync_write"
    READ_EACH = "reads, one after another"
    CYCLE = "control cycle"


@dataclass(frozen=True, slots=True)
class Probe:
    """One kind of transaction. ``servos``: how many are read or, in a sync_write, written."""

    kind: Kind
    servos: int = 1
    data_bytes: int = 0

    @property
    def what(self) -> str:
        """The transaction in words."""
        if self.kind is Kind.CYCLE:
            return f"control cycle: write and read {self.servos} servos"
        if self.kind is Kind.PING:
            return "ping"
        if self.kind is Kind.HAND_OVER:
            return f"sync_write of {self.servos} x {self.data_bytes} B, until the program goes on"
        if self.kind is Kind.QUEUED_READ:
            return f"sync_write of {self.servos} x {self.data_bytes} B, then a read of 2 B"
        if self.kind is Kind.READ_EACH:
            return f"{self.servos} reads of {self.data_bytes} B, one after another"
        times = f"{self.servos} x " if self.kind is Kind.SYNC_READ else ""
        return f"{self.kind.value} of {times}{self.data_bytes} B"


@dataclass(frozen=True, slots=True)
class Condition:
    """What the servos and the line are set to: the baud rate [bit/s] and, in the order of the
    robot's servos, the raw values of ``return_delay_time``.
    """  # noqa: D205 - one sentence

    baud_rate: int
    return_delays: tuple[int, ...]

    @property
    def return_delay(self) -> str:
        """The return delays in words: one number where all are the same."""
        if len(set(self.return_delays)) == 1:
            return str(self.return_delays[0])
        return "mixed"


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """How long a probe took under a condition [s], shape (repeats,)."""

    probe: Probe
    condition: Condition
    times_s: Floats

    @property
    def median_s(self) -> float:
        """The median [s]."""
        return float(np.median(self.times_s))

    @property
    def span_s(self) -> tuple[float, float]:
        """The 5th and the 95th percentile [s]."""
        low, high = np.percentile(self.times_s, (5.0, 95.0))
        return float(low), float(high)

    @property
    def median_error_s(self) -> float:
        """Standard error of the median [s], from the middle half of the times."""
        low, high = np.percentile(self.times_s, (25.0, 75.0))
        return float(1.253 * (high - low) / 1.349 / np.sqrt(len(self.times_s)))


def still_register(robot: Robot) -> str:
    """A register of all servos that can be written as it is; one as long as the goal is preferred.

    Raises ``ValueError`` for servos that have none of :data:`STILL_REGISTERS` in common.
    """
    tables = list(robot.tables.values())
    common = [name for name in STILL_REGISTERS if all(name in table for table in tables)]
    if not common:
        raise ValueError(f"{robot.name}: its servos share none of {', '.join(STILL_REGISTERS)}")
    goal_bytes = tables[0]["goal_position"].size
    return next((name for name in common if tables[0][name].size == goal_bytes), common[0])


def probes_of(robot: Robot) -> list[Probe]:
    """The probes that a robot's servos can answer."""
    first = robot.tables[robot.servos[0].servo_id]
    count = len(robot.servos)
    chunk = CHUNK_BYTES - STATUS_OVERHEAD[robot.protocol]
    lengths = {n for n in (*READ_BYTES, chunk) if n <= first.size}
    lengths.add(min(first.size, LONGEST))
    numbers = sorted({n for n in SYNC_SERVOS if n < count} | {count})
    value_bytes = first[still_register(robot)].size
    position_bytes = first["present_position"].size
    probes = [Probe(Kind.HAND_OVER, count, value_bytes), Probe(Kind.PING)]
    probes += [Probe(Kind.READ, 1, length) for length in sorted(lengths)]
    probes += [Probe(Kind.WRITE, 1, value_bytes)]
    probes += [Probe(Kind.QUEUED_READ, n, value_bytes) for n in sorted({(count + 1) // 2, count})]
    if robot.protocol == 2.0:
        probes += [Probe(Kind.SYNC_READ, n, position_bytes) for n in numbers]
        probes += [Probe(Kind.SYNC_READ, count, 8)]
    else:
        probes += [Probe(Kind.READ_EACH, count, position_bytes)]
    return [*probes, Probe(Kind.CYCLE, count, position_bytes)]


class Prober:
    """Times probes on one bus. The servos are those of ``robot``.

    A prober asks the servos how they are set and what they hold, unless it is told (``condition``)
    or can see for itself (``bus``).
    """

    def __init__(
        self,
        robot: Robot,
        port: Port,
        clock: Clock,
        bus: Bus | None = None,
        condition: Condition | None = None,
    ) -> None:
        self.robot = robot
        self.ids = [servo.servo_id for servo in robot.servos]
        windowed = {table.model: _windowed(table) for table in robot.tables.values()}
        tables = {servo_id: windowed[table.model] for servo_id, table in robot.tables.items()}
        self.client = BusClient(port, tables, robot.protocol, clock)
        self.clock = clock
        self.bus = bus
        self._still = still_register(robot)
        self._known = condition
        self._held: dict[int, int] = {}
        if bus is not None:
            servos = zip(self.ids, bus.servos, strict=True)
            self._held = {servo_id: servo.memory[self._still] for servo_id, servo in servos}

    def condition(self) -> Condition:
        """Ask every servo for its return delay. Raises :class:`hal.bus_errors.BusError`."""
        if self._known is not None:
            return self._known
        delays = tuple(self.client.read(i, "return_delay_time") for i in self.ids)
        return Condition(self.robot.baud_rate, delays)

    def time(
        self,
        probes: Sequence[Probe],
        repeats: int,
        progress: Callable[[], None] | None = None,
    ) -> list[Timing]:
        """Time each probe ``repeats`` times; ``progress`` is called after each probe.

        Raises :class:`hal.bus_errors.BusError` where a servo does not answer.
        """
        condition = self.condition()
        if not self._held:
            self._held = {i: self.client.read(i, self._still) for i in self.ids}
        timings = []
        for probe in probes:
            act = self._action(probe)
            times_s = np.empty(repeats)
            for index in range(repeats):
                before_s = self.clock.now_s()
                act()
                times_s[index] = self.clock.now_s() - before_s
                if probe.kind is Kind.HAND_OVER:
                    self._rest(probe)
            timings.append(Timing(probe, condition, times_s))
            if progress is not None:
                progress()
        return timings

    def _rest(self, probe: Probe) -> None:
        """Wait until a sync_write is over on the wire."""
        sent_bytes = 16 + probe.servos * (1 + probe.data_bytes)
        rest_s = REST_S + sent_bytes * 10 / self.robot.baud_rate
        self.clock.sleep_until(self.clock.now_s() + rest_s)

    def _action(self, probe: Probe) -> Callable[[], object]:
        client, one, ids = self.client, self.ids[0], self.ids[: probe.servos]
        window = _window(probe.data_bytes)
        held = {i: self._held[i] for i in ids}

        def queued_read() -> None:
            client.sync_write(self._still, held)
            client.read(one, _window(2))

        def cycle() -> None:
            client.sync_write(self._still, held)
            self._read_all(ids, window)

        actions: dict[Kind, Callable[[], object]] = {
            Kind.HAND_OVER: lambda: client.sync_write(self._still, held),
            Kind.PING: lambda: client.ping(one),
            Kind.READ: lambda: client.read(one, window),
            Kind.WRITE: lambda: client.write(one, self._still, held[one]),
            Kind.SYNC_READ: lambda: self._read_all(ids, window),
            Kind.QUEUED_READ: queued_read,
            Kind.READ_EACH: lambda: self._read_all(ids, window),
            Kind.CYCLE: cycle,
        }
        return actions[probe.kind]

    def _read_all(self, ids: Sequence[int], window: str) -> None:
        for servo_id, value in self.client.read_all(window, ids).items():
            if value is None:
                raise NoReplyError(servo_id, "no good status packet: check cable, ID and noise")


def _window(length: int) -> str:
    return f"bytes_0_to_{length}"


def _windowed(table: ControlTable) -> ControlTable:
    """``table`` with its first bytes, in every length probed, as registers that can be read."""
    return replace(table, registers=(*table.registers, *_windows(min(table.size, LONGEST))))


@lru_cache
def _windows(longest: int) -> tuple[Register, ...]:
    return tuple(Register(_window(n), 0, n, access="R") for n in range(1, longest + 1))


@contextmanager
def prober_on_port(robot: Robot, path: str) -> Iterator[Prober]:
    """A prober on a serial port, in wall-clock time. Raises :class:`hal.bus_errors.PortError`."""
    port = open_port(path, robot.baud_rate)
    try:
        yield Prober(robot, port, MonotonicClock())
    finally:
        port.closePort()


def prober_in_process(
    robot: Robot, profile: Profile, condition: Condition | None = None, *, fixed: bool = False
) -> Prober:
    """A prober of the model, in virtual time; the servos set to ``condition`` if it is given.

    With ``fixed``, nobody will change the condition, and it need not be asked for.
    """
    if condition is not None:
        servos = tuple(
            replace(servo, registers={**servo.registers, "return_delay_time": delay})
            for servo, delay in zip(robot.servos, condition.return_delays, strict=True)
        )
        robot = replace(robot, baud_rate=condition.baud_rate, servos=servos)
    known = condition if fixed else None
    clock = VirtualClock()
    bus = assemble(robot, ideal(robot), profile)
    return Prober(robot, SdkPort(bus, clock), clock, bus, known)
