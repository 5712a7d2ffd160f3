"""The command ``busemu prove``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from busemu.cli import fail

if TYPE_CHECKING:
    from .blind import Kind
    from .proof.plan import Planned
    from .proof.running import Proof

Named = TypeVar("Named", bound=Enum)

LINE_EVERY = 10  #: cases between two lines, where no terminal shows a bar


def prove(
    seed: Annotated[int, typer.Option(min=0, help="Draws the cases; the same gives the same.")],
    out: Annotated[Path, typer.Option(help="Folder for cases, answers, score and figures.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Two easy cases and a small catalogue: does it run?")
    ] = False,
    cases: Annotated[
        int | None,
        typer.Option(min=0, help="A balanced part of so many one-joint cases. Default: all."),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="Cases of one kind: null, single, pair, triple, stranger or deleted. --only null "
            "counts false alarms. (Whole robots have no triple and no stranger.)",
        ),
    ] = None,
    concealed: Annotated[
        str | None,
        typer.Option(
            metavar="WAY",
            help="With --only: one-joint cases concealed in one way alone: plain, masked, rare, "
            "sub_quantum or mimicked (by something that gives nearly the same trace).",
        ),
    ] = None,
    robots: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="CASES",
            help="So many cases of whole robots, too. Each takes two to twenty minutes of a core.",
        ),
    ] = 0,
    scene: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="With --robots: robots of this scene alone (marvin-walk, phantomx-walk, "
            "marvin-stand, phantomx-stand); may be given again for another.",
        ),
    ] = None,
    processes: Annotated[int, typer.Option(min=1, help="How many run at a time.")] = 2,
    active: Annotated[
        bool,
        typer.Option("--active", help="Run proposed next experiments where a case is open."),
    ] = False,
    baselines: Annotated[
        int, typer.Option(min=0, metavar="CASES", help="Run other methods on so many cases, too.")
    ] = 0,
    only_plan: Annotated[
        bool, typer.Option("--only-plan", help="Show what would be drawn, and stop.")
    ] = False,
) -> None:
    """Prove the diagnosis on cases with a concealed effect whose keys it cannot read.

    It draws rigs from another engine, hides an effect (or none, or several, or one that nobody
    knows) in each, publishes the hashes of the keys, has every case diagnosed by a process that
    sees only what an operator would, then opens the keys and scores:

        busemu prove --seed 7 --out proof-7 --cases 100

    Ctrl-C keeps what is finished; the same command goes on from there. What is counted, and how,
    stands in docs/proof/rules.md.
    """
    try:
        from .blind import Concealment, Kind
        from .proof import rivals
        from .proof.active import ROUNDS, Active
        from .proof.errors import ProofError
        from .proof.plan import plan
        from .proof.report import write_score
        from .proof.running import Proof
    except ModuleNotFoundError as error:
        fail(f"prove needs {error.name}: pip install 'busemu[sim,bench,proof]'")
    if quick and (cases or only):
        fail("--quick has its own cases: leave --cases and --only away")
    if concealed is not None and only is None:
        fail(f"--concealed {concealed}: give --only KIND as well")
    kind = None if only is None else _named(Kind, only, "--only")
    way = None if concealed is None else _named(Concealment, concealed, "--concealed")
    try:
        planned = plan(seed, cases, quick=quick, only=kind, way=way)
    except ValueError as error:
        fail(f"--cases: {error}")
    planned += _on_feet(seed, robots, scene or (), kind, quick=quick)
    if not planned:
        fail("--cases 0 leaves nothing to diagnose: give --robots")
    _tell_plan(planned)
    if only_plan:
        return
    proof = Proof(out.resolve(), planned, processes)
    try:
        proof.prepare()
        with _bar("writing cases", len(planned)) as show:
            proof.write(show)
        for case in proof.not_had:
            typer.echo(f"not to be had: {case['name']}, left out")
        published = proof.publish()
        typer.echo(
            f"published {proof.folder / 'published.json'}: {len(published['cases'])} keys, "
            f"diagnoser {published['diagnoser']['commit']}, "
            f"confinement {published['confinement']}"
        )
        _diagnose(proof)
        second = Active(proof, seed) if active or (proof.folder / "active").exists() else None
        if second:
            for asked in range(1, ROUNDS + 1):
                _rounds(f"next experiments, round {asked}", second.run(asked))
        if baselines:
            _rounds("other methods", rivals.run(proof, baselines))
        score = write_score(proof, seed, published, second, baselines)
    except (ProofError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        typer.echo("interrupted; finished cases are kept, the same command goes on")
        raise typer.Exit(130) from None
    _tell_score(score)
    typer.echo(f"look at   {out / 'index.html'}, {out / 'score.json'}, {out / 'cases.csv'}")


def _on_feet(
    seed: int, robots: int, scenes: Sequence[str], only: Kind | None, *, quick: bool
) -> tuple[Planned, ...]:
    """Cases of whole robots; ends the program where there are none of a scene or a kind."""
    from .proof.robot_plan import ON_FEET
    from .proof.robot_plan import robots as drawn

    if scenes and not robots:
        fail(f"--scene {scenes[0]}: give --robots CASES as well")
    if not robots:
        return ()
    try:
        return drawn(seed, robots, quick=quick, scenes=scenes or ON_FEET, only=only)
    except ValueError as error:
        fail(f"--robots: {error}")


def _named(names: type[Named], told: str, option: str) -> Named:
    """The member of an enumeration that an option names; ends the program where there is none."""
    found = next((one for one in names if one.value == told), None)
    if found is None:
        known = ", ".join(one.value for one in names)
        fail(f"{option} {told}: no such {names.__name__.lower()}; use one of {known}")
    return found


def _tell_plan(planned: tuple[Planned, ...]) -> None:
    for of_robots, what in ((False, "cases"), (True, "cases of whole robots")):
        own = [case for case in planned if case.robot is of_robots]
        kinds = Counter(str(case.asked.kind) for case in own)
        told = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
        effects = {name for case in own for name in case.asked.effects}
        if own:
            typer.echo(f"{len(own)} {what}: {told}; {len(effects)} effects by name")


def _diagnose(proof: Proof) -> None:
    done = sum(proof.answers.finished(name) for name in proof.had)
    with _bar("diagnosing", len(proof.had), done) as show:
        for _ in proof.answer():
            done += 1
            show(done)


def _rounds(words: str, steps: Iterator[tuple[int, int]]) -> None:
    """Go through what yields how many are done, of how many, if it does anything."""
    from itertools import chain

    first = next(steps, None)
    if first is None:
        return
    with _bar(words, first[1], first[0]) as show:
        for done, _ in chain([first], steps):
            show(done)


def _tell_score(score: dict[str, Any]) -> None:
    from .proof.robot_scoring import GOALS as ROBOT_GOALS
    from .proof.scoring import GOALS

    rows = {name: score[name] for name in (*GOALS, *ROBOT_GOALS) if name in score}
    rows |= {f"robots.{name}": row for name, row in score.get("robots", {}).get("rows", {}).items()}
    bare = [name for name, row in rows.items() if row["value"] is None]
    for name, row in rows.items():
        if name in bare:
            continue
        low, high = row["ci95"]
        typer.echo(
            f"{name:28} {row['value']:7.3f}  [{low:.3f}, {high:.3f}]  n {row['n']:4}  "
            f"good {row['good']:g}, great {row['great']:g}: {row['met']}"
        )
    if bare:
        typer.echo(f"no case speaks for {', '.join(bare)}")


@contextmanager
def _bar(words: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """Yield what takes how many are done; a bar with the rest time at a terminal, else lines."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Rest

    console = Console(stderr=True)
    if not console.is_terminal:
        told = done

        def tell(count: int) -> None:
            nonlocal told
            if count >= told + LINE_EVERY or (count == total and count > told):
                told = count
                typer.echo(f"{words}: {count} of {total}", err=True)

        yield tell
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rest())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(words, total=total, completed=done)
        yield lambda count: bar.update(task, completed=count)
