"""The command ``busemu study``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from busemu.cli import end_by_interrupt, fail

STUDIES = {
    "stance": "rubber tips, soft joints, both or neither? Eight concealed walks, diagnosed",
    "engines": "how far two physics engines are apart on the same walk: the null of every study",
}


def study(
    name: Annotated[str, typer.Argument(help="; ".join(f"{k}: {v}" for k, v in STUDIES.items()))],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results. Default: study-NAME.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Draws the runs and their order.")] = 1,
) -> None:
    """Put one of the open questions to the whole bench.

    The thesis's own, on eight robots of another physics engine (some minutes):

        busemu study stance

    The folder then has every recording, the key that says what was true, its hash as it was before
    anything was diagnosed, study.json, and for every run the joints over the phase of the gait,
    real against model, before and after. Recordings that are there already are not made again.
    """
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    if name not in STUDIES:
        fail(f"no study named {name!r}: use {' or '.join(STUDIES)}")
    folder = out or Path(f"study-{name}")
    end_by_interrupt()
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    try:
        with Progress(*columns) as progress:
            task = progress.add_task(name)

            def say(what: str) -> None:
                progress.update(task, description=what)

            lines = _stance(folder, seed, say) if name == "stance" else _engines(folder, say)
    except ImportError as error:
        fail(f"{error}: a study needs the extra proof: pip install 'busemu[proof]'")
    except (OSError, ValueError) as error:
        fail(str(error))
    except KeyboardInterrupt:
        typer.echo("\ninterrupted; the same command goes on with the recordings that are there")
        raise typer.Exit(130) from None
    for line in lines:
        typer.echo(line)


def _stance(folder: Path, seed: int, say: Callable[[str], None]) -> list[str]:
    from .studies.stance import study as run

    result = run(seed, folder, say)
    lines = []
    for answer in result["answers"]:
        right = "right" if answer["answer"] == answer["truth"] else "WRONG"
        found = ", ".join(f"{e['name']} {e['value']:.3g} {e['unit']}" for e in answer["effects"])
        lines.append(
            f"{answer['run']} from {answer['channels']}: {answer['answer']} "
            f"(true: {answer['truth']}, {right}) {found}"
        )
    for channels, score in result["score"].items():
        lines.append(
            f"from {channels}: {score['right']} of {score['of']} right; "
            f"tips {score['tips_right']}, joints {score['joints_right']}"
        )
    lines.append(f"next: look at {folder}/summary.png and {folder}/run-1-after.png")
    return lines


def _engines(folder: Path, say: Callable[[str], None]) -> list[str]:
    from .studies.engines import write_study

    lines = write_study(folder, say)
    return [*lines, f"next: look at {folder}/engines.png"]
