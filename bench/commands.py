"""Commands of the bench for the ``busemu`` command line.

Heavy parts are imported when a command runs, so that ``busemu --help`` is quick.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busemu.assemble import plants
from busemu.cli import endings, fail
from busemu.tables import Robot, RobotError, TableError, load_robot, robots
from busemu.timing import ProfileError, load_profile
from busemu.wording import amount

from .options import LONGEST_CYCLE_MS, LONGEST_S, steering_within, within

if TYPE_CHECKING:
    from .running import Session

#: A progress bar is drawn once in this time [s].
BAR_EVERY_S = 0.5

RobotOption = Annotated[
    str,
    typer.Option(
        help=f"One of {', '.join(robots())}, the path of a robot file (.toml), or servos of a "
        "model: XM430-W350:1-3@57600."
    ),
]


def walk(
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
    world: Annotated[
        Path | None,
        typer.Option(
            help="With --virtual: what is around the robot (.toml): slopes, steps, soft or "
            "slippery ground, a payload, pushes."
        ),
    ] = None,
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
    from hal.bus_errors import BusError
    from hal.legs import UnreachableError

    from .recording import RecordingError, write
    from .recording.files import check_path
    from .running import Steering, describe, noticed, walk_in

    if (port is None) is not virtual:
        fail("give either --port PATH or --virtual")
    if world is not None and not virtual:
        fail("--world goes with --virtual; give it to busemu serve for a port")
    steering_within(seconds, v_left, v_right, seed)
    if cycle_ms is not None:
        within("--cycle-ms", cycle_ms, "ms", 0.0, LONGEST_CYCLE_MS)
    steering = Steering(
        seconds, v_left, v_right, None if cycle_ms is None else cycle_ms / 1e3, seed
    )
    failure: Exception | None = None
    try:
        described = load_robot(robot)
        if record is not None:
            check_path(record)
        with _session(described, port, plant, world) as session:
            try:
                with _bar(described.name, seconds) as show:
                    report, finished = walk_in(session, steering, show)
            except BusError as error:
                failure = error  # what was recorded until then is kept
            if record is not None and len(session.recorder):
                condition = {"v_left": v_left, "v_right": v_right, "support": "ground"}
                write(session.recording(record.stem, "walk", **condition), record)
    except (
        RobotError,
        TableError,
        ProfileError,
        BusError,
        RecordingError,
        UnreachableError,
    ) as error:
        fail(error)
    if record is not None and record.exists():
        typer.echo(f"recorded {record}: see busemu inspect")
    if failure is not None:
        fail(" ".join([str(failure), *getattr(failure, "__notes__", [])]))
    for line in (*describe(report), *noticed(session)):
        typer.echo(line)
    if not finished:
        typer.echo("interrupted; torque is off")
        raise typer.Exit(130)


@contextmanager
def _bar(name: str, seconds: float) -> Iterator[Callable[[float], None] | None]:
    """Yield what is told the time walked [s] and shows it; nothing where no terminal is."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    shown_s = -BAR_EVERY_S
    with Progress(console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task(f"{name} walks", total=seconds)

        def show(walked_s: float) -> None:
            nonlocal shown_s
            if walked_s - shown_s >= BAR_EVERY_S:  # drawing takes a part of a control cycle
                shown_s = walked_s
                bar.update(task, completed=walked_s, refresh=True)

        yield show


def tap(
    device: Annotated[str, typer.Option(help="The real adapter: /dev/ttyUSB0, or any port.")],
    robot: RobotOption,
    record: Annotated[
        Path, typer.Option(help="The recording: NAME.parquet, or NAME.csv with .toml.")
    ],
    link: Annotated[
        Path | None, typer.Option(help="Keep a symlink of this name to the port while tapping.")
    ] = None,
    group: Annotated[
        str, typer.Option(help="Name that recordings of one experiment share.")
    ] = "tap",
    shadow: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help="Run this emulated robot beside the real one, on the same instructions, and say "
            "where their replies part.",
        ),
    ] = None,
    shadow_plant: Annotated[
        str, typer.Option(help="What moves the shadow's joints: bullet or ideal.")
    ] = "bullet",
    threshold: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="How far replies may be apart, in SI, by register or unit: rad=0.05.",
        ),
    ] = None,
) -> None:
    """Stand between any program and its real adapter, and record every register it touches.

    Start the tap on the adapter, then the unmodified program on the port that the tap prints:

        busemu tap --device /dev/ttyUSB0 --robot marvin --link /tmp/marvin --record lab.parquet

        busemu walk --robot marvin --port /tmp/marvin

    Bytes pass at once in both directions; the baud rate is the program's. Ctrl-C ends the tap and
    writes the recording, as does unplugging the adapter. Look at it with `busemu inspect`.

    With --shadow an emulated robot gets the same instructions at the same time, and the tap says
    live which register of which servo is not what the emulated one has, and since when.
    """
    from busemu.ports.device import DeviceError, DeviceLostError, SerialDevice
    from busemu.ports.pty import LinkError, PtyPort
    from busemu.serve import prepare_process

    from .recording import RecordingError
    from .recording.files import check_path
    from .shadow import Parting, ShadowError, parse_thresholds, shadow_of
    from .tapping import TapRecorder

    stop = threading.Event()
    for ending in endings():
        signal.signal(ending, lambda *_: stop.set())  # a second one changes nothing
    gone: DeviceLostError | None = None
    try:
        described = load_robot(robot)
        check_path(record)
        with closing(SerialDevice(device, described.baud_rate)) as adapter:
            with closing(PtyPort(link)) as port:
                told = RenewedLine()

                def parted(parting: Parting) -> None:
                    typer.echo(told.after + parting.words(begun_s))
                    told.after = ""

                beside = None
                if shadow is not None:
                    limits = parse_thresholds(threshold or [])
                    beside = shadow_of(shadow, shadow_plant, described, parted, limits)
                begun_s = time.monotonic()
                taps = TapRecorder(described, port, adapter, beside)
                typer.echo(f"{described.name}: tapping {device}, Protocol {described.protocol}")
                typer.echo(f"port {port.path}" + (f" (also {link})" if link else ""))
                typer.echo(f"try: busemu walk --robot {robot} --port {link or port.path}")
                sys.stdout.flush()
                prepare_process()
                try:
                    taps.run(
                        stop.is_set,
                        lambda passing: told(str(passing)),
                        lambda line: typer.secho(f"busemu: {line}", fg="red", err=True),
                    )
                except DeviceLostError as error:
                    gone = error
            if taps.counts.rows:
                taps.save(record, group)
    except (RobotError, TableError, LinkError, DeviceError, RecordingError, ShadowError) as error:
        fail(error)
    except OSError as error:
        fail(f"--record {record}: {os.strerror(error.errno or 0)}")
    counts = taps.counts
    rows, lost = amount(counts.rows, "row"), amount(counts.lost, "value")
    what = f"recorded {record}: {rows}, {lost} lost; see busemu inspect"
    typer.echo(told.after + (what if counts.rows else "nothing was read or written: no recording"))
    for line in beside.summary(begun_s) if beside is not None else []:
        typer.echo(line)
    if gone is not None:
        fail(gone)


class RenewedLine:
    """Says one line again and again: over itself on a terminal, else under itself."""

    def __init__(self) -> None:
        self._start, self._end = ("\r\x1b[K", "") if sys.stdout.isatty() else ("", "\n")
        self.after = ""  #: what ends the line before something else is said

    def __call__(self, line: str) -> None:
        """Say ``line`` in the place of the one before."""
        self.after = "" if self._end else "\n"
        os.write(sys.stdout.fileno(), f"{self._start}{line}{self._end}".encode())


def timing(
    robot: RobotOption,
    port: Annotated[
        str | None, typer.Option(help="Serial port: /dev/ttyUSB0, /dev/pts/N, or a link.")
    ] = None,
    virtual: Annotated[
        bool, typer.Option("--virtual", help="No port: the model itself, in virtual time.")
    ] = False,
    profile: Annotated[
        str | None,
        typer.Option(
            "--timing", help="Profile of the model to compare with. Default: the robot's."
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(help="How often each transaction is timed.")] = 100,
    out: Annotated[
        Path | None, typer.Option(help="Write timing.csv, times.csv and timing.png here.")
    ] = None,
    vary_return_delay: Annotated[
        bool,
        typer.Option(
            "--vary-return-delay",
            help="Time at return delays 0 and 250. Writes the servos' EEPROM and puts back what "
            "was there, also after Ctrl-C.",
        ),
    ] = False,
    fit: Annotated[
        Path | None, typer.Option(help="Fit a timing profile and write it here (.toml).")
    ] = None,
) -> None:
    """Time every kind of transaction on a bus, real or emulated; fit a timing profile to it.

    Nothing moves. On a real robot, with what can be told apart safely:

        busemu timing --robot marvin --port /dev/ttyUSB0 --vary-return-delay --fit mine.toml
    """
    from hal.bus_errors import BusError

    from .calibration import CalibrationError
    from .return_delays import ReturnDelayError
    from .timing_run import Wanted, run_timing

    if (port is None) is not virtual:
        fail("give either --port PATH or --virtual")
    within("--repeats", repeats, "", 1, 1_000_000)
    if fit is not None and fit.suffix != ".toml":
        fail(f"--fit {fit}: a profile is a .toml file")
    if fit is not None and not fit.parent.is_dir():
        fail(f"--fit {fit}: there is no folder {fit.parent}: make it first")
    try:
        described = load_robot(robot)
        model = load_profile(profile or described.timing)
        wanted = Wanted(described, robot, model, port, repeats, vary_return_delay, out, fit)
        run_timing(wanted, typer.echo)
    except (
        RobotError,
        TableError,
        ProfileError,
        BusError,
        CalibrationError,
        ReturnDelayError,
    ) as error:
        fail(" ".join([str(error), *getattr(error, "__notes__", [])]))
    except OSError as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("interrupted; the servos are as they were")
        raise typer.Exit(130) from None


def _session(
    robot: Robot, port: str | None, plant: str, world: Path | None
) -> AbstractContextManager[Session]:
    from .running import in_process, on_port

    if port is not None:
        return on_port(robot, port)
    makers = plants()
    if plant not in makers:
        fail(f"no plant named {plant!r}: use one of {', '.join(makers)}")
    joints = makers[plant](robot, world=world)
    return nullcontext(in_process(robot, joints, load_profile(robot.timing)))


def demo(
    robot: RobotOption = "marvin",
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results. Default: demo-ROBOT.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long to walk.")] = 10.0,
) -> None:
    """Serve a robot, time its bus, let it walk, and leave a folder of pictures and recordings."""
    from .demo import DemoError, run_demo

    within("--seconds", seconds, "s", 0.1, LONGEST_S)
    try:
        described = load_robot(robot)
        folder = out or Path(f"demo-{described.name}")
        result = run_demo(described, robot, folder, seconds, lambda text: typer.echo(f"- {text}"))
    except (RobotError, TableError, DemoError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("interrupted; the server is stopped")
        raise typer.Exit(130) from None
    moved = result.moved
    typer.echo(
        f"\n{result.table}\n\n"
        f"walked {moved.distance_m:.3f} m in {moved.duration_s:.1f} s, "
        f"turned {math.degrees(moved.turned_rad):+.1f} degrees\n\n"
        f"look at   {folder}/README.md, {folder}/walk.gif, {folder}/timing.png\n"
        f"try next  busemu serve --robot {robot} --link /tmp/{described.name}\n"
        f"          busemu walk --robot {robot} --port /tmp/{described.name} "
        "--v-left 1.5 --v-right 0.5"
    )
