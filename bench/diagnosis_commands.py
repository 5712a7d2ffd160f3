"""The command ``busemu diagnose``."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busemu.cli import fail
from busemu.tables import RobotError, TableError, load_robot, robots
from busemu.wording import amount

from .options import LARGEST_SEED, within
from .stages import stages

if TYPE_CHECKING:
    from busemu.tables import Robot

    from .diagnosis.joint.diagnosis import JointFindings
    from .diagnosis.joint.search import Progress
    from .diagnosis.journal import Journal
    from .diagnosis.robot.running import Answers
    from .diagnosis.running import Split
    from .diagnosis.watch import Watch


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
        typer.Option(
            metavar="SECONDS",
            help="Search no longer than this, and tell what was found until then. The same "
            "command with more time goes on from there.",
        ),
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
    minutes; a run that was stopped goes on when the same command is given again. An arm is
    diagnosed joint by joint. What the words mean stands in docs/how-to/diagnose.md.
    """
    from .console import for_tables
    from .diagnosis.journal import FOLDER, Journal
    from .diagnosis.report import Origin, write_report
    from .diagnosis.report.telling import unfinished
    from .diagnosis.sense import DiagnosisError
    from .diagnosis.summary import show
    from .diagnosis.watch import Watch
    from .recording import RecordingError

    if budget is not None and not budget > 0.0:
        fail(f"--budget must be more than 0 seconds, not {budget:g}")
    within("--seed", seed, "", 0, LARGEST_SEED)
    journal = Journal(out / FOLDER)
    new = not out.exists()
    try:
        described = load_robot(robot)
        with stages() as say:
            parts, odd = _parts(recordings, holdout or [], robot, described, say)
        out.mkdir(parents=True, exist_ok=True)
        _announce(described, parts)
        with stages() as say:
            watch = Watch(say, budget)
            on = date.today()
            answers, findings = _answers(
                described, parts, odd, out, on, without or (), seed, watch, journal
            )
            origin = Origin(
                robot=described.name,
                title=str(described.document.get("title", robot)),
                fitted=answers.fitted,
                left_out=tuple(without or ()),
                seed=seed,
                on=on,
                model=str(out / "model.toml"),
            )
            write_report(out / "report.html", answers.diagnosis, answers.traces, origin)
    except (RobotError, TableError, RecordingError, DiagnosisError, OSError) as error:
        if new:
            with suppress(OSError):  # what has something in it stays
                out.rmdir()
        fail(error)
    except KeyboardInterrupt:
        typer.echo(
            f"interrupted; files in {out} are whole, those of this run may be missing; "
            "the same command goes on from here"
        )
        raise typer.Exit(130) from None
    if not watch.late and not unfinished(answers.diagnosis):
        journal.finished()
    if journal.recalled:
        typer.echo(f"{journal.recalled} steps were there from an earlier run")
    if len(findings) > 1:
        _tell_joints(findings)
    written = [out / name for name in ("diagnosis.json", "model.toml", "report.html")]
    show(answers.diagnosis, for_tables(), written, out / "model.toml")


def _answers(
    robot: Robot,
    parts: Split,
    odd: Sequence[str],
    out: Path,
    on: date,
    without: Sequence[str],
    seed: int,
    watch: Watch,
    journal: Journal,
) -> tuple[Answers, Sequence[JointFindings]]:
    """Diagnose and write all but the report: a robot on legs as a whole, others joint by joint."""
    from .diagnosis.joint.together import together
    from .diagnosis.report import traces_of
    from .diagnosis.robot.running import Answers, run_robot, walks
    from .diagnosis.running import diagnose as run
    from .diagnosis.running import write

    if walks(robot):
        answers = run_robot(
            robot, parts, out, on, without=without, watch=watch, journal=journal, known=odd
        )
        watch.tell("writing the report")
        return answers, ()
    findings = run(robot, parts, without=without, seed=seed, say=watch, journal=journal, known=odd)
    watch.tell("writing the report")
    write(robot, findings, out, on)
    traces = [trace for found in findings for trace in traces_of(found)]
    fitted = tuple(o.name for o in findings[0].model.observed)
    return Answers(together(findings), traces, fitted), findings


def _tell_joints(findings: Sequence[JointFindings]) -> None:
    """A line for each joint of an arm, the one that is left worst first."""
    from .diagnosis.joint.together import joint_of

    for found in sorted(findings, key=lambda f: -f.diagnosis.fit.after):
        diagnosis = found.diagnosis
        names = ", ".join(cause.effect for cause in diagnosis.causes) or "nothing named"
        typer.echo(
            f"{joint_of(found):12} {1e3 * diagnosis.fit.before:6.1f} -> "
            f"{1e3 * diagnosis.fit.after:5.1f} mrad  {diagnosis.verdict.replace('_', ' ')}: {names}"
        )


def _parts(
    paths: Sequence[Path],
    holdout: Sequence[Path],
    name: str,
    robot: Robot,
    say: Progress,
) -> tuple[Split, Sequence[str]]:
    """What fits and what judges, and what is odd. Raises ``RecordingError``, ``DiagnosisError``."""
    from .diagnosis.running import Split, misfits, split
    from .diagnosis.sense import DiagnosisError, check_motion, check_numbers, check_servos
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
        check_servos(recording, robot)
    check_motion(read, robot)
    odd = check_numbers((*read, *judging), say)
    if judging:
        return Split(tuple(read), tuple(judging)), odd
    say("choosing what judges")
    return split(read, misfits(robot, read)), odd


def _announce(robot: Robot, parts: Split) -> None:
    from .diagnosis.running import group_of

    judging = f"{len(parts.judging)} held out" if parts.judging else "none held out"
    typer.echo(f"{robot.name}: {amount(len(parts.fitted), 'recording')} to fit, {judging}")
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
