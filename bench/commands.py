"""Commands of the bench for the ``busemu`` command line. Heavy parts are imported when needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from busemu.cli import fail
from busemu.tables import RobotError, TableError, load_robot, robots

RobotOption = Annotated[
    str, typer.Option(help=f"One of {', '.join(robots())}, or the path of a robot file (.toml).")
]


def walk(  # noqa: PLR0917 - a command line
    robot: RobotOption,
    port: Annotated[
        str | None,
        typer.Option(help="Serial port: /dev/pts/N, /dev/ttyUSB0, or a link to either."),
    ] = None,
    virtual: Annotated[
        bool,
        typer.Option("--virtual", help="No port: an emulated bus in this process, virtual time."),
    ] = False,
    plant: Annotated[
        str, typer.Option(help="With --virtual: what moves the joints, bullet or ideal.")
    ] = "bullet",
    seconds: Annotated[float, typer.Option(help="How long to walk, after standing up.")] = 10.0,
    v_left: Annotated[
        float, typer.Option(help="Stride of the left legs; 1 is the normal one.")
    ] = 1.0,
    v_right: Annotated[
        float, typer.Option(help="Stride of the right legs; unequal strides turn the robot.")
    ] = 1.0,
    cycle_ms: Annotated[
        float | None,
        typer.Option(
            help="Period of the control cycle; 0: as fast as the bus allows. "
            "Default: the robot file's."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Start state of the pattern generators.")] = 0,
    record: Annotated[
        Path | None, typer.Option(help="Write a recording: NAME.parquet, or NAME.csv with .toml.")
    ] = None,
) -> None:
    """Let the robot's own program walk it: stand up, walk, torque off.

    The same command drives an emulated bus and a real one:

        busemu walk --robot marvin --port /dev/ttyUSB0

    Ctrl-C stops and switches the torque off.
    """
    from rich.progress import Progress  # noqa: PLC0415

    from hal.bus_errors import BusError  # noqa: PLC0415
    from hal.legs import UnreachableError  # noqa: PLC0415

    from .recording import RecordingError, write  # noqa: PLC0415
    from .recording.files import check_path  # noqa: PLC0415
    from .running import Steering, describe, walk_in  # noqa: PLC0415

    if (port is None) is not virtual:
        fail("give either --port PATH or --virtual")
    if seconds <= 0:
        fail(f"--seconds must be more than 0, not {seconds:g}")
    steering = Steering(
        seconds, v_left, v_right, None if cycle_ms is None else cycle_ms / 1e3, seed
    )
    try:
        described = load_robot(robot)
        if record is not None:
            check_path(record)
        with _session(described, port, plant) as session:
            with Progress(transient=True) as bar:
                task = bar.add_task(f"{described.name} walks", total=seconds)
                report, finished = walk_in(
                    session, steering, lambda t: bar.update(task, completed=t)
                )
            if record is not None:
                name = record.stem
                condition = {"v_left": v_left, "v_right": v_right, "support": "ground"}
                write(session.recording(name, "walk", **condition), record)
    except (RobotError, TableError, BusError, RecordingError, UnreachableError) as error:
        fail(" ".join([str(error), *getattr(error, "__notes__", [])]))
    for line in describe(report):
        typer.echo(line)
    if record is not None:
        typer.echo(f"recorded {record}")
    if not finished:
        typer.echo("interrupted; torque is off")
        raise typer.Exit(130)


def _session(robot, port, plant):  # type: ignore[no-untyped-def]
    from contextlib import nullcontext

    from busemu.assemble import plants
    from busemu.timing import load_profile

    from .running import in_process, on_port

    if port is not None:
        return on_port(robot, port)
    makers = plants()
    if plant not in makers:
        fail(f"no plant named {plant!r}: use one of {', '.join(makers)}")
    return nullcontext(in_process(robot, makers[plant](robot), load_profile(robot.timing)))


def demo(robot: RobotOption = "marvin") -> None:
    """Demo."""
