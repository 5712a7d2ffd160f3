"""The command line. Packages above the bus add their commands by name (``busemu.commands``)."""

from __future__ import annotations

import os
import signal
import sys
import time
from importlib.metadata import entry_points, version
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import typer

from .assemble import assemble, plants
from .observe import Observation, ObservationError
from .ports.device import DeviceError, SerialDevice
from .ports.line import UartLine, servo_side
from .ports.port import Port
from .ports.pty import LinkError, PtyPort
from .ports.tcp import TcpError, TcpPort
from .serve import ServerState, prepare_process, serve
from .tables import (
    Robot,
    RobotError,
    TableError,
    load_robot,
    load_table,
    models,
    robots,
    table_markdown,
)
from .timing import ProfileError, load_profile, profiles
from .traceline import TraceError
from .tracing import TracedPort, Tracing

#: How often an observer looks [s]: fast enough for pictures of a gait.
OBSERVE_EVERY_S = 0.02

#: Errors that are the user's to mend: one line, exit code 1.
USER_ERRORS = (
    RobotError,
    TableError,
    ProfileError,
    LinkError,
    TcpError,
    DeviceError,
    ObservationError,
    TraceError,
)

app = typer.Typer(
    name="busemu",
    help="A servo bus you can trust without the servos: Dynamixel over a virtual serial port, "
    "with the real bus's timing and simulated joints behind it.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_show_locals=False,
)


def fail(message: object) -> NoReturn:
    """End the program with one line that says what is wrong and what to do."""
    typer.secho(f"busemu: {message}", fg=typer.colors.RED, err=True)
    raise typer.Exit(1)


@app.callback(invoke_without_command=True)
def _root(
    show_version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.")
    ] = False,
) -> None:
    if show_version:
        typer.echo(version("busemu"))
        raise typer.Exit


@app.command("serve")
def serve_command(
    robot: Annotated[
        str,
        typer.Option(help=f"One of {', '.join(robots())}, or the path of a robot file (.toml)."),
    ],
    timing: Annotated[
        str | None,
        typer.Option(
            help=f"Timing profile: one of {', '.join(profiles())}, or a file (.toml). "
            "Default: the one the robot file names."
        ),
    ] = None,
    plant: Annotated[
        str,
        typer.Option(help="What moves the joints: bullet (physics) or ideal (first order)."),
    ] = "bullet",
    link: Annotated[
        Path | None, typer.Option(help="Keep a symlink of this name to the port while serving.")
    ] = None,
    tcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Listen there instead, for raw bytes: 127.0.0.1:4000 for this machine only.",
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="PATH",
            help="Be the servos on this real serial port instead: wire it to a control board.",
        ),
    ] = None,
    observe: Annotated[
        Path | None,
        typer.Option(help="Write what an observer beside the robot sees (.csv with .toml)."),
    ] = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write all that goes over the wire, with modelled and measured times: "
            "see busemu monitor FILE and busemu decode FILE.",
        ),
    ] = None,
    trace_size: Annotated[
        float,
        typer.Option(metavar="MB", help="FILE and FILE.1, the older half, take no more than this."),
    ] = 64.0,
) -> None:
    """Open a virtual serial port and be the robot's servos on it, until Ctrl-C.

    Then, in another shell, point any Dynamixel program at the port it prints, for instance

        busemu walk --robot marvin --port /dev/pts/3

    Over a network, with --tcp: one client at a time, at the robot's baud rate; with pyserial,
    serial_for_url("socket://HOST:PORT").

    On a real line, with --device: the adapter's data line goes to the board's servo connector,
    ground to ground. Wire and USB then take their own time, so only the servos' times are modelled.
    """
    end_by_interrupt()
    try:
        described = load_robot(robot)
        profile = load_profile(timing or described.timing)
        makers = plants()
        if plant not in makers:
            fail(f"no plant named {plant!r}: use one of {', '.join(makers)}")
        tracing = Tracing(trace, trace_size, described, profile.name) if trace else None
        port = _open(described, link, tcp, device)
    except USER_ERRORS as error:
        fail(error)
    observation = None
    try:
        joints = makers[plant](described)
        if observe is not None:
            observation = Observation(observe, described, joints)
        prepare_process()
        if device is not None:
            profile = servo_side(profile)
        bus = assemble(described, joints, profile, start_s=time.monotonic())
        typer.echo(
            f"{described.name}: {len(bus.servos)} servos, Protocol {described.protocol}, "
            f"{described.baud_rate} baud; timing {profile.name}, plant {plant}"
        )
        typer.echo(f"port {port.path}" + (f" (also {link})" if link else ""))
        typer.echo(f"try: {_suggestion(robot, port, link)}")
        sys.stdout.flush()
        line = bus if device is None else UartLine(bus)
        if tracing is not None:
            tracing.join(bus)
        serve(
            TracedPort(port, tracing.log) if tracing else port,
            line,
            tell=_Teller(bus),
            observe=observation.row if observation else None,
            observe_every_s=OBSERVE_EVERY_S,
            idle=tracing.idle if tracing else None,
        )
    except USER_ERRORS as error:
        fail(error)
    except ModuleNotFoundError as error:
        fail(f"plant {plant!r} needs {error.name}: pip install 'busemu[sim]', or use --plant ideal")
    except KeyboardInterrupt:
        typer.echo("\nstopped")
    finally:
        port.close()
        if tracing is not None:
            tracing.close()
        if observation is not None:
            observation.close()


def _open(robot: Robot, link: Path | None, tcp: str | None, device: str | None) -> Port:
    """The end of the wire that the options ask for; raises one of ``USER_ERRORS``."""
    given = [
        name
        for name, value in (("--link", link), ("--tcp", tcp), ("--device", device))
        if value is not None
    ]
    if len(given) > 1:
        fail(f"{' and '.join(given)} exclude each other: a bus has one end; choose one")
    if tcp is not None:
        return TcpPort(tcp)
    if device is not None:
        return SerialDevice(device, robot.baud_rate, low_latency=True)
    return PtyPort(link)


def _suggestion(robot: str, port: Port, link: Path | None) -> str:
    if isinstance(port, TcpPort):
        return f'serial.serial_for_url("{port.path}")'
    if isinstance(port, SerialDevice):
        return f"the control board's program, at {port.baud_rate()} baud"
    return f"busemu walk --robot {robot} --port {link or port.path}"


@app.command("tables")
def tables_command(
    model: Annotated[
        str | None,
        typer.Argument(help="A servo model (XM430-W350) or the path of a table (.toml)."),
    ] = None,
) -> None:
    """Print the control table of a servo model as Markdown, or the list of models."""
    if model is None:
        typer.echo("\n".join(models()))
        return
    try:
        typer.echo(table_markdown(load_table(model)), nl=False)
    except TableError as error:
        fail(error)


def end_by_interrupt() -> None:
    """Have SIGINT, SIGTERM and SIGHUP all raise ``KeyboardInterrupt``.

    A shell's background jobs start with SIGINT ignored, so that has to be said as well.
    """
    for ending in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, _stop)


def _stop(signum: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class _Teller:
    """Says on one line what the bus is doing; on a terminal the line renews itself."""

    def __init__(self, bus: object) -> None:
        self._bus = bus
        self._before = 0
        self._told_s = time.monotonic()
        self._start, self._end = ("\r\x1b[K", "") if sys.stdout.isatty() else ("", "\n")

    def __call__(self, state: ServerState) -> None:
        counts = self._bus.counts  # type: ignore[attr-defined]
        now_s = time.monotonic()
        rate = (counts.transactions - self._before) / (now_s - self._told_s)
        self._before, self._told_s = counts.transactions, now_s
        late = sorted(state.replies_late_s)
        replies = f"{late[len(late) // 2] * 1e6:.0f} us" if late else "none yet"
        line = (
            f"{rate:6.0f} transactions/s, {counts.errors} errors, "
            f"replies late by {replies} (median), "
            f"physics behind by {state.physics_late_s * 1e3:.1f} ms at most"
        )
        os.write(sys.stdout.fileno(), f"{self._start}{line}{self._end}".encode())


def main() -> None:
    """Run the command line."""
    for entry in entry_points(group="busemu.commands"):
        app.command(entry.name)(entry.load())
    app()
