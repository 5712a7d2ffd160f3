"""Commands for recordings: look into them, and make some of other people's logs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busemu.cli import fail
from busemu.wording import amount

if TYPE_CHECKING:
    from rich.console import Console

    from .recording import Recording

#: recordings that are described one by one; of more, a table is made
DESCRIBED = 5


def inspect(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="NAME.parquet, NAME.csv with its .toml, logs in a known foreign format, folders."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Write pictures here: motion, intervals, measurements.")
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Robot of recordings that name none known: a name or a .toml file."),
    ] = None,
) -> None:
    """Show what is in recordings, and what is odd about them: where, why it matters, what to do.

    Other people's logs are read as they are (see busemu import --help for their formats):

        busemu inspect lab.parquet --out pictures

        busemu inspect logs/
    """
    from .console import for_tables
    from .inspecting import Overview, report, write_pictures

    console = for_tables()
    try:
        paths = _expanded(recordings)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        overview = Overview()
        wrong = 0
        for path in _progress(paths, "looking"):
            found = _opened(path, robot)
            if found is None:
                wrong += 1
            for recording in found or ():
                if len(paths) <= DESCRIBED:
                    report(recording, console)
                overview.add(recording, path)
                if out is not None:
                    for picture in write_pictures(recording, out):
                        console.print(f"picture {picture}", soft_wrap=True, highlight=False)
    except OSError as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("interrupted")
        raise typer.Exit(130) from None
    if len(paths) > DESCRIBED:
        overview.show(console)
    if out is None and overview.rows:
        console.print("try next  busemu inspect ... --out DIR   for pictures", highlight=False)
    if wrong:
        raise typer.Exit(1)


def import_(
    format: Annotated[str, typer.Argument(help="auto, or one of the formats below.")],
    files: Annotated[list[Path], typer.Argument(help="Foreign logs, or folders of them.")],
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")],
    robot: Annotated[
        str | None,
        typer.Option(help="Robot file instead of the one of the format: a name or a .toml file."),
    ] = None,
    map: Annotated[
        Path | None, typer.Option(help="wide-csv: what the columns are (.toml).")
    ] = None,
    csv: Annotated[
        bool, typer.Option("--csv", help="Write .csv with .toml instead of .parquet.")
    ] = False,
) -> None:
    """Make recordings of other people's logs.

    Formats, told by the shape of a file: bam (JSON, one servo with a weight on an arm), so101
    (control.csv and state_motor.csv), dynaban (CSV of one MX-64: duty, trajectories, registers),
    telemetry (CSV, a column a value and servo), wide-csv (any CSV of one column a signal, with a
    map). gzip is accepted. auto looks at each file.

        busemu import auto logs/ --out recordings

        busemu import wide-csv walk.csv --map walk.columns.toml --out recordings

    A map says for every column its servo or joint, register and unit; see
    docs/how-to/recordings.md. Values become raw register values; what no register holds is kept
    under foreign/. What had to be decided stands in the metadata under [import].
    """
    from .importers import FORMATS, import_file
    from .recording import RecordingError, write

    if format != "auto" and format not in FORMATS:
        fail(f"no format {format!r}: use auto or one of {', '.join(FORMATS)}")
    try:
        paths = _expanded(files)
        out.mkdir(parents=True, exist_ok=True)
        taken: set[Path] = set()
        rows = 0
        for path in _progress(paths, "importing"):
            for recording in import_file(path, format, robot=robot, map_path=map):
                place = _free(out, recording.name, ".csv" if csv else ".parquet", taken)
                write(recording, place)
                rows += len(recording)
                typer.echo(
                    f"{place}: {amount(len(recording), 'row')}, {recording.duration_s:.3f} s"
                )
                for note in recording.metadata["import"].get("notes", []):
                    typer.echo(f"  note: {note}")
    except (RecordingError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("interrupted; the recordings named above are complete")
        raise typer.Exit(130) from None
    typer.echo(f"{amount(len(taken), 'recording')}, {amount(rows, 'row')}")
    typer.echo(f"try next  busemu inspect {out}")


def _expanded(paths: list[Path]) -> list[Path]:
    from .importers.opening import expanded
    from .recording import RecordingError

    try:
        return expanded(paths)
    except RecordingError as error:
        fail(error)


def _opened(path: Path, robot: str | None) -> list[Recording] | None:
    """The recordings in one file; ``None`` after saying what is wrong with it."""
    from .importers import open_recordings
    from .recording import RecordingError

    try:
        return open_recordings([path], robot)
    except RecordingError as error:
        typer.secho(f"busemu: {error}", fg=typer.colors.RED, err=True)
        return None


def _free(folder: Path, name: str, suffix: str, taken: set[Path]) -> Path:
    """A path for a recording that none of this run has; older files of that name are replaced."""
    safe = name.replace("/", "_").replace("\\", "_").strip(". ") or "recording"
    place, number = folder / f"{safe}{suffix}", 2
    while place in taken:
        place, number = folder / f"{safe}-{number}{suffix}", number + 1
    taken.add(place)
    return place


def _progress(paths: list[Path], what: str) -> Iterable[Path]:
    """The paths, with a bar at a terminal if there are many."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal or len(paths) <= DESCRIBED:
        return paths
    return _bar(paths, what, console)


def _bar(paths: list[Path], what: str, console: Console) -> Iterator[Path]:
    from rich.progress import Progress

    with Progress(console=console, transient=True) as bar:
        yield from bar.track(paths, description=what)
