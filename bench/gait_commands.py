"""The command ``busemu gait-search``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busemu.cli import fail
from busemu.tables import RobotError, TableError, load_robot, robots
from busemu.timing import ProfileError

from .options import LARGEST_SEED, LONGEST_S, within

if TYPE_CHECKING:
    from .gaits.outcome import Outcome
    from .gaits.search import Plan, Tell

#: More walks than a search is worth, and more at once than any machine has cores for.
MOST_WALKS, MOST_PROCESSES = 100_000, 256


def gait_search(
    robot: Annotated[
        str,
        typer.Option(help=f"One of {', '.join(robots())}, or the path of a robot file (.toml)."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the walks and the result.")],
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Search on this better file of the robot, such as model.toml of busemu diagnose.",
        ),
    ] = None,
    budget: Annotated[
        int, typer.Option(metavar="WALKS", help="So many walks at most, for each method.")
    ] = 100,
    seconds: Annotated[float, typer.Option(help="Length of a walk, after standing up.")] = 10.0,
    processes: Annotated[int, typer.Option(help="So many walks at once.")] = 2,
    seed: Annotated[
        int, typer.Option(help="Start state of the pattern generators, and draws of the optimiser.")
    ] = 0,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="cma|grid",
            help="cma: CMA-ES over strides, period, lift, duty factor and posture; grid: the "
            "thesis's grid over v_left and v_right. Default: both, to compare them.",
        ),
    ] = None,
    torque_limit: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            help="Of its stall torque no joint may need more. Keep below 0.75 as much as the model "
            "shows less torque than the robot.",
        ),
    ] = 0.75,
) -> None:
    """Search the fastest walk that keeps every joint's torque below a limit.

    The limit is 0.75 x stall if you do not say another; no fall and no self-collision either. The
    robot's own program walks over the emulated bus in virtual time; torque is recovered from
    position errors, as on a real robot. A first try takes a few minutes:

        busemu gait-search --robot marvin --out marvin-gaits --budget 20 --seconds 5

    The thesis's own size, 100 walks of 10 s a method, takes ten times as long. Every finished walk
    is a row of walks.csv; Ctrl-C keeps them, and the same command goes on from there, also with a
    larger budget or another limit. At the end the folder has result.json, landscape.png and
    best.toml, a robot file for busemu walk.
    """
    from sim.entries import PhysicsError

    from .gaits.candidate import GaitSearchError
    from .gaits.ledger import Ledger
    from .gaits.methods import Method
    from .gaits.report import summary, walk_command, write_report
    from .gaits.search import GaitSearch, Plan
    from .gaits.walking import Walker, shortest_s
    from .gaits.walks import Walks

    within("--budget", budget, "walks", 1, MOST_WALKS)
    within("--processes", processes, "", 1, MOST_PROCESSES)
    within("--seed", seed, "", 0, LARGEST_SEED)
    within("--torque-limit", torque_limit, "of the stall torque", 0.01, 1.0)
    if method is not None and method not in [m.value for m in Method]:
        fail(f"no method named {method!r}: use cma or grid, or leave --method away for both")
    methods = tuple(Method) if method is None else (Method(method),)
    plan = Plan(budget, seconds, seed, methods)
    ledger: Ledger | None = None
    try:
        described = load_robot(robot)
        if model is not None:
            better = load_robot(model)
            if better.name != described.name:
                fail(f"--model {model}: is of {better.name}, not of {described.name}")
            described = better
        least_s = shortest_s(described)
        within("--seconds", seconds, "s (two periods at least)", least_s, LONGEST_S)
        ledger = Ledger(out, described, torque_limit)
        typer.echo(
            f"{described.name}: {' and '.join(m.value for m in methods)}, at most {budget} walks "
            f"of {seconds:g} s each, torque below {torque_limit:g} x stall, {processes} at once"
            + (f"; {len(ledger)} walks are there already" if len(ledger) else "")
        )
        with Walks(Walker(described), processes) as walks, _bar(plan) as tell:
            result = GaitSearch(described, plan, ledger, walks, tell).run()
        written = write_report(result, out)
    except (RobotError, TableError, ProfileError, PhysicsError, GaitSearchError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        kept = "nothing was run"
        if ledger is not None:  # one may have been on its way to the disk
            kept = f"{len(Ledger(out, ledger.robot))} walks are kept in {out}"
        typer.echo(f"interrupted; {kept}: the same command goes on")
        raise typer.Exit(130) from None
    typer.echo(f"\n{summary(result)}\n\nlook at   {', '.join(map(str, written))}")
    command = walk_command(result, out)
    instead = "a larger --budget, or a higher --torque-limit: no gait kept the rules"
    typer.echo(f"try next  {instead if command is None else f'{command} --virtual'}")


@contextmanager
def _bar(plan: Plan) -> Iterator[Tell | None]:
    """Yield what is told of every walk and shows it; nothing where no terminal is."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeLeft()
    fastest = 0.0
    with Progress(*columns, console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task("first walks", total=plan.walks)

        def tell(outcome: Outcome, new: bool) -> None:
            nonlocal fastest
            fastest = max(fastest, outcome.speed_m_s if outcome.allowed else 0.0)
            words = f"fastest allowed {fastest * 1e3:.0f} mm/s"
            bar.update(task, advance=1, description=words, refresh=new)

        bar.refresh()
        yield tell
