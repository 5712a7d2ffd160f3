"""Figures of robots' cases: where things were found against their size, and what was named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.blind.sizing import RATIOS
from bench.figures.style import GOAL, INK, MEASURED, STOP, styled

from .judging import Judged
from .pictures import confusion, failures, saved
from .robot_scoring import GOALS

JITTER = 0.03  #: of dots that would lie on each other, as a share
WIDEST = 10.0  #: ratio that axes reach at least


@styled
def places(cases: Sequence[Judged]) -> Figure:
    """Joint groups and phases of every case against its size."""
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    told = [c for c in cases if c.place is not None and math.isfinite(c.ratio)]
    random = np.random.default_rng(0)
    for c in told:
        assert c.place is not None
        x = c.ratio * math.exp(JITTER * random.standard_normal())
        colour = MEASURED if c.first_right or c.set_right else STOP if c.wrong else GOAL
        left.plot([x], [c.place.f1], "o", ms=4, color=colour, alpha=0.8)
        if c.place.true_phase:
            y = float(c.place.phase_right) + JITTER * random.standard_normal()
            right.plot([x], [y], "o", ms=4, color=colour, alpha=0.8)
    for colour, label in (
        (MEASURED, "rightly named"),
        (GOAL, "nothing wrong named"),
        (STOP, "something wrong named"),
    ):
        left.plot([], [], "o", ms=4, color=colour, label=label)
    if not any(c.place.true_phase for c in told if c.place is not None):
        right.text(0.5, 0.5, "no robot walked", transform=right.transAxes, ha="center")
    most = max([WIDEST, *(1.3 * c.ratio for c in told)])
    for axes in (left, right):
        axes.set_xscale("log")
        axes.axvline(3.0, color=INK, lw=0.6, ls=":")
        axes.set_xticks(RATIOS, [f"{ratio:g}" for ratio in RATIOS])
        axes.minorticks_off()
        axes.set(xlabel="size / detection floor", ylim=(-0.12, 1.12), xlim=(0.4, most))
    left.axhline(GOALS["joint_group_f1"][1], color=GOAL, lw=1, ls="--")
    left.set(title="Joints: F1 of told and true", ylabel="F1")
    right.set_yticks([0, 1], ["wrong", "right"])
    right.set(title="Phase of the gait")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def draw_robots(cases: Sequence[Judged], folder: Path, answers: Path) -> dict[str, Path]:
    """Draw all figures of robots' cases into a folder; paths by name."""
    made = {
        "robots": places(cases),
        "robots_confusion": confusion(cases),
        "robots_failures": failures(cases, answers),
    }
    return saved(made, folder)
