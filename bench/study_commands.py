"""The command ``busemu study``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from busemu.cli import fail

from .options import LARGEST_SEED, within
from .stages import stages

STUDIES = {
    "stance": "rubber tips, soft joints, both or neither? Eight concealed walks, diagnosed",
    "loop": "a better model walks over the emulated bus: nearer to the robot than before?",
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

    The thesis's own, on eight robots of another physics engine (some two hours):

        busemu study stance

    The folder then has index.html to look at, study.json, the key that says what was true and its
    hash as it was before anything was diagnosed; and for every run its recordings and what
    busemu diagnose leaves. Recordings and diagnoses that are there are not made again.
    """
    if name not in STUDIES:
        fail(f"no study named {name!r}: use {' or '.join(STUDIES)}")
    within("--seed", seed, "", 0, LARGEST_SEED)
    folder = out or Path(f"study-{name}")
    try:
        with stages() as say:
            lines = STUDY[name](folder, seed, say)
    except ImportError as error:
        fail(f"{error}: pip install 'busemu[hal,sim,bench,proof]'")
    except (OSError, ValueError) as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("\ninterrupted; the same command goes on from what is there")
        raise typer.Exit(130) from None
    for line in lines:
        typer.echo(line)


def _stance(folder: Path, seed: int, say: Callable[[str], None]) -> list[str]:
    from .studies.stance import study as run
    from .studies.stance_page import named

    result = run(seed, folder, say)
    lines = []
    for answer in result["answers"]:
        found = "; ".join(named(answer))
        lines.append(
            f"{answer['run']} from {answer['part']}: {answer['answer']} "
            f"(true: {answer['truth']}, {answer['judged']}) {found}"
        )
    for part, score in result["score"].items():
        lines.append(
            f"from {part}: {score['right']} of {score['of']} right, "
            f"{score['undecided']} undecided, {score['wrong']} wrong; "
            f"tips {score['tips_right']}, joints {score['joints_right']}"
        )
    lines.append(f"next: look at {folder}/index.html")
    return lines


def _loop(folder: Path, seed: int, say: Callable[[str], None]) -> list[str]:
    from .studies.loop import lines
    from .studies.loop import study as run

    return [*lines(run(seed, folder, say)), f"next: look at {folder}/loop.png"]


def _engines(folder: Path, seed: int, say: Callable[[str], None]) -> list[str]:
    from .studies.engines import write_study

    lines = write_study(folder, say)
    return [*lines, f"next: look at {folder}/engines.png"]


STUDY = {"stance": _stance, "loop": _loop, "engines": _engines}
