"""``make bench``: what things cost, each against its floor, measured side by side in one run.

Figures are ratios first: the machine's own speed cancels out of them. Nothing here is asserted.
"""

from __future__ import annotations

import contextlib
import os
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from busemu.assemble import assemble
from busemu.plant import ideal
from busemu.ports.pty import PtyPort
from busemu.protocol import Framer, Instruction, InstructionPacket, StatusPacket, v1, v2
from busemu.serve import ServerState, Station, prepare_process, serve
from busemu.tables import load_robot
from busemu.timing import load_profile
from hal.bus_errors import BusError
from sim.world import BulletPlant

from . import replay_speed, rollout_speed
from .figures.tables import aligned
from .running import Steering, in_process, on_port, walk_in

Row = list[str]
US = 1e6
SMALL = 0.05  #: ratios below are shown as one over so much
#: A client reads for so long at most [s].
READ_S = 6.0
READS = "--read"  #: asks this module to be that client, of a robot on a port

ECHO = """
import os, sys, tty
master, slave = os.openpty()
tty.setraw(slave)
print(os.ttyname(slave), flush=True)
reply = bytes(int(sys.argv[1]))
while os.read(master, 4096):
    os.write(master, reply)
"""


def main() -> None:
    """Run every benchmark and print a table."""
    rows: list[Row] = []
    for name, measure in (
        ("round trip", round_trips),
        ("codec", codecs),
        ("writers", writers),
        ("rollouts", rollouts),
        ("walks", walks),
        ("punctuality", lateness),
        ("four buses", four_buses),
    ):
        print(f"measuring {name} ...", flush=True)
        rows += measure()
    print(aligned(["what", "here", "floor", "ratio", "floor is"], rows))


def _median_us(act: Callable[[], object], repeats: int) -> float:
    for _ in range(repeats // 10):
        act()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        act()
        times.append(time.perf_counter() - start)
    return statistics.median(times) * US


def _row(what: str, here: float, floor: float, unit: str, of: str) -> Row:
    ratio = here / floor
    shown = f"{ratio:.2f}" if ratio > SMALL else f"1/{1.0 / ratio:.0f}"
    return [what, f"{here:.1f} {unit}", f"{floor:.1f} {unit}", shown, of]


def round_trips() -> list[Row]:
    """Request and reply over a pty with no modelled time, against a process that only echoes."""
    rows = []
    for robot, encode in (("phantomx", v1.encode_instruction), ("marvin", v2.encode_instruction)):
        ids = bytes(range(1, 19))
        requests = {
            "ping": (InstructionPacket(1, Instruction.PING), 6 if robot != "marvin" else 14)
        }
        if robot == "marvin":
            sync = InstructionPacket(0xFE, Instruction.SYNC_READ, b"\x25\x00\x02\x00" + ids)
            requests["sync_read of 18"] = (sync, 18 * 13)
        for what, (packet, length) in requests.items():
            request = encode(packet)
            serve_command = [sys.executable, "-m", "busemu", "serve", "--robot", robot]
            here = _exchange([*serve_command, "--timing", "instant", "--plant", "ideal"],
                             request, length)  # fmt: skip
            floor = _exchange([sys.executable, "-c", ECHO, str(length)], request, length)
            rows.append(_row(f"{robot}: {what}", here, floor, "us", "pty echo by a process"))
    return rows


def _exchange(command: list[str], request: bytes, length: int) -> float:
    """Median round trip [us] with the server that ``command`` starts."""
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        path = next(word for line in server.stdout for word in line.split() if "/dev/pts" in word)
        port = PortUser(path)
        return _median_us(lambda: port.exchange(request, length), 3000)
    finally:
        server.terminate()
        server.wait()


class PortUser:
    """The least a program can do with a serial port: blocking reads and writes of bytes."""

    def __init__(self, path: str, baud_rate: int = 1_000_000) -> None:
        import serial  # noqa: PLC0415 - comes with the SDK

        self._port = serial.Serial(path, baud_rate, timeout=1.0)

    def exchange(self, request: bytes, length: int) -> None:
        """Write, then read ``length`` bytes; raises where they do not come."""
        descriptor = self._port.fileno()
        os.write(descriptor, request)
        if len(self._port.read(length)) != length:
            raise RuntimeError("the server did not answer")


@dataclass(slots=True)
class Spent:
    """Time spent in something, and how often."""

    total_s: float = 0.0
    calls: int = 0

    def watch(self, act: Callable[..., None]) -> Callable[..., None]:
        """``act``, with its time counted here."""

        def watched(*args: float) -> None:
            start = time.perf_counter()
            act(*args)
            self.total_s += time.perf_counter() - start
            self.calls += 1

        return watched


def walks() -> list[Row]:
    """A walk in virtual time: its physics, and all of it, against the engine's share in it."""
    rows = []
    for name in ("phantomx", "marvin"):
        robot = load_robot(name)
        plant = BulletPlant(robot)
        engine, joints = Spent(), Spent()
        plant.world.step_bare = engine.watch(plant.world.step_bare)  # type: ignore[method-assign]
        plant.advance = joints.watch(plant.advance)  # type: ignore[method-assign]
        session = in_process(robot, plant, load_profile(robot.timing))
        start = time.perf_counter()
        walk_in(session, Steering(10.0))
        took_s = time.perf_counter() - start
        plant.close()
        of = "stepSimulation within it"
        step, bare = joints.total_s / engine.calls * US, engine.total_s / engine.calls * US
        rows.append(_row(f"{name}: a physics step with 18 drives", step, bare, "us", of))
        walked_s = session.clock.now_s()
        rows.append(_row(f"{name}: a second of walking in virtual time", took_s / walked_s * 1e3,
                         engine.total_s / walked_s * 1e3, "ms", of))  # fmt: skip
        session = in_process(robot, ideal(robot), load_profile(robot.timing))
        start = time.perf_counter()
        walk_in(session, Steering(10.0))
        ideal_s = time.perf_counter() - start
        rows.append(_row(f"{name}: the same without an engine", ideal_s / walked_s * 1e3,
                         engine.total_s / walked_s * 1e3, "ms", of))  # fmt: skip
    return rows


def rollouts() -> list[Row]:
    """What-ifs of one joint in a batch, against the same one by one, and those of a whole robot."""
    every = [*rollout_speed.measured(), *replay_speed.measured()]
    return [_row(what, here_s * US, floor_s * US, "us", of) for what, here_s, floor_s, of in every]


def codecs() -> list[Row]:
    """Status packets from whole frames, against the SDK's parser on the same bytes.

    Once with frames that come again, as the replies of joints at rest and most instructions do, and
    once with frames that never do.
    """
    from dynamixel_sdk import PacketHandler  # noqa: PLC0415 - the floor

    rows = []
    for protocol, encode in ((1.0, v1.encode_status), (2.0, v2.encode_status)):
        sdk = PacketHandler(protocol)
        framer = Framer(protocol, role="host")

        def theirs(frame: bytes, sdk: Any = sdk, two: bool = protocol == 2.0) -> None:
            sdk.rxPacket(Frame(frame), False) if two else sdk.rxPacket(Frame(frame))

        def all_frames(seed: int, encode: Any = encode) -> list[bytes]:
            chance = random.Random(seed)
            return [encode(StatusPacket(i % 18 + 1, 0, chance.randbytes(4))) for i in range(1000)]

        floor = _each_us(theirs, [all_frames(0)] * 9)
        for what, batches in (
            ("that repeat", [all_frames(0)] * 9),
            ("that never repeat", [all_frames(1 + i) for i in range(9)]),
        ):
            here = _each_us(framer.feed, batches)
            rows.append(
                _row(f"protocol {protocol}: frames {what}", here, floor, "us", "SDK's parser")
            )
    return rows


def writers() -> list[Row]:
    """Writes of four bytes that never repeat, as frames, against the SDK's ``txPacket``.

    The SDK is given the list of numbers it wants, with the parameters in it; here the packet is
    made as well.
    """
    from dynamixel_sdk import PacketHandler  # noqa: PLC0415 - the floor

    rows = []
    for protocol, encode, about, before in (
        (1.0, v1.encode_instruction, b"\x1e", [0, 0, 1, 7, Instruction.WRITE]),
        (2.0, v2.encode_instruction, b"\x74\0", [0, 0, 0, 0, 1, 9, 0, Instruction.WRITE]),
    ):
        sdk, port = PacketHandler(protocol), Frame(b"")
        head, tail = [*map(int, before), *about], [0] * int(protocol)

        def theirs(
            data: bytes, sdk: Any = sdk, port: Any = port, head: Any = head, tail: Any = tail
        ) -> None:
            port.is_using = False
            sdk.txPacket(port, [*head, *data, *tail])

        def ours(data: bytes, encode: Any = encode, about: bytes = about) -> None:
            encode(InstructionPacket(1, Instruction.WRITE, about + data))

        chance = random.Random(1)
        batches = [[chance.randbytes(4) for _ in range(1000)] for _ in range(9)]
        here, floor = _each_us(ours, batches), _each_us(theirs, batches)
        rows.append(_row(f"protocol {protocol}: frames written", here, floor, "us", "SDK's writer"))
    return rows


class Frame:
    """A port of the SDK in which one whole frame lies ready, and which takes any."""

    is_using = False

    def __init__(self, data: bytes) -> None:
        self._data = data

    # The SDK's names are camelCase.
    # ruff: noqa: N802

    def readPort(self, length: int) -> bytes:
        """The next bytes."""
        data, self._data = self._data[:length], self._data[length:]
        return data

    def clearPort(self) -> None:
        """Nothing to clear."""

    def writePort(self, packet: list[int]) -> int:
        """All of it is taken."""
        return len(packet)

    def isPacketTimeout(self) -> bool:
        """Never: all is there."""
        return False


def _each_us(act: Callable[[bytes], object], batches: list[list[bytes]]) -> float:
    """Processor time of one call [us], so that other work does not count: median over batches."""
    times = []
    for batch in batches:
        start = time.process_time()
        for frame in batch:
            act(frame)
        times.append((time.process_time() - start) / len(batch))
    return statistics.median(times) * US


def lateness() -> list[Row]:
    """How late replies leave with physics running, against a bare sleep of the same length."""
    rows = []
    for name, reply_s in (("phantomx", 0.001), ("marvin", 0.003)):
        robot = load_robot(name)
        port = PtyPort()
        plant = BulletPlant(robot)
        prepare_process()
        bus = assemble(robot, plant, load_profile(robot.timing), start_s=time.monotonic())
        client = subprocess.Popen([sys.executable, "-m", "bench.speed", READS, name, port.path])

        def stop(state: ServerState, client: subprocess.Popen[bytes] = client) -> None:
            if client.poll() is not None:
                raise _DoneError(state)

        try:
            serve(Station(port, bus), every_s=0.2, tell=stop)
        except _DoneError as done:
            late = statistics.median(done.state.replies_late_s) * US
        finally:
            port.close()
            plant.close()
        overshoot = []
        for _ in range(500):
            due_s = time.monotonic() + reply_s
            time.sleep(reply_s)
            overshoot.append(time.monotonic() - due_s)
        floor = statistics.median(overshoot) * US
        of = f"time.sleep({reply_s * 1e3:g} ms)"
        rows.append(_row(f"{name}: lateness of replies, physics on", late, floor, "us", of))
    return rows


def four_buses() -> list[Row]:
    """Processor time that four buses of 18 servos take in a second of theirs, physics on.

    Each is read one position after another, as fast as its timing lets it. With less than a second
    one thread keeps up. Processor time, so that other work on the machine does not count.
    """
    names = ["marvin", "phantomx"] * 2
    robots = [load_robot(name) for name in names]
    plants = [BulletPlant(robot) for robot in robots]
    buses = [
        assemble(robot, plant, load_profile(robot.timing))
        for robot, plant in zip(robots, plants, strict=True)
    ]
    asked = []
    for robot in robots:
        register = robot.tables[1]["present_position"]
        width, encode = (
            (1, v1.encode_instruction) if robot.protocol == 1.0 else (2, v2.encode_instruction)
        )
        about = register.address.to_bytes(width, "little") + register.size.to_bytes(width, "little")
        asked.append(encode(InstructionPacket(1, Instruction.READ, about)))
    reads, begun_s = 0, time.process_time()
    for step in range(2000):
        now_s = (step + 1) * 1e-3
        for bus, request in zip(buses, asked, strict=True):
            bus.poll(now_s)
            bus.advance_plant(now_s)
            if bus.next_reply_s() is None and bus.line_free_s <= now_s:
                bus.receive(request, now_s)
                reads += 1
    took_s = (time.process_time() - begun_s) / 2
    for plant in plants:
        plant.close()
    what = f"4 buses of 18, {reads // 2} reads/s: a second of them"
    return [_row(what, took_s * 1e3, 1e3, "ms", "a second of one processor")]


class _DoneError(Exception):
    def __init__(self, state: ServerState) -> None:
        super().__init__("measured")
        self.state = state


def read_for_a_while(name: str, path: str) -> None:
    """Read one position after another, through the SDK, for some seconds at most."""
    robot = load_robot(name)
    with on_port(robot, path) as session:
        client = session.client
        client.on_access = None
        end_s = time.monotonic() + READ_S
        for _ in range(1500):
            if time.monotonic() > end_s:
                break
            with contextlib.suppress(BusError):  # a stall of the machine; the medians tell
                client.read(1, "present_position")


if __name__ == "__main__":
    if sys.argv[1:2] == [READS]:
        read_for_a_while(*sys.argv[2:])
    elif len(sys.argv) > 1:
        sys.exit(f"{__doc__}\nIt takes no arguments, half a minute, and a machine that is idle.")
    else:
        main()
