"""The joints of a walk over the phase of the gait, laid out as the thesis has its walks.

A column a leg, a row a joint: goal, real and model, and below what real and model differ by, as in
figures 36 and 37 of the thesis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bench.figures.gait import LEGS
from bench.figures.style import GOAL, MEASURED, MODELLED, STANCE, START, styled
from busemu.tables import Robot
from hal.legs import PARTS

from ..observed import held_at
from .gait import Bins, Phase, commanded_lift, gait_phase
from .judging import Judgement

Floats = NDArray[np.float64]


@styled
def phase_figure(robot: Robot, before: Judgement, after: Judgement, title: str = "") -> Figure:
    """One recording under the believed model and the better one, means over the phase.

    Without a gait the picture is over time.
    """
    course = before.course
    phase = gait_phase(course.goals, robot)
    figure = Figure(figsize=(13.6, 9.6), layout="constrained")
    grid = figure.subplots(
        2 * len(PARTS), len(LEGS), sharex=True, sharey="row", height_ratios=[2, 1] * len(PARTS)
    )
    figure.suptitle(title or course.name, x=0.01, ha="left", fontsize=11.0, fontweight="bold")
    names = [mount.joint for mount in robot.servos]
    legs = [str(leg["name"]) for leg in robot.document["leg"]]
    for column, (leg, words) in enumerate(LEGS.items()):
        grid[0, column].set_title(f"{words}\n({leg})")
        for number, part in enumerate(PARTS):
            joint = names.index(f"{leg}.{part}")
            t = course.sample_s[joint]
            lifted = commanded_lift(course.goals, robot, t)[:, legs.index(leg)]
            rows = [
                held_at(course.goals[f"{leg}.{part}"], t),
                course.position_rad[joint],
                before.modelled_rad[joint],
                after.modelled_rad[joint],
                lifted.astype(np.float64),
            ]
            x, (goal, real, was, now, swings) = _means(phase, t, rows)
            above, below = grid[2 * number, column], grid[2 * number + 1, column]
            for axes in (above, below):
                _shade(axes, x, swings < 0.5)
            above.plot(x, np.degrees(goal), color=GOAL)
            above.plot(x, np.degrees(real), color=MEASURED)
            above.plot(x, np.degrees(was), color=MODELLED, linestyle="--")
            above.plot(x, np.degrees(now), color=START, linestyle=":")
            below.axhline(0.0, color=GOAL, linewidth=0.7)
            below.plot(x, np.degrees(real - was), color=MODELLED)
            below.plot(x, np.degrees(real - now), color=START)
            if column == 0:
                above.set_ylabel(f"{part} [°]")
                below.set_ylabel("real - model")
        grid[-1, column].set_xlabel("time [s]" if phase is None else "phase")
        if phase is not None:
            grid[-1, column].set_xlim(0.0, 1.0)
    handles = [
        Line2D([], [], color=GOAL, label="goal"),
        Line2D([], [], color=MEASURED, label="real"),
        Line2D([], [], color=MODELLED, linestyle="--", label="model before"),
        Line2D([], [], color=START, linestyle=":", label="model after"),
    ]
    figure.legend(handles=handles, loc="outside lower right", ncols=4)
    return figure


def _means(phase: Phase | None, t_s: Floats, rows: Sequence[Floats]) -> tuple[Floats, list[Floats]]:
    if phase is None:
        return t_s, list(rows)
    bins = Bins.of_phase(phase, t_s)
    return bins.t_s / phase.period_s, [bins.mean(row) for row in rows]


def _shade(axes: Axes, x: Floats, stands: NDArray[np.bool_]) -> None:
    """Grey where the foot is commanded to stand."""
    if len(x) < 2:
        return
    half = 0.5 * float(np.median(np.diff(x)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int8)))
    for first, last in edges.reshape(-1, 2):
        axes.axvspan(x[first] - half, x[last - 1] + half, color=STANCE, linewidth=0, zorder=0)
