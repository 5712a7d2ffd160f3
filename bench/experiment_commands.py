"""The command ``busemu experiment``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from busemu.cli import fail
from busemu.tables import RobotError, TableError, load_robot, robots
from busemu.timing import ProfileError

from .options import MOST_REPEATS, steering_within, within

if TYPE_CHECKING:
    from .experiments.campaign import Campaign
    from .experiments.experiment import Progress, Trial

#: The bar moves when this much more of a trial has run [s]: drawing takes time, too.
BAR_EVERY_S = 0.5


def experiment(
    name: Annotated[
        str,
        typer.Argument(
            help="servo-check, torque-analysis, leg-step, locomotion; or list, which explains them."
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(help=f"One of {', '.join(robots())}, or the path of a robot file (.toml)."),
    ] = None,
    port: Annotated[
        str | None,
        typer.Option(
            help="Serial port of a real robot, or of busemu serve. "
            "Default: an emulated robot in this process, in virtual time."
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(help="How often; the thesis did each five times.")] = 5,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results. Default: NAME-ROBOT.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Draws what differs between repeats.")] = 0,
    evaluate: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Run nothing: evaluate the recordings in this folder."),
    ] = None,
    leg: Annotated[str, typer.Option(help="Leg of servo-check and leg-step.")] = "leg6",
    joint: Annotated[
        str | None, typer.Option(help="Joint of servo-check on a rig. Default: its first.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long locomotion walks.")] = 10.0,
    v_left: Annotated[float, typer.Option(help="Stride of the left legs in locomotion.")] = 1.0,
    v_right: Annotated[float, typer.Option(help="Stride of the right legs in locomotion.")] = 1.0,
    yes: Annotated[
        bool, typer.Option("--yes", help="With --port: the robot is prepared, ask nothing.")
    ] = False,
) -> None:
    """Run one of the thesis's four experiments over the bus, and set its numbers beside theirs.

    In virtual time, with PyBullet behind the servos, in about a minute:

        busemu experiment torque-analysis --robot phantomx

    On the real robot; it says what to prepare and asks before anything moves:

        busemu experiment torque-analysis --robot phantomx --port /dev/ttyUSB0

    The folder then has a recording of every repeat, figure.png and result.json. Ctrl-C switches the
    torque off and keeps finished repeats; the same command goes on from there. To evaluate
    recordings again, or those of others, use --evaluate DIR.
    """
    from hal.bus_errors import BusError

    from .experiments import EXPERIMENTS
    from .experiments.campaign import Campaign, recordings_in
    from .experiments.experiment import Choice, ExperimentError
    from .experiments.report import summary, write_report
    from .recording import RecordingError

    if name == "list":
        for each in EXPERIMENTS.values():
            typer.echo(f"{each.name} (figures {each.figures})\n    {each.description}")
        return
    if name not in EXPERIMENTS:
        fail(f"no experiment named {name!r}: use {', '.join(EXPERIMENTS)}, or list")
    within("--repeats", repeats, "", 1, MOST_REPEATS)
    steering_within(seconds, v_left, v_right, seed)
    if robot is None and evaluate is None:
        fail(f"name a robot: --robot {' or --robot '.join(robots())}")
    if joint is not None and name != "servo-check":
        fail(f"--joint {joint}: only servo-check takes one; leave it away")
    chosen = EXPERIMENTS[name]
    campaign: Campaign | None = None
    try:
        if evaluate is not None:
            recordings = recordings_in(evaluate, name)
            folder = out or evaluate
        else:
            assert robot is not None
            described = load_robot(robot)
            folder = out or Path(f"{name}-{described.name}")
            choice = Choice(repeats, seed, leg, joint, seconds, v_left, v_right)
            campaign = Campaign(chosen, described, chosen.trials(described, choice), folder, port)
            left = len(campaign.trials) - len(campaign.finished())
            typer.echo(
                f"{described.name}: {chosen.title.lower()} "
                + (f"on {port}" if port else "in virtual time")
                + f", {left} of {len(campaign.trials)} trials to run"
            )
            with _bar(campaign, quiet=bool(port) and not yes) as progress:
                recordings = campaign.run(progress, None if yes else _confirm)
        result = chosen.evaluate(recordings)
        numbers, picture = write_report(chosen, result, recordings, folder)
    except (
        RobotError,
        TableError,
        ProfileError,
        RecordingError,
        ExperimentError,
        BusError,
    ) as error:
        fail(" ".join([str(error), *getattr(error, "__notes__", [])]))
    except OSError as error:
        fail(error)
    except KeyboardInterrupt as interrupt:
        _interrupted(campaign, getattr(interrupt, "__notes__", []))
    typer.echo(
        f"\n{summary(result, recordings)}\n\n"
        f"look at   {picture}, {numbers}\n"
        f"try next  busemu inspect {recordings[0].path}\n"
        f"          busemu experiment {name} --evaluate {folder}"
    )


def _confirm(words: str) -> bool:
    typer.echo(f"\nprepare:  {words}")
    return typer.confirm("is it so?", default=False)


def _interrupted(campaign: Campaign | None, notes: list[str]) -> NoReturn:
    for note in notes:
        typer.secho(f"busemu: {note}", fg=typer.colors.RED, err=True)
    kept = ""
    if campaign is not None:
        done = sum(campaign.path(trial).exists() for trial in campaign.trials)
        kept = (
            f"; {done} of {len(campaign.trials)} trials are kept in {campaign.folder}: "
            "the same command goes on"
        )
    typer.echo(f"interrupted; torque is off{kept}")
    raise typer.Exit(130)


@contextmanager
def _bar(campaign: Campaign, *, quiet: bool) -> Iterator[Callable[[Trial], Progress]]:
    """Yield what gives each trial its own progress; shows nothing where no terminal is.

    ``quiet``: questions will be asked in between, so that a line a trial stands in for the bar.
    """
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if quiet or not console.is_terminal:

        def tell(trial: Trial) -> Progress:
            if quiet:
                typer.echo(f"{trial.name}: about {trial.seconds:.0f} s")
            return lambda _: None

        yield tell
        return
    total_s = sum(t.seconds for t in campaign.trials if not campaign.path(t).exists())
    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task(campaign.experiment.name, total=total_s)
        before_s = 0.0

        def start(trial: Trial) -> Progress:
            nonlocal before_s
            began_s, before_s = before_s, before_s + trial.seconds
            shown_s = -BAR_EVERY_S
            bar.update(task, completed=began_s, description=trial.name)

            def show(run_s: float) -> None:
                nonlocal shown_s
                if run_s - shown_s >= BAR_EVERY_S:
                    shown_s = run_s
                    bar.update(task, completed=began_s + min(run_s, trial.seconds))

            return show

        yield start
