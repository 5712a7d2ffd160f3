"""The command ``busemu replay``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busemu.cli import fail
from busemu.tables import RobotError, TableError, load_robot, robots

from .stages import stages

if TYPE_CHECKING:
    from rich.console import Console

    from .diagnosis.replaying import Replayed

COLUMNS = "recording", "joint", "robot", "mean_absolute_rad", "rms_rad", "largest_rad", "samples"


def replay(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Recordings, logs in a known foreign format, or folders of them."),
    ],
    robot: Annotated[
        list[str],
        typer.Option(
            help=f"One of {', '.join(robots())}, or the path of a robot file (.toml). Once for "
            "each that is to be compared."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for replay.csv and a picture of every recording."),
    ] = None,
) -> None:
    """Replay recorded goals through robot files, and say how far each is from what was recorded.

    Nothing is fitted. So it shows what a better model is worth on recordings that it was not made
    from, beside what was believed before:

        busemu replay --robot xl330-pendulum --robot found/model.toml --out replays logs/

    Where a voltage register was read often, a joint is replayed under what it says. A robot that
    walks is replayed as a whole, and its feet may slip elsewhere than those of the recording did.
    """
    from .console import for_tables
    from .diagnosis.replay_picture import replay_picture
    from .diagnosis.replaying import replay as run
    from .diagnosis.sense import DiagnosisError, check_servos
    from .figures.style import save
    from .files import write_csv
    from .importers import open_recordings
    from .recording import RecordingError

    if len(set(robot)) < len(robot):
        fail("--robot: each robot file once")
    console = for_tables()
    try:
        described = [load_robot(name) for name in robot]
        with stages() as say:
            read = open_recordings(recordings, robot[0])
            for recording in read:
                for one in described:
                    check_servos(recording, one)
            found = run(described, read, say)
            by_recording = {
                name: [one for one in found if one.recording == name]
                for name in dict.fromkeys(one.recording for one in found)
            }
            if out is not None:
                out.mkdir(parents=True, exist_ok=True)
                write_csv(out / "replay.csv", COLUMNS, _rows(found, robot))
                for name, some in by_recording.items():
                    say(f"drawing {name}")
                    save(replay_picture(some, robot), out / f"{name.replace('/', '_')}.png")
    except (RobotError, TableError, RecordingError, DiagnosisError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("interrupted; files that were written are whole")
        raise typer.Exit(130) from None
    show(found, robot, console)
    silent = sorted({one.name for one in read} - set(by_recording))
    if silent:
        typer.echo(f"left out, no joint moves as it is told: {', '.join(silent)}")
    if out is not None:
        typer.echo(f"look at   {out}/*.png, {out}/replay.csv")


def show(found: Sequence[Replayed], robots: Sequence[str], console: Console) -> None:
    """Print how far robot files are from recordings: by recording, by joint, and in all."""
    from rich.markup import escape
    from rich.table import Table

    from .diagnosis.replaying import Misfit

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for name in robots:
        table.add_column(escape(name), justify="right", overflow="fold")

    def add(what: str, some: Iterable[Replayed]) -> None:
        some = list(some)
        cells = []
        for which in range(len(robots)):
            misfit = Misfit.of(some, which)
            numbers = misfit.mean_absolute, misfit.rms, misfit.largest
            cells.append(" / ".join(f"{1e3 * number:.1f}" for number in numbers))
        table.add_row(escape(what), *cells)

    names = dict.fromkeys(one.recording for one in found)
    joints = dict.fromkeys(one.joint for one in found)
    for name in names if len(names) > 1 else ():
        add(name, (one for one in found if one.recording == name))
    for joint in joints if len(joints) > 1 else ():
        add(joint, (one for one in found if one.joint == joint))
    alone = len(names) == 1 and len(joints) == 1
    add(found[0].recording if alone else "all", found)
    heading = "recorded less replayed [mrad]: mean absolute / root mean square / largest\n"
    console.print(heading, markup=False, highlight=False)
    console.print(table)


def _rows(found: Sequence[Replayed], robots: Sequence[str]) -> Iterable[Sequence[object]]:
    from .diagnosis.replaying import Misfit

    for one in found:
        for which, name in enumerate(robots):
            misfit = Misfit.of([one], which)
            sizes = misfit.mean_absolute, misfit.rms, misfit.largest
            yield one.recording, one.joint, name, *sizes, misfit.samples
