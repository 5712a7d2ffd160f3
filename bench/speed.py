"""``make bench``: what things cost, each against its floor, measured side by side in one run.

Figures are ratios first: the machine's own speed cancels out of them. Nothing here is asserted.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

from busemu.assemble import assemble
from busemu.plant import ideal
from busemu.ports.pty import PtyPort
from busemu.protocol import Instruction, InstructionPacket, v1, v2
from busemu.serve import ServerState, Station, prepare_process, serve
from busemu.tables import load_robot
from busemu.timing import load_profile
from hal.bus_errors import BusError
from sim.world import BulletPlant

from .figures.tables import aligned
from .running import Steering, in_process, on_port, walk_in

Row = list[str]
US = 1e6

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
        ("walks", walks),
        ("punctuality", lateness),
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
    return [what, f"{here:.1f} {unit}", f"{floor:.1f} {unit}", f"{here / floor:.2f}", of]


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


def lateness() -> list[Row]:
    """How late replies leave with physics running, against a bare sleep of the same length."""
    rows = []
    for name, reply_s in (("phantomx", 0.001), ("marvin", 0.003)):
        robot = load_robot(name)
        port = PtyPort()
        plant = BulletPlant(robot)
        prepare_process()
        bus = assemble(robot, plant, load_profile(robot.timing), start_s=time.monotonic())
        client = subprocess.Popen([sys.executable, "-m", "bench.speed", name, port.path])

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


class _DoneError(Exception):
    def __init__(self, state: ServerState) -> None:
        super().__init__("measured")
        self.state = state


def read_for_a_while(name: str, path: str) -> None:
    """Read one position after another, through the SDK."""
    robot = load_robot(name)
    with on_port(robot, path) as session:
        client = session.client
        client.on_access = None
        for _ in range(1500):
            with contextlib.suppress(BusError):  # a stall of the machine; the medians tell
                client.read(1, "present_position")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        read_for_a_while(*sys.argv[1:])
    else:
        main()
