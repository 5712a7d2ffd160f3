"""What tolerances leave of the effects in opened robots, written into the table of their proof.

    python -m bench.proof.robots_left proof-7

A robot is drawn again from its key and played some eighty times (five minutes of a core), so that
a proof does not wait for it. Ctrl-C keeps what is measured; the same command goes on from there.
"""

from __future__ import annotations

import csv
import json
import os
import signal
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.blind.case import Asked
from bench.blind.legged_case import LeggedCase, draw_legged, nuisance_document
from bench.blind.legged_imitation import legged_left
from bench.blind.scenes import SCENES
from bench.files import write_csv, write_json
from bench.stages import stages
from bench.starter import end_with_starter

from .table import COLUMNS

FILE = "left.json"  #: by case and effect: floors that are left, and by what the rest is imitated

Key = Mapping[str, Any]


def drawn(key: Key) -> LeggedCase:
    """The case of a key, drawn again. Raises ``ValueError`` where another one comes of it."""
    case = draw_legged(key["seed"], Asked.of(key["asked"]))
    sizes = [(hidden.name, hidden.size) for hidden in case.hidden]
    same = sizes == [(effect["effect"], effect["size"]) for effect in key["effects"]]
    nuisances = json.loads(json.dumps(nuisance_document(case.nuisances)))
    if not same or nuisances != key["nuisances"]:
        raise ValueError(
            f"{key['case']}: its seed draws another robot now: measure it with the version that "
            "made it"
        )
    return case


def _begin(parent: int) -> None:
    """Make a process ready: it ends with the one that started it, and leaves Ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_starter(parent)


def measure(key: Key) -> list[dict[str, Any]]:
    """What is left of each effect of a key."""
    case = drawn(key)
    left = [legged_left(case, k) for k in range(len(case.hidden))]
    return [{"ratio": one.ratio, "imitation": dict(one.imitation)} for one in left]


def wanted(folder: Path) -> dict[str, Key]:
    """Keys of robots that walk in which something is hidden, by case."""
    found = {}
    for path in sorted((folder / "keys").glob("*.json")):
        key = json.loads(path.read_text("utf-8"))
        if key["rig"] in SCENES and key["effects"]:
            found[path.stem] = key
    return found


def fill(folder: Path, left: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Write what is left, of several effects the least, into the table of a proof."""
    path = folder / "cases.csv"
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    for line in lines:
        if line["case"] in left:
            line["ratio_left"] = f"{min(one['ratio'] for one in left[line['case']]):.3g}"
    write_csv(path, COLUMNS, ([line.get(name, "") for name in COLUMNS] for line in lines))


app = typer.Typer(add_completion=False)


@app.command()
def main(
    folder: Annotated[Path, typer.Argument(help="Folder of a proof whose keys were opened.")],
    processes: Annotated[int, typer.Option(min=1, help="So many robots at a time.")] = 2,
) -> None:
    """Measure what tolerances leave of the effects in opened robots, into cases.csv."""
    keys = wanted(folder)
    if not keys or not (folder / "cases.csv").exists():
        problem = "no keys of robots, or no cases.csv: name the folder of a proof that was opened"
        typer.echo(f"error: {folder}: {problem}", err=True)
        raise typer.Exit(1)
    path = folder / FILE
    left = json.loads(path.read_text("utf-8")) if path.exists() else {}
    waiting = {name: key for name, key in keys.items() if name not in left}
    pool = ProcessPoolExecutor(processes, get_context("spawn"), _begin, (os.getpid(),))
    with stages() as say:
        say(f"robots measured: {len(left)} of {len(keys)}")
        jobs = {pool.submit(measure, key): name for name, key in waiting.items()}
        try:
            for job in as_completed(jobs):
                left[jobs[job]] = job.result()
                write_json(path, left)
                say(f"robots measured: {len(left)} of {len(keys)}")
        except ValueError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(1) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    fill(folder, left)
    for name, effects in sorted(left.items()):
        shown = zip(keys[name]["effects"], effects, strict=True)
        told = ", ".join(
            f"{one['effect']} {e['ratio']:.2g} of {one['ratio']:.2g}" for one, e in shown
        )
        typer.echo(f"{name}  {told} floors")


if __name__ == "__main__":
    app()
