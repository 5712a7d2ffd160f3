"""Figures of a proof: power against size, what is taken for what, probabilities, fits.

There is none where no case speaks for it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.blind.sizing import RATIOS
from bench.figures.style import GOAL, INK, MEASURED, MODELLED, START, STOP, panels, save, styled

from .intervals import wilson
from .judging import UNKNOWN_KINDS, Judged
from .scoring import BINS
from .staging import TRACE

COLUMNS = 4  #: of small panels
NOTHING, LEFT = "nothing", "unexplained"
WORST = 6  #: failures that are shown
#: ratios halfway between the sizes asked for
EDGES = (0.0, *(math.sqrt(a * b) for a, b in pairwise(RATIOS)), math.inf)


Size = Callable[[Judged], float]


def size_of(ratio: float) -> float:
    """The size of the grid that a ratio belongs to."""
    return RATIOS[int(np.searchsorted(EDGES, ratio)) - 1]


def _curve(axes: Axes, cases: Sequence[Judged], right: Callable[[Judged], bool], colour: str,
           label: str = "", size: Size = lambda c: c.ratio) -> None:  # fmt: skip
    sizes = [(size_of(size(c)), right(c)) for c in cases if not math.isnan(size(c))]
    by_size = {s: [hit for at, hit in sizes if at == s] for s in RATIOS}
    told = [(s, hits) for s, hits in by_size.items() if hits]
    if not told:
        return
    x = [s for s, _ in told]
    y = np.array([sum(hits) / len(hits) for _, hits in told])
    ends = np.array([wilson(sum(hits), len(hits)) for _, hits in told])
    bars = np.abs(np.stack([y - ends[:, 0], ends[:, 1] - y]))
    axes.errorbar(x, y, bars, color=colour, marker="o", ms=3, capsize=2, lw=1.2, label=label)


def _sizes(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_xticks(RATIOS, [f"{r:g}" for r in RATIOS])
    axes.minorticks_off()
    axes.set_xlim(RATIOS[0] / 1.25, RATIOS[-1] * 1.25)
    axes.set_ylim(-0.05, 1.05)


@styled
def power(cases: Sequence[Judged]) -> Figure | None:
    """Share of single effects that are named right, against size; all, then each effect.

    Size is over the floor of noise, with all else known; and what tolerances leave of that.
    """
    singles = [c for c in cases if c.kind == "single"]
    if not singles:
        return None
    names = sorted({c.hidden[0] for c in singles})
    rows = math.ceil(len(names) / COLUMNS)
    figure = Figure(figsize=(9.0, 3.2 + 1.5 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, COLUMNS, height_ratios=[2.2, *[1.0] * rows])
    half = COLUMNS // 2
    asked, left = (figure.add_subplot(grid[0, part]) for part in (slice(half), slice(half, None)))
    sizes: tuple[tuple[Axes, Size, str], ...] = (
        (asked, lambda c: c.ratio, "size / detection floor"),
        (left, lambda c: c.left, "what tolerances leave of it / detection floor"),
    )
    for axes, size, words in sizes:
        _curve(axes, singles, lambda c: c.first_right, MEASURED, "first name, by class", size)
        _curve(axes, singles, lambda c: c.second_right, GOAL, "or second", size)
        _curve(axes, singles, lambda c: c.first_exact, MODELLED, "first name, by name", size)
        _curve(axes, singles, lambda c: bool(c.wrong), STOP, "names something wrong", size)
        _sizes(axes)
        axes.set_xlabel(words)
    asked.set_title("All single effects")
    if left.get_legend_handles_labels()[0]:
        left.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    for i, name in enumerate(names):
        axes = figure.add_subplot(grid[1 + i // COLUMNS, i % COLUMNS])
        own = [c for c in singles if c.hidden == (name,)]
        _curve(axes, own, lambda c: c.first_right, MEASURED)
        _sizes(axes)
        axes.set_title(f"{name} ({len(own)})", fontsize=7.5)
        axes.tick_params(labelsize=6.5)
    return figure


@styled
def confusion(cases: Sequence[Judged]) -> Figure | None:
    """What is hidden against what is named first, at 1 x the floor and more; rows add up to one."""
    rows: dict[str, Counter[str]] = {}
    for c in cases:
        if c.kind in ("pair", "triple") or c.ratio < 0.95:
            continue
        true = c.hidden[0] if c.hidden else NOTHING
        true = f"{true} ({c.kind})" if c.kind in UNKNOWN_KINDS else true
        rows.setdefault(true, Counter())[_first(c)] += 1
    if not rows:
        return None
    order = sorted(rows, key=lambda name: (name.partition("(")[2], name == NOTHING, name))
    named = sorted({n for row in rows.values() for n in row} | {NOTHING, LEFT})
    named = [n for n in named if n not in (NOTHING, LEFT)] + [NOTHING, LEFT]
    shares = np.array([[rows[t][n] / sum(rows[t].values()) for n in named] for t in order])
    figure = Figure(
        figsize=(max(2.8 + 0.26 * len(named), 6.0), 2.4 + 0.2 * max(len(order), 4)),
        layout="constrained",
    )
    axes = figure.subplots()
    axes.grid(visible=False)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for y, true in enumerate(order):
        for x, name in enumerate(named):
            if rows[true][name]:
                colour = "white" if shares[y, x] > 0.55 else INK
                count = str(rows[true][name])
                axes.text(x, y, count, ha="center", va="center", fontsize=6.5, color=colour)
    axes.set_xticks(range(len(named)), named, rotation=90, fontsize=7)
    axes.set_yticks(range(len(order)), order, fontsize=7)
    axes.set_xlabel("named first (ordinary misfits that are true left out)")
    axes.set_ylabel("hidden")
    return figure


def _first(c: Judged) -> str:
    own = [n for n in c.named if n.label != "ordinary"]
    if own:
        return own[0].effect
    return LEFT if c.verdict in ("unexplained", "partly_explained") else NOTHING


@styled
def calibration(cases: Sequence[Judged]) -> Figure | None:
    """Stated probabilities against how often they are right."""
    if not any(c.named for c in cases):
        return None
    figure, (axes,) = panels(1, 4.8, 4.2)
    axes.plot([0, 1], [0, 1], color=GOAL, lw=1, ls="--")
    for by_class, colour, label in ((False, MEASURED, "by name"), (True, START, "by class")):
        told = np.array(
            [
                (n.class_probability, n.label != "wrong") if by_class else (n.probability, n.exact)
                for c in cases
                for n in c.named
            ],
            np.float64,
        ).reshape(-1, 2)
        bins = np.minimum((told[:, 0] * BINS).astype(int), BINS - 1)
        for b in sorted(set(bins.tolist())):
            own = told[bins == b]
            x, y = own.mean(axis=0) + np.array([0.006 * by_class, 0.0])
            low, high = wilson(int(own[:, 1].sum()), len(own))
            bars = [[max(0.0, y - low)], [max(0.0, high - y)]]
            axes.errorbar(x, y, bars, color=colour, marker="o", ms=4, capsize=2,
                          label=label)  # fmt: skip
            axes.annotate(str(len(own)), (x, y), (4, -9), textcoords="offset points", fontsize=7)
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(unique.values(), unique.keys(), loc="upper left")
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02), xlabel="stated probability", ylabel="share right")
    return figure


@styled
def coverage(cases: Sequence[Judged]) -> Figure | None:
    """Errors of parameters, and the share of intervals that hold the truth, by effect."""
    told = [p for c in cases if c.ratio >= 0.95 for p in c.checked if p.main]
    if not told:
        return None
    names = sorted({p.effect for p in told})
    figure = Figure(figsize=(8.0, 1.6 + 0.22 * max(len(names), 4)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for y, name in enumerate(names):
        own = [p for p in told if p.effect == name]
        left.plot([max(p.error, 1e-4) for p in own], [y] * len(own), "o", ms=3, color=MEASURED,
                  alpha=0.5)  # fmt: skip
        held = [p.covered for p in own if p.covered is not None]
        if held:
            share = sum(held) / len(held)
            low, high = wilson(sum(held), len(held))
            right.plot([low, high], [y, y], color=GOAL)
            right.plot([share], [y], "o", ms=4, color=MEASURED)
    left.set_xscale("log")
    left.axvline(0.05, color=START, lw=1)
    left.set_yticks(range(len(names)), names, fontsize=7.5)
    left.invert_yaxis()
    left.set(title="Error of the size", xlabel="share of the way from off")
    right.axvspan(0.93, 0.97, color=START, alpha=0.2, lw=0)
    right.set(title="Truth within the 95 % interval", xlim=(0, 1.02), xlabel="share")
    return figure


@styled
def explained(cases: Sequence[Judged]) -> Figure | None:
    """Share of the explainable held-out misfit that is removed, against size."""
    kinds = {"single": MEASURED, "pair": MODELLED, "triple": STOP}
    if not any(c.kind in kinds and c.explained is not None for c in cases):
        return None
    figure, (axes,) = panels(1, 7.0, 3.4)
    for kind, colour in kinds.items():
        own = [(c.ratio, c.explained) for c in cases if c.kind == kind and c.explained is not None]
        if own:
            x, y = np.array(own, np.float64).T
            axes.plot(x, y, "o", ms=3, color=colour, alpha=0.6, label=kind)
    axes.set_xscale("log")
    axes.set_xticks(RATIOS, [f"{r:g}" for r in RATIOS])
    axes.minorticks_off()
    axes.axhline(0.95, color=START, lw=1)
    axes.set(ylim=(-1.05, 1.05), xlabel="size / detection floor", ylabel="share removed")
    axes.legend(loc="lower right")
    return figure


def worst_cases(cases: Iterable[Judged]) -> list[Judged]:
    """Cases with the surest wrong names."""
    wrong = [c for c in cases if c.wrong]
    return sorted(wrong, key=lambda c: -max(n.probability for n in c.wrong))[:WORST]


@styled
def failures(cases: Sequence[Judged], answers: Path) -> Figure | None:
    """Residuals of the surest wrong names, before and after, on a recording that judged."""
    shown = [c for c in worst_cases(cases) if (answers / c.case / TRACE).exists()]
    if not shown:
        return None
    figure, all_axes = panels(len(shown), 8.5, 1.7 * len(shown))
    for axes, c in zip(all_axes, shown, strict=True):
        with np.load(answers / c.case / TRACE) as trace:
            t, measured = trace["t_s"], trace["measured_rad"]
            for key, colour in (("before_rad", MODELLED), ("after_rad", MEASURED)):
                axes.plot(t, 1e3 * (measured - trace[key]), color=colour, lw=0.8, label=key[:-4])
        hidden = ", ".join((*c.hidden, *(f"{n} (ordinary)" for n in c.ordinary))) or NOTHING
        named = ", ".join(f"{n.effect} {n.probability:.2f}" for n in c.named)
        size = "" if math.isnan(c.ratio) else f", {c.ratio:.1f} x"
        axes.set_title(f"{c.case} ({c.kind}{size}): {hidden}; named {named}", fontsize=8)
        axes.set_ylabel("mrad")
    all_axes[0].legend(loc="upper right", ncols=2)
    all_axes[-1].set_xlabel("time [s]")
    return figure


def draw(cases: Sequence[Judged], folder: Path, answers: Path) -> dict[str, Path]:
    """Draw all figures into a folder; paths by name."""
    made: dict[str, Figure | None] = {
        "power": power(cases),
        "confusion": confusion(cases),
        "calibration": calibration(cases),
        "coverage": coverage(cases),
        "explained": explained(cases),
        "failures": failures(cases, answers),
    }
    return saved(made, folder)


def saved(made: Mapping[str, Figure | None], folder: Path) -> dict[str, Path]:
    """Save the figures that there are into a folder; paths by name."""
    folder.mkdir(exist_ok=True)
    return {name: save(f, folder / f"{name}.png") for name, f in made.items() if f is not None}
