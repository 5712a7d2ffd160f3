"""The command of :mod:`bench.fitting`."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bench.figures.style import panels, save, styled
from bench.figures.tables import aligned
from bench.options import LARGEST_SEED
from bench.recording import RecordingError

from .methods import LIKELIHOOD, LOOP, OURS, Fitted, Way, run, ways
from .problem import MODELS, Problem, recorded, simulated

MS = 1e3
SUFFIXES = (".png", ".svg", ".pdf")
WAYS = 6  #: of fitting, with MuJoCo's
BAM_TRIALS = 100_000  #: what bam.fit runs unless told otherwise; source: bam/fit.py, --trials
QUICK_S, LIMIT_S = 4.0, 60.0  #: of processor time that a way may take on one problem
WARM_S = 0.5  #: of simulated logs that are fitted once before
COLUMNS = (
    "way", "fitted MAE", "RMSE", "judged MAE", "RMSE", "near [s]", "x ours", "processor [s]",
    "x ours", "ended [s]", "candidates", "ms each",
)  # fmt: skip

HELP = """\
Fit the same numbers of the same servo model to the same logs in three ways, in one run: as busemu
diagnose does, as Rhoban's bam does (CMA-ES over a replay in Python), and as MuJoCo's toolbox for
system identification does (least squares with finite differences over its own rollouts).

  python -m bench.fitting              both models, simulated and real logs: some minutes
  python -m bench.fitting --quick      model M1, 4 s for each way: under a minute
  python -m bench.fitting --out fitting.png

What the table says, by column:
  fitted, judged   error of positions [mrad] on the logs fitted, and on those of another gain that
                   no fit has seen, each in the way's own simulator
  near, processor  when the error was first within 1 % of where it ended: time, and processor time
                   of all threads, which other work on the machine hardly changes
  x ours           each over that of the first row
  ended            when the search stopped by itself; > : it was cut off by --limit-s
  candidates       sets of numbers that were tried, each on all fitted logs; and processor time each

Simulated logs are made by our own rollouts (so the others pay for integrating otherwise), of a
truth drawn from --seed. The real ones are bam's own public logs of an XL330. Ratios are what to
look at: an idle machine is needed for seconds that mean something."""


def main() -> None:
    """Fit as the command line says; print tables, and draw the errors against time."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.fitting",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help=f"model M1, {QUICK_S:g} s a way")
    parser.add_argument("--model", choices=tuple(MODELS), help="M1 or M3; both, unless quick")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated logs; default 1")
    parser.add_argument(
        "--logs", type=Path, help="folder of bam's logs; default $BUSEMU_RECORDINGS/bam-xl330"
    )
    parser.add_argument(
        "--limit-s", type=float, help=f"of processor time, for each way; default {LIMIT_S:g}"
    )
    parser.add_argument(
        "--out", type=Path, help="a picture of the errors against time: .png, .svg, .pdf"
    )
    asked = parser.parse_args()
    if not 0 <= asked.seed <= LARGEST_SEED:
        parser.error(f"--seed must be 0 to {LARGEST_SEED}, not {asked.seed}")
    if asked.limit_s is not None and not 0.0 < asked.limit_s < math.inf:
        parser.error(f"--limit-s must be above 0 s, not {asked.limit_s:g}")
    if asked.out and (asked.out.suffix not in SUFFIXES or not asked.out.parent.is_dir()):
        parser.error(f"--out {asked.out}: a file {', '.join(SUFFIXES)} in a folder that is there")
    if asked.logs and not asked.logs.is_dir():
        parser.error(f"--logs {asked.logs}: there is no such folder")
    limit_s = asked.limit_s or (QUICK_S if asked.quick else LIMIT_S)
    models = (asked.model,) if asked.model else ("M1",) if asked.quick else tuple(MODELS)
    found: dict[str, dict[str, Fitted]] = {}
    known = ways()
    if len(known) < WAYS:
        print("MuJoCo's way is left out: pip install 'busemu[proof]' for the engine")
    for name in (OURS, LIKELIHOOD):  # compiled or loaded, before any clock runs
        run(known[name], simulated(models[0], asked.seed, WARM_S), LIMIT_S, lambda _: None)
    for problem in _problems(models, asked.seed, asked.logs):
        rows = found[problem.name] = _fitted(problem, known, limit_s)
        print(_told(problem, rows), flush=True)
    if asked.out:
        print(f"wrote {_drawn(found, asked.out)}")


def _problems(models: tuple[str, ...], seed: int, logs: Path | None) -> Iterator[Problem]:
    for model in models:
        yield simulated(model, seed)
        place = os.environ.get("BUSEMU_RECORDINGS")
        folder = logs or (Path(place, "bam-xl330") if place else None)
        if folder is None:
            print("no real logs: --logs or BUSEMU_RECORDINGS does not say where they are")
            continue
        try:
            yield recorded(model, folder)
        except (RecordingError, OSError) as error:
            print(f"no real logs: {error}")


def _fitted(problem: Problem, known: Mapping[str, Way], limit_s: float) -> dict[str, Fitted]:
    """A problem fitted in all ways, with a bar on the way."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    rows = {}
    with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as bars:
        bar = bars.add_task("", total=len(known))
        for name, way in known.items():

            def tell(error: float, name: str = name) -> None:
                bars.update(bar, description=f"{problem.name}: {name}, {error * MS:.1f} mrad")

            bars.update(bar, description=f"{problem.name}: {name}")
            rows[name] = run(way, problem, limit_s, tell)
            bars.advance(bar)
    return rows


def _told(problem: Problem, rows: Mapping[str, Fitted]) -> str:
    """The table of one problem, the numbers that were found, and what bam's replay would take."""
    counts = [sum(len(o.position.t_s) for o in m.observed) for m in (problem.fitted, problem.judge)]
    first = rows[OURS]
    table = [
        [
            name,
            *(f"{error * MS:.2f}" for error in (*row.fitted, *row.judged)),
            f"{row.near.wall_s:.2f}",
            f"{row.near.wall_s / first.near.wall_s:.1f}",
            f"{row.near.cpu_s:.2f}",
            f"{row.near.cpu_s / first.near.cpu_s:.1f}",
            f"{'> ' if row.cut else ''}{row.ended.wall_s:.1f}",
            f"{row.ledger.candidates}",
            f"{row.ended.cpu_s / row.ledger.candidates * MS:.2f}",
        ]
        for name, row in rows.items()
    ]
    found = {name: row.z for name, row in rows.items()}
    if problem.truth is not None:
        found = {"truth": problem.truth, **found}
    knobs = problem.hypothesis.knobs
    numbers = [
        [name, *(f"{knob.value(x):.4g}" for knob, x in zip(knobs, z.tolist(), strict=True))]
        for name, z in found.items()
    ]
    heads = [f"{knob.effect} [{knob.parameter.unit}]" for knob in knobs]
    text = (
        f"\n{problem.name}: {len(problem.fitted.observed)} logs fitted ({counts[0]} positions), "
        f"{len(problem.judge.observed)} judge ({counts[1]})\n\n"
        f"{aligned(COLUMNS, table)}\n\n{aligned(['found', *heads], numbers)}\n"
    )
    loop = rows[LOOP]
    each_s = loop.ended.cpu_s / loop.ledger.candidates
    return text + (
        f"\nExtrapolated from {each_s * MS:.0f} ms a candidate: bam.fit's default of {BAM_TRIALS} "
        f"trials would take the Python loop {each_s * BAM_TRIALS / 60.0:.0f} min."
    )


@styled
def _drawn(found: Mapping[str, Mapping[str, Fitted]], path: Path) -> Path:
    """Errors against time, a panel for each problem."""
    title = "Root mean square on the fitted logs against processor time"
    figure, axes = panels(len(found), 7.0, 2.4 * len(found) + 0.6, title)
    for panel, (problem, rows) in zip(axes, found.items(), strict=True):
        for k, (name, row) in enumerate(rows.items()):
            line = [*row.ledger.line, row.ended]
            times, errors = [at.cpu_s for at in line], [at.rmse * MS for at in line]
            panel.step(times, errors, where="post", color=f"C{k}", label=name)
        panel.set(xscale="log", yscale="log", title=problem, ylabel="[mrad]")
        panel.set_xlim(left=0.01)
    axes[-1].set_xlabel("processor time [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return save(figure, path)


if __name__ == "__main__":
    main()
