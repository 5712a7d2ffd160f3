"""The command ``busemu diagnose``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busemu.cli import end_by_interrupt, fail
from busemu.tables import RobotError, TableError, load_robot, robots

if TYPE_CHECKING:
    from rich.console import Console

    from busemu.tables import Robot

    from .diagnosis.joint import JointFindings
    from .diagnosis.running import Split
    from .recording import Recording


def diagnose(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Recordings, logs in a known foreign format, or folders of them."),
    ],
    robot: Annotated[
        str,
        typer.Option(
            help="What you believe of the robot: one of "
            f"{', '.join(robots())}, or the path of a robot file (.toml)."
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Folder for diagnosis.json, model.toml and report.html.")
    ],
    holdout: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RECORDING",
            help="Judge on this and do not fit it; once for each. "
            "Default: every fourth group of recordings.",
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT", help="Take this effect out of the catalogue; once for each."
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Give up when so much time is used. Default: never."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of what is drawn: shuffles, random features.")] = 0,
) -> None:
    """Say where a robot's recordings differ from its model, and which physics was left out.

    It replays the recorded goals through the model of --robot, compares what comes out with what
    was recorded, tries every effect of the catalogue, and names one only when it holds on
    recordings that were not used to fit; else it says that it cannot explain the difference:

        busemu diagnose --robot xl330-pendulum --out found logs/

    Recordings that are to judge may be chosen; a folder may hold them and the rest:

        busemu diagnose --robot my-arm.toml --out found --holdout logs/walk-3.parquet logs/

    found/report.html shows it in pictures, found/model.toml is the better robot file. It takes
    minutes. An arm is diagnosed joint by joint, with a page for each that moves. What the words
    mean stands in docs/how-to/diagnose.md.
    """
    from .diagnosis.report import Origin, traces_of, write_report
    from .diagnosis.running import DiagnosisError, write
    from .diagnosis.running import diagnose as run
    from .diagnosis.summary import show
    from .diagnosis.together import joint_of, together
    from .recording import RecordingError

    if budget is not None and not budget > 0.0:
        fail(f"--budget must be more than 0 seconds, not {budget:g}")
    end_by_interrupt()
    try:
        described = load_robot(robot)
        parts = _parts(recordings, holdout or [], robot, described)
        out.mkdir(parents=True, exist_ok=True)
        _announce(described, parts)
        with _stages() as say:
            findings = run(
                described,
                parts,
                without=without or (),
                seed=seed,
                say=say if budget is None else within(budget, say),
            )
            say("writing the report")
            on = date.today()
            write(described, findings, out, on)
            written = [out / "diagnosis.json", out / "model.toml"]
            for found in findings:
                origin = Origin(
                    robot=described.name,
                    title=str(described.document.get("title", robot)),
                    fitted=tuple(o.name for o in found.model.observed),
                    left_out=tuple(without or ()),
                    seed=seed,
                    on=on,
                    model=str(out / "model.toml"),
                )
                page = "report" if len(findings) == 1 else f"report-{joint_of(found)}"
                written.append(out / f"{page}.html")
                write_report(written[-1], found.diagnosis, traces_of(found), origin)
    except (RobotError, TableError, RecordingError, DiagnosisError) as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename}: {os.strerror(error.errno or 0)}")
    except KeyboardInterrupt:
        typer.echo(f"interrupted; files in {out} are whole, those of this run may be missing")
        raise typer.Exit(130) from None
    for found in findings:
        _tell_of_left_out(parts, found)
    if len(findings) > 1:
        _tell_joints(findings)
    show(together(findings), _console(), written, out / "model.toml")


def _tell_joints(findings: Sequence[JointFindings]) -> None:
    """A line for each joint of an arm, the one that is left worst first."""
    from .diagnosis.together import joint_of

    for found in sorted(findings, key=lambda f: -f.diagnosis.fit.after):
        diagnosis = found.diagnosis
        names = ", ".join(cause.effect for cause in diagnosis.causes) or "nothing named"
        typer.echo(
            f"{joint_of(found):12} {1e3 * diagnosis.fit.before:6.1f} -> "
            f"{1e3 * diagnosis.fit.after:5.1f} mrad  {diagnosis.verdict.replace('_', ' ')}: {names}"
        )


def within(
    budget_s: float, say: Callable[[str], None], now_s: Callable[[], float] = time.monotonic
) -> Callable[[str], None]:
    """``say``, until the time is used up: then it raises ``DiagnosisError`` instead."""
    from .diagnosis.running import DiagnosisError

    start_s = now_s()

    def checked(stage: str) -> None:
        if now_s() - start_s > budget_s:
            raise DiagnosisError(
                f"--budget of {budget_s:g} s is used up before {stage!r}, and nothing was written: "
                "give more time or fewer recordings, or take effects out with --without"
            )
        say(stage)

    return checked


def _parts(paths: Sequence[Path], holdout: Sequence[Path], name: str, robot: Robot) -> Split:
    """What fits and what judges. Raises ``RecordingError`` and ``DiagnosisError``."""
    from .diagnosis.running import DiagnosisError, Split, split
    from .importers import open_recordings
    from .importers.opening import expanded

    held = expanded(holdout)
    own = {path.resolve() for path in held}
    fitted = [path for path in expanded(paths) if path.resolve() not in own]
    if not fitted:
        raise DiagnosisError(
            "all recordings are held out: name others to fit, or leave --holdout away"
        )
    read, judging = open_recordings(fitted, name), open_recordings(held, name)
    for recording in (*read, *judging):
        _check_servos(recording, robot)
    _check_motion(read, robot)
    return Split(tuple(read), tuple(judging)) if judging else split(read)


def _check_servos(recording: Recording, robot: Robot) -> None:
    """Refuse a recording of other servos than the robot's."""
    from .recording import RecordingError

    for servo_id in recording.servo_ids:
        mount = robot.by_id.get(servo_id)
        if mount is None:
            known = ", ".join(str(i) for i in sorted(robot.by_id))
            raise RecordingError(
                recording.path,
                f"servo {servo_id} is none of {robot.name} (it has {known}): "
                "is this a recording of another robot?",
            )
        model = recording.models.get(servo_id)
        if model is not None and model.model != mount.model:
            raise RecordingError(
                recording.path,
                f"servo {servo_id} is {model.model}, but {mount.model} in {robot.name}: "
                "is this a recording of another robot?",
            )


def _check_motion(recordings: Sequence[Recording], robot: Robot) -> None:
    """Refuse recordings in which nothing ever moves: they say nothing about a model."""
    from .diagnosis.running import DiagnosisError

    spans = []
    for recording in recordings:
        for servo_id in robot.by_id:
            raw = recording.series(servo_id, "present_position", "read").value
            if len(raw):
                spans.append((float(raw.min()), float(raw.max()), servo_id))
    for servo_id in {servo for _, _, servo in spans}:
        own = [(low, high) for low, high, servo in spans if servo == servo_id]
        if min(low for low, _ in own) < max(high for _, high in own):
            return
    if spans:
        raise DiagnosisError(
            f"present_position never changes in {len(recordings)} recordings: "
            "record motions, or look with busemu inspect at what was recorded"
        )


def _announce(robot: Robot, parts: Split) -> None:
    from .diagnosis.running import group_of

    judging = f"{len(parts.judging)} held out" if parts.judging else "none held out"
    typer.echo(f"{robot.name}: {len(parts.fitted)} recordings to fit, {judging}")
    both = {group_of(r) for r in parts.fitted} & {group_of(r) for r in parts.judging}
    if both:
        typer.echo(
            f"note: group {min(both)!r} is fitted and held out: repeats of one experiment judge "
            "less strictly than another experiment would"
        )
    if not parts.judging:
        typer.echo(
            "note: too few groups of recordings to hold any out: what is found is judged on what "
            "was fitted; record more motions, or use --holdout"
        )


def _tell_of_left_out(parts: Split, found: JointFindings) -> None:
    """Say which recordings told too little to be used."""
    used = {o.name for o in (*found.model.observed, *found.judge.observed)}
    for recording in (*parts.fitted, *parts.judging):
        if recording.name not in used:
            typer.echo(
                f"note: {recording.path or recording.name} was left out: too few positions of "
                f"{found.model.observed[0].joint}, or no write to its servo"
            )


@contextmanager
def _stages() -> Iterator[Callable[[str], None]]:
    """Yield what is told each stage: a moving line at a terminal, else a line each."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        start_s = time.monotonic()
        yield lambda stage: typer.echo(f"{time.monotonic() - start_s:6.0f} s  {stage}", err=True)
        return
    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("reading", total=None)
        yield lambda stage: bar.update(task, description=stage)


def _console() -> Console:
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=120)
