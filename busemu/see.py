"""Commands to see the bus: ``busemu decode`` and ``busemu monitor``.

They join the command line by name; heavy parts are imported when a command runs.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cli import fail
from .tables import RobotError, TableError, load_robot, load_table, robots
from .trace import WireEventKind
from .traffic.explain import Explainer, Tables, brief, long
from .traffic.follow import Follower, read_trace
from .traffic.hextext import HexError
from .traffic.tally import Tally
from .traffic.traceline import Header, TraceError

if TYPE_CHECKING:
    from .traffic.monitor import Monitor

#: The live view is drawn once in this time [s].
DRAW_EVERY_S = 0.25
#: The live view begins with so much of what the trace has already [bytes]: a few seconds.
TAIL_BYTES = 1_000_000
#: How much a monitor steps back behind other processes, the server above all.
NICE = 5
#: Columns of a snapshot.
SNAPSHOT_WIDTH = 110


class Sender(StrEnum):
    """Whose packets they are, where Protocol 1.0 does not tell."""

    HOST = "host"
    SERVO = "servo"


RobotOption = Annotated[
    str | None,
    typer.Option(
        help=f"Name the registers of this robot's servos: {', '.join(robots())}, or a file (.toml)."
    ),
]
ModelOption = Annotated[
    str | None,
    typer.Option(help="Name the registers of this servo model, for instance XL-320 or AX-12A."),
]


def decode(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[HEX... | FILE...]",
            help="Bytes in hex, or a file: a trace, hex text, or raw bytes. Nothing, or -: the "
            "same from standard input.",
        ),
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(metavar="1|2", help="Default: each packet tells by its header."),
    ] = None,
    robot: RobotOption = None,
    model: ModelOption = None,
    sender: Annotated[
        Sender | None,
        typer.Option(
            "--from", help="Who sent it. Needed at most in Protocol 1.0, which does not tell."
        ),
    ] = None,
    brief_: Annotated[
        bool | None,
        typer.Option(
            "--brief/--long",
            help="One line a packet, or every byte. Default: brief for traces.",
            show_default=False,
        ),
    ] = None,
    only_bad: Annotated[bool, typer.Option("--bad", help="Only what is bad.")] = False,
) -> None:
    """Say in words what packets say, and what is wrong with bad ones.

        busemu decode --model XL-320 FF FF FD 00 01 07 00 02 25 00 02 00 2D 95

    Each byte is named. Of a wrong CRC or checksum it tells the value that the bytes give, and the
    mistake that leads to the other: bytes swapped, stuffing not counted, another polynomial, a
    flipped bit. A status packet is read as the answer to the instruction before it.

        busemu serve --robot marvin --trace bus.trace      (in another shell)
        busemu decode bus.trace --bad

    A trace needs no --robot: it names its own. Its columns are the time of day, the pause since
    the packet before [ms], and how much later than modelled the bytes were taken or handed over
    [ms].

    The exit code is 1 if anything was bad.
    """
    from .traffic.decoding import Shown, decode_trace, sources

    if not what and sys.stdin.isatty():
        fail("nothing to decode: give bytes in hex, a file, or pipe them in (busemu decode --help)")
    protocols = {None: None, "1": 1.0, "1.0": 1.0, "2": 2.0, "2.0": 2.0}
    if protocol not in protocols:
        fail(f"--protocol is 1 or 2, not {protocol}")
    kind = {None: None, Sender.HOST: WireEventKind.INSTRUCTION, Sender.SERVO: WireEventKind.STATUS}
    shown = Shown(only_bad)
    try:
        tables = _tables(robot, model)
        for source in sources(what or []):
            if not isinstance(source, bytes):
                decode_trace(
                    source, lambda header: tables or _tables_of(header), shown, brief_ is not False
                )
                continue
            explainer = Explainer(protocols[protocol], tables)
            for index, explanation in enumerate(explainer.explain(source, kind[sender])):
                if index and not brief_ and not only_bad:
                    shown.lines([()])
                shown.packet(explanation, brief(explanation) if brief_ else long(explanation))
    except (HexError, TraceError, RobotError, TableError) as error:
        fail(error)
    except BrokenPipeError:  # the reader, head for instance, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        fail(error)
    if shown.bad:
        raise typer.Exit(1)


def monitor(
    trace: Annotated[Path, typer.Argument(metavar="FILE", help="As in busemu serve --trace FILE.")],
    robot: RobotOption = None,
    servo: Annotated[
        int | None,
        typer.Option(help="Whose registers to show. Default: the lowest ID that was heard of."),
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="Print what the whole trace adds up to, and end.")
    ] = False,
    packets: Annotated[
        int, typer.Option(min=0, max=400, help="With --once: print so many lines of packets.")
    ] = 20,
) -> None:
    """Watch a bus: packets in words, rates, errors, registers, and how long answers take.

        busemu serve --robot marvin --link /tmp/marvin --trace /tmp/marvin.trace
        busemu monitor /tmp/marvin.trace --servo 3         (in another shell)

    It only reads the file, behind the server in priority, and goes on when the server starts
    again. Ctrl-C ends it.

    "Modelled" is from the first bit of an instruction to the last bit of its answer on the wire;
    "measured" from the server's taking the bytes to its handing the answer over, so it has the
    adapter's latency in it.
    """
    from .traffic.monitor import Monitor

    tables = _tables_or_fail(robot)
    view = Monitor(Tally(lambda header: tables or _tables_of(header)), servo)
    try:
        if once:
            _snapshot(view, trace, packets)
        else:
            _live(view, trace)
    except TraceError as error:
        fail(error)
    except KeyboardInterrupt:
        raise typer.Exit(0) from None


def _snapshot(view: Monitor, path: Path, packets: int) -> None:
    from rich.console import Console

    for entry in read_trace(path):
        if entry is not None:
            view.add(view.tally.take(entry))
    console = Console(width=SNAPSHOT_WIDTH, color_system=None, highlight=False)
    console.print(view.snapshot(view.tally.now_s, packets), crop=False)


def _live(view: Monitor, path: Path) -> None:
    from rich.console import Console
    from rich.live import Live

    os.nice(NICE)
    console = Console()
    follower = Follower(path, TAIL_BYTES)
    heard_s = time.monotonic()
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            began_s = time.monotonic()
            starts = view.tally.starts
            while entries := follower.poll():
                for entry in entries:
                    view.add(view.tally.take(entry))
                heard_s = time.monotonic()
                if view.tally.starts != starts:
                    starts = view.tally.starts
                    if starts > 1:
                        view.say("-- the server has started again --")
                if heard_s - began_s > DRAW_EVERY_S:
                    break
            now_s = view.tally.now_s + time.monotonic() - heard_s
            live.update(view.screen(now_s, console.width, console.height), refresh=True)
            time.sleep(max(0.05, DRAW_EVERY_S - (time.monotonic() - began_s)))


def _tables(robot: str | None, model: str | None) -> Tables | None:
    """The control tables that the options ask for; None where they do not."""
    if robot is None and model is None:
        return None
    by_id = load_robot(robot).tables if robot is not None else {}
    return Tables(by_id, load_table(model) if model is not None else None)


def _tables_or_fail(robot: str | None) -> Tables | None:
    try:
        return _tables(robot, None)
    except (RobotError, TableError) as error:
        fail(error)


def _tables_of(header: Header) -> Tables:
    """The control tables of the robot that a trace names; none if it is not to be found."""
    for name in (header.file, header.robot):
        with contextlib.suppress(RobotError, TableError):
            return Tables(load_robot(name).tables)
    return Tables()
