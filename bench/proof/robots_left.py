"""What tolerances leave of the effects in opened robots, written into the table of their proof.

    python -m bench.proof.robots_left proof-7

A robot is drawn again from its key and played some eighty times (five minutes of a core), so that
a proof does not wait for it. Ctrl-C keeps what is measured; the same command goes on from there.

    python -m bench.proof.robots_left proof-7 --supply 0.04 --gain 0.06

measures what a diagnosis leaves that grants more than the generator draws: into a folder of its own
and not into the table, whose column is of the generator's tolerances.
"""

from __future__ import annotations

import csv
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.blind.case import Asked
from bench.blind.legged_case import LeggedCase, draw_legged, nuisance_document
from bench.blind.legged_imitation import DRAWN, NO_MORE, Granted, legged_left
from bench.blind.scenes import SCENES
from bench.files import write_csv, write_json
from bench.stages import stages
from bench.starter import end_with_starter

from .processes import Job, run
from .table import COLUMNS

FOLDER = "left"  #: by case: floors that are left of each effect, and by what the rest is imitated

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


def measure(key: Key, granted: Granted = NO_MORE) -> list[dict[str, Any]]:
    """What is left of each effect of a key."""
    case = drawn(key)
    left = [legged_left(case, k, granted) for k in range(len(case.hidden))]
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


def options(granted: Granted) -> list[str]:
    """What is granted, as this command is told it; nothing where that is nothing."""
    told = ["--supply", f"{granted.supply:g}"] if granted.supply != DRAWN else []
    return told + (["--gain", f"{granted.gain:g}"] if granted.gain else [])


def _place(folder: Path, granted: Granted) -> Path:
    """Where files are of what is left beside that."""
    return folder / "-".join([FOLDER, *(word.strip("-") for word in options(granted))])


def _job(folder: Path, name: str, granted: Granted) -> Job:
    """A robot in a process of its own, which ends with this one."""
    command = (sys.executable, "-m", "bench.proof.robots_left", str(folder), "--one", name)
    return Job(name, (*command, *options(granted)), _place(folder, granted) / f"{name}.txt")


app = typer.Typer(add_completion=False)


@app.command()
def main(
    folder: Annotated[
        Path, typer.Argument(help="Folder of a proof whose keys were opened.", resolve_path=True)
    ],
    processes: Annotated[int, typer.Option(min=1, help="So many robots at a time.")] = 2,
    one: Annotated[str | None, typer.Option(metavar="CASE", help="This robot alone.")] = None,
    supply: Annotated[
        float, typer.Option(min=DRAWN, max=0.5, help="Grant a supply that is off by this share.")
    ] = DRAWN,
    gain: Annotated[
        float, typer.Option(min=0.0, max=0.5, help="Grant a gain of all joints off by this share.")
    ] = 0.0,
) -> None:
    """Measure what tolerances leave of the effects in opened robots, into cases.csv."""
    keys = wanted(folder)
    if not keys or not (folder / "cases.csv").exists():
        problem = "no keys of robots, or no cases.csv: name the folder of a proof that was opened"
        typer.echo(f"error: {folder}: {problem}", err=True)
        raise typer.Exit(1)
    if one is not None and one not in keys:
        known = ", ".join(keys)
        typer.echo(f"error: --one {one}: nothing is hidden in it; there are {known}", err=True)
        raise typer.Exit(1)
    granted = Granted(supply, gain)
    place = _place(folder, granted)
    place.mkdir(exist_ok=True)
    paths = {name: place / f"{name}.json" for name in keys}
    if one is not None:
        end_with_starter(os.getppid())
        try:
            write_json(paths[one], measure(keys[one], granted))
        except (KeyError, ValueError) as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(1) from None
        return
    waiting = [name for name, path in paths.items() if not path.exists()]
    failed = []
    with stages() as say:
        done = len(keys) - len(waiting)
        say(f"robots measured: {done} of {len(keys)}")
        for ended in run((_job(folder, name, granted) for name in waiting), processes):
            if ended.code != 0:
                failed.append(ended.job)
                continue
            ended.job.log.unlink()
            done += 1
            say(f"robots measured: {done} of {len(keys)}")
    there = {name: path for name, path in paths.items() if path.exists()}
    left = {name: json.loads(path.read_text("utf-8")) for name, path in there.items()}
    if granted == NO_MORE:
        fill(folder, left)
    for name, effects in left.items():
        shown = zip(keys[name]["effects"], effects, strict=True)
        told = ", ".join(
            f"{hidden['effect']} {e['ratio']:.2g} of {hidden['ratio']:.2g}" for hidden, e in shown
        )
        typer.echo(f"{name}  {told} floors")
    for job in failed:
        lines = job.log.read_text("utf-8", "replace").strip().splitlines() or ["it was ended"]
        typer.echo(f"{job.name}: {lines[-1]} (all of it in {job.log})", err=True)
    if failed:
        raise typer.Exit(1)


if __name__ == "__main__":
    app()
