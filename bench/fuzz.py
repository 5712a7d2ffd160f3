"""``python -m bench.fuzz``: whatever comes down the line, the bus lives, stays small, and answers.

Bytes are made from a seed: noise, half packets, false lengths, broken packets, true ones with any
content, and mutations of what was new to the bus before. New is a burst that brings an answer, a
state of the wire or a refusal that was not seen yet, so the stream works its way into the servos.
After each burst the line is quiet for a moment, and a ping to each servo has to be answered.
"""

from __future__ import annotations

import random
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress, TimeRemainingColumn

from busemu.assemble import assemble
from busemu.bus import Bus
from busemu.plant import ideal
from busemu.protocol import BROADCAST_ID, Framer, InstructionPacket, StatusPacket, v1, v2
from busemu.servo import Servo
from busemu.tables import Robot, load_table, parse_robot
from busemu.timing import load_profile
from busemu.trace import WireEvent

#: Model and timing profile of each bus that is tried; the bytes are shared out among them.
BUSES = (
    ("AX-12A", "usb2ax"),
    ("MX-64", "ideal"),
    ("XL-320", "thesis-marvin"),
    ("XM430-W350", "ftdi-1ms"),
    ("XL330-M288", "instant"),
)
IDS = (1, 2, 3)
INSTRUCTIONS = (1, 2, 3, 4, 5, 6, 8, 0x10, 0x20, 0x82, 0x83, 0x84, 0x8A, 0x92, 0x93, 0x9A)
#: What instructions of the e-manual carry word by word.
WORDS = (b"\x01DXL\x22", b"\x02ERCL", b"\x01CTRL", b"\x02CTRL", b"\xff", b"\x01", b"\x02")
#: Pieces a burst, and the longest piece that is noise [bytes].
PIECES, LONGEST = 80, 120
#: Quiet after a burst [s]: a reboot, the slots of a broadcast ping, and every timeout are over.
QUIET_S = 1.0
#: After so long a ping is answered [s]: return delay, the slowest baud rate, a latency timer.
ANSWER_S = 0.06
#: Bursts that are kept for mutation, at most.
CORPUS = 500
#: Events that may wait on a bus while a burst is under way, and bytes that may be held.
MOST_EVENTS, MOST_HELD = 500, 1031


class FuzzError(Exception):
    """Something a bus must not do; says what, and where to find it again."""


@dataclass(slots=True)
class Tally:
    """What a run has done."""

    bytes_sent: int = 0
    bursts: int = 0
    packets: int = 0
    replies: int = 0
    pings: int = 0
    fresh_buses: int = 0
    news: set[tuple[Any, ...]] = field(default_factory=set)


def small_bus(model: str) -> Robot:
    """A few servos of one model, one after the other."""
    document = {
        "format": "busemu-robot/1",
        "name": model,
        "bus": {
            "protocol": load_table(model).protocol,
            "baud_rate": 1_000_000,
            "servo_model": model,
        },
        "servo": [{"id": i, "joint": f"j{i}"} for i in IDS],
    }
    return parse_robot(document, Path(f"{model}.toml"))


class Fuzz:
    """One bus under fire."""

    def __init__(self, model: str, timing: str, seed: int, tally: Tally) -> None:
        self._chance = random.Random(f"{seed}/{model}/{timing}")
        self._robot = small_bus(model)
        self._profile = load_profile(timing)
        self._tally = tally
        self._corpus: list[bytes] = []
        self._two = self._robot.protocol == 2.0
        self._now_s = 0.0
        self._kinds: set[str] = set()
        self._bus = self._fresh()

    def _fresh(self) -> Bus:
        self._tally.fresh_buses += 1
        return assemble(
            self._robot,
            ideal(self._robot),
            self._profile,
            start_s=self._now_s,
            on_wire=self._note,
        )

    def _note(self, event: WireEvent) -> None:
        self._kinds.add(event.kind.value)

    # -- bytes -------------------------------------------------------------------------------

    def _packet(self) -> bytes:
        """A true packet of any content, which often means something."""
        chance = self._chance
        table = next(iter(self._robot.tables.values()))
        register = chance.choice(table.registers)
        address = register.address.to_bytes(2 if self._two else 1, "little")
        size = register.size.to_bytes(2 if self._two else 1, "little")
        parameters = chance.choice(
            (
                lambda: b"",
                lambda: address + size,
                lambda: address + chance.randbytes(register.size),
                lambda: address + chance.randrange(4).to_bytes(register.size, "little"),
                lambda: address + size + bytes(chance.choices(IDS, k=chance.randrange(5))),
                lambda: chance.choice(WORDS),
                lambda: chance.randbytes(chance.randrange(LONGEST)),
                lambda: b"\xff\xff\xfd" * chance.randrange(1, 20),
            )
        )()
        servo_id = chance.choice((*IDS, *IDS, 9, BROADCAST_ID, BROADCAST_ID))
        return self._encode(InstructionPacket(servo_id, chance.choice(INSTRUCTIONS), parameters))

    def _encode(self, packet: InstructionPacket) -> bytes:
        return v2.encode_instruction(packet) if self._two else v1.encode_instruction(packet)

    def _piece(self) -> bytes:
        chance = self._chance
        packet = bytearray(self._packet())
        kind = chance.randrange(10)
        if kind == 0:
            return chance.randbytes(chance.randrange(1, LONGEST))
        if kind == 1:
            return bytes(chance.choices(b"\xff\xff\xfd\x00\xfe\x01\x55", k=chance.randrange(1, 60)))
        if kind == 2:
            return bytes(packet[: chance.randrange(1, len(packet))])
        if kind == 3:
            packet[chance.randrange(len(packet))] = chance.randrange(256)
        if kind == 4:
            packet[5 if self._two else 3] = chance.randrange(256)
        return bytes(packet)

    def _burst(self) -> bytes:
        chance = self._chance
        if self._corpus and chance.random() < 0.4:
            data = bytearray(chance.choice(self._corpus))
            for _ in range(chance.randrange(1, 5)):
                at = chance.randrange(len(data))
                change = chance.randrange(3)
                if change == 0:
                    data[at] ^= 1 << chance.randrange(8)
                elif change == 1:
                    data[at:at] = self._piece()
                else:
                    del data[at : at + chance.randrange(1, 30)]
            return bytes(data)[: PIECES * LONGEST]
        return b"".join(self._piece() for _ in range(chance.randrange(1, PIECES)))

    # -- what the bus makes of them -------------------------------------------------------------

    def step(self) -> None:
        """One burst, in portions, and then pings. Raises :class:`FuzzError`."""
        data = self._burst()
        if not data:
            return
        try:
            self._fire(data)
            self._ping_all()
        except FuzzError as error:
            raise FuzzError(f"{self._robot.name}: {error}; burst {data.hex()}") from None
        except Exception as error:
            raise FuzzError(
                f"{self._robot.name}: {type(error).__name__}: {error}; burst {data.hex()}"
            ) from error

    def _fire(self, data: bytes) -> None:
        chance, bus, tally = self._chance, self._bus, self._tally
        counts = bus.counts
        before = (counts.transactions, counts.replies)
        self._kinds.clear()
        answer = bytearray()
        at = 0
        while at < len(data):
            end = at + chance.choice((1, 3, 20, 200))
            answer += bus.poll(self._now_s)
            bus.receive(data[at:end], self._now_s)
            at = end
            # The driver of a real port stops a program that is ahead of the wire.
            pause_s = chance.choice((0.0, 0.0, 1e-4, 2e-3, 0.12))
            self._now_s = max(self._now_s + pause_s, bus.line_free_s)
            if len(bus.agenda) > MOST_EVENTS or bus.hearing.held > MOST_HELD:
                raise FuzzError(f"{len(bus.agenda)} events, {bus.hearing.held} bytes held")
        self._now_s += QUIET_S
        answer += bus.poll(self._now_s)
        tally.bytes_sent += len(data)
        tally.bursts += 1
        tally.packets += counts.transactions - before[0]
        tally.replies += counts.replies - before[1]
        if self._is_new(bytes(answer)):
            self._corpus.append(data)
            if len(self._corpus) > CORPUS:
                del self._corpus[chance.randrange(CORPUS)]

    def _is_new(self, answer: bytes) -> bool:
        news = self._tally.news
        before = len(news)
        model = self._robot.name
        for packet in Framer(self._robot.protocol, role="host").feed(answer):
            if isinstance(packet, StatusPacket):
                news.add((model, packet.error, len(packet.parameters)))
        news.update((model, kind) for kind in self._kinds)
        for servo in self._bus.servos:
            memory = servo.memory
            news.add((model, "baud", memory["baud_rate"]))
            news.add((model, "level", memory["status_return_level"]))
            news.add((model, "torque", memory["torque_enable"], bool(servo.protection.alarms)))
        return len(news) > before

    def _ping_all(self) -> None:
        """Each servo that nobody shares an ID with answers a ping at its baud rate."""
        bus = self._bus
        ids = [servo.servo_id for servo in bus.servos]
        alone = [servo for servo in bus.servos if ids.count(servo.servo_id) == 1]
        for servo in alone:
            self._ping(servo)
        if len(alone) < 2:
            self._bus = self._fresh()
            self._bus.poll(self._now_s)
        else:
            bus.baud_rate = self._chance.choice(alone).baud_rate

    def _ping(self, servo: Servo) -> None:
        bus = self._bus
        bus.baud_rate = servo.baud_rate
        bus.receive(b"\x00", self._now_s)  # ends whatever was held
        self._now_s += 0.11  # longer than the pause that ends a packet
        bus.poll(self._now_s)
        bus.receive(self._encode(InstructionPacket(servo.servo_id, 1)), self._now_s)
        self._now_s += ANSWER_S
        found = Framer(self._robot.protocol, role="host").feed(bus.poll(self._now_s))
        self._tally.pings += 1
        packets = [packet for packet in found if isinstance(packet, StatusPacket)]
        if [packet.servo_id for packet in packets] != [servo.servo_id]:
            raise FuzzError(f"servo {servo.servo_id} answers a ping with {found}")


def run(count: int, seed: int, tell: Callable[[int], object] = lambda done: None) -> Tally:
    """Send ``count`` bytes, made from ``seed``. Raises :class:`FuzzError`."""
    tally = Tally()
    fuzzes = [Fuzz(model, timing, seed, tally) for model, timing in BUSES]
    while tally.bytes_sent < count:
        for fuzz in fuzzes:
            fuzz.step()
        tell(tally.bytes_sent)
    return tally


def _memory_mb() -> float:
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


def main(
    count: Annotated[
        int, typer.Option("--bytes", min=1, help="How many bytes to send in all.")
    ] = 10_000_000,
    seed: Annotated[
        int | None, typer.Option(help="Where the bytes come from; by default any, and printed.")
    ] = None,
) -> None:
    """Send hostile bytes through buses of all kinds; ends with 1 at the first thing wrong.

    Run it again with the seed it prints to see the same.
    """
    seed = random.SystemRandom().randrange(1 << 32) if seed is None else seed
    typer.echo(f"seed {seed}")
    begun_s, half_mb = time.monotonic(), 0.0
    with Progress(
        *Progress.get_default_columns()[:3], TimeRemainingColumn(), disable=not sys.stderr.isatty()
    ) as progress:
        task = progress.add_task("bytes", total=count)

        def tell(done: int) -> None:
            nonlocal half_mb
            progress.update(task, completed=done)
            if not half_mb and done >= count / 2:
                half_mb = _memory_mb()

        try:
            tally = run(count, seed, tell)
        except FuzzError as error:
            typer.echo(f"seed {seed}: {error}", err=True)
            raise typer.Exit(1) from error.__cause__
    took_s = time.monotonic() - begun_s
    typer.echo(
        f"{tally.bytes_sent} bytes in {tally.bursts} bursts, {took_s:.0f} s: "
        f"{tally.packets} packets, {tally.replies} replies, {len(tally.news)} things new; "
        f"{tally.pings} pings, all answered; {tally.fresh_buses - len(BUSES)} buses begun afresh\n"
        f"memory {half_mb:.1f} MB at half of it, {_memory_mb():.1f} MB at the end; no exception"
    )


if __name__ == "__main__":
    typer.run(main)
