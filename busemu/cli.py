"""The command line. Packages above the bus add their commands by name (``busemu.commands``)."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
from importlib.metadata import entry_points, version
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import typer

from .faults import FaultError
from .observe import ObservationError
from .ports.device import DeviceError
from .ports.pty import LinkError
from .ports.tcp import TcpError
from .serve import prepare_process, serve
from .serving import ServingError, Teller, Wanted, each, opened
from .state import StateError
from .tables import (
    RobotError,
    TableError,
    load_table,
    models,
    robots,
    table_markdown,
)
from .timing import ProfileError, profiles
from .traffic.traceline import TraceError

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
    StateError,
    ServingError,
    FaultError,
)

#: The system's errors when a disk, or what is behind the standard output, takes no more.
NOT_TAKEN = (errno.ENOSPC, errno.EDQUOT, errno.EIO)

#: Packages of this project: one of them that cannot be found is no extra that is left out.
OWN = ("busemu", "hal", "sim", "bench")

app = typer.Typer(
    name="busemu",
    help="A servo bus you can trust without the servos: Dynamixel over a virtual serial port, "
    "with the real bus's timing and simulated joints behind it.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_show_locals=False,
)


def fail(message: object) -> NoReturn:
    """End the program with one line that says what is wrong and what to do.

    Of the system's errors about a file that is its name and what the system says.
    """
    _say(message)
    raise typer.Exit(1)


def _say(message: object) -> None:
    if isinstance(message, OSError) and message.strerror:
        if message.filename is not None:
            message = f"{message.filename}: {message.strerror}"
        elif message.errno in NOT_TAKEN:
            message = f"what it writes is not taken: {message.strerror}"
    typer.secho(f"busemu: {message}", fg=typer.colors.RED, err=True)


@app.callback(invoke_without_command=True)
def _root(
    show_version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.")
    ] = False,
) -> None:
    if show_version:
        typer.echo(version("busemu"))
        raise typer.Exit
    _end_by_interrupt()


@app.command("serve")
def serve_command(
    robot: Annotated[
        list[str],
        typer.Option(
            help=f"One of {', '.join(robots())}, the path of a robot file (.toml), or "
            "servos of a model, such as XM430-W350:1-3,7@57600. Several: one bus each."
        ),
    ],
    timing: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Timing profile: one of {', '.join(profiles())}, or a file (.toml). "
            "Default: the one the robot file names."
        ),
    ] = None,
    plant: Annotated[
        list[str] | None,
        typer.Option(
            help="What moves the joints: bullet (physics; the default, where the robot file "
            "describes bodies) or ideal (first order)."
        ),
    ] = None,
    link: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH", help="Keep a symlink of this name to the port while serving."),
    ] = None,
    tcp: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Listen there instead, for raw bytes: 127.0.0.1:4000 for this machine only.",
        ),
    ] = None,
    device: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH",
            help="Be the servos on this real serial port instead: wire it to a control board.",
        ),
    ] = None,
    echo: Annotated[
        bool,
        typer.Option(
            "--echo",
            help="Give the host its own bytes back, as an adapter does that hears itself.",
        ),
    ] = False,
    state: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="Keep the servos' EEPROM in this file (.toml), from one start to the next.",
        ),
    ] = None,
    world: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="What is around the robot, with --plant bullet: slopes, steps, soft or slippery "
            "ground, a payload, pushes (.toml, see sim/scene.py).",
        ),
    ] = None,
    observe: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE", help="Write what an observer beside the robot sees (.csv with .toml)."
        ),
    ] = None,
    trace: Annotated[
        list[str] | None,
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
    faults: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="Let things go wrong as this scenario says (.toml); on a running server: "
            "busemu fault --help.",
        ),
    ] = None,
) -> None:
    """Open a virtual serial port and be the robot's servos on it, until Ctrl-C.

    Then, in another shell, point any Dynamixel program at the port it prints, for instance

        busemu walk --robot marvin --port /dev/pts/3

    Servos of your own need no file: three XM430-W350 as from the factory, or at another baud rate:

        busemu serve --robot XM430-W350:1-3 --link /tmp/servos

        busemu serve --robot XM430-W350:1-3@1000000 --link /tmp/servos

    Over a network, with --tcp: one client at a time, at the robot's baud rate; with pyserial,
    serial_for_url("socket://HOST:PORT").

    On a real line, with --device: the adapter's data line goes to the board's servo connector,
    ground to ground. Wire and USB then take their own time, so only the servos' times are modelled.

    Several buses, each with its own port, joints and clock: give --robot several times, and the
    other options as often and in the same order ("-" leaves a robot out); --timing and --plant may
    be given once for all.

        busemu serve --robot marvin --link /tmp/a --robot phantomx --link /tmp/b
    """
    try:
        count = len(robot)
        columns = zip(
            robot,
            each("--timing", timing, count, shared=True),
            each("--plant", plant, count, shared=True),
            each("--link", link, count),
            each("--tcp", tcp, count),
            each("--device", device, count),
            each("--state", state, count),
            each("--world", world, count),
            each("--observe", observe, count),
            each("--trace", trace, count),
            each("--faults", faults, count),
            strict=True,
        )
        wanted = [
            Wanted(
                robot=name,
                timing=timing_of or None,
                plant=plant_of or None,
                link=_path(link_of),
                tcp=tcp_of or None,
                device=device_of or None,
                state=_path(state_of),
                world=_path(world_of),
                observe=_path(observe_of),
                trace=_path(trace_of),
                faults=_path(faults_of),
                trace_size=trace_size,
                echo=echo,
            )
            for (
                name,
                timing_of,
                plant_of,
                link_of,
                tcp_of,
                device_of,
                state_of,
                world_of,
                observe_of,
                trace_of,
                faults_of,
            ) in columns
        ]
        with opened(wanted) as buses:
            for one in buses:
                one.make_joints()
            prepare_process()
            stations = [one.assemble() for one in buses]
            for one in buses:
                for line in one.describe():
                    typer.echo(line)
            sys.stdout.flush()
            serve(*stations, tell=Teller(buses))
    except USER_ERRORS as error:
        fail(error)
    except ModuleNotFoundError as error:
        fail(f"the plant needs {error.name}: pip install 'busemu[sim]', or use --plant ideal")
    except KeyboardInterrupt:
        typer.echo("\nstopped")


def _path(value: str) -> Path | None:
    return Path(value) if value else None


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


def endings() -> tuple[signal.Signals, ...]:
    """Signals that ask a program to end.

    SIGHUP is none where it is ignored (nohup): then the program shall outlive its terminal.
    """
    asking = (signal.SIGINT, signal.SIGTERM)
    outlives = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return asking if outlives else (*asking, signal.SIGHUP)


def _end_by_interrupt() -> None:
    """Have all that ask a program to end raise ``KeyboardInterrupt``, so that all is put away.

    A shell's background jobs start with SIGINT ignored, so that has to be said as well.
    """
    for ending in endings():
        signal.signal(ending, _stop)


def _stop(signum: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line."""
    for entry in entry_points(group="busemu.commands"):
        app.command(entry.name)(entry.load())
    try:
        try:
            app()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if not missing or missing in OWN:
            raise
        _say(f"this command needs {missing}: pip install 'busemu[hal,sim,bench]'")
        sys.exit(1)
    except BrokenPipeError:  # the reader has gone, as `head` does: no news
        _write_no_more()
        sys.exit(1)
    except OSError as error:
        if error.errno not in NOT_TAKEN:
            raise
        _say(error)
        _write_no_more()
        sys.exit(1)


def _write_no_more() -> None:
    """Leave what is still buffered unwritten: the interpreter tries once more as it ends."""
    with contextlib.suppress(OSError, ValueError):  # an output that is no file, or closed
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
