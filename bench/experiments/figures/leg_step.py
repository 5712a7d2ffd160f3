"""Leg step: a column a joint, the step up above the step down."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.figures.style import GOAL, MEASURED, MODELLED, styled
from busemu.wording import amount

if TYPE_CHECKING:
    from ..leg_step_result import LegStep

#: What is drawn before the goal [s], and how much of the time after it: the rest is rest.
BEFORE_S, SHOWN_S = 0.03, 0.5


@styled
def leg_step_figure(result: LegStep) -> Figure:
    """Positions of all repeats over time, with the goal and the true angle where it is known."""
    columns = len(result.parts)
    figure = Figure(figsize=(max(3.4 * columns, 5.0), 5.8), layout="constrained")
    grid = figure.subplots(2, columns, sharex=True, squeeze=False)
    whose = f"{result.robot}, {result.leg}" if result.leg else result.robot
    figure.suptitle(
        f"Leg step: {whose}, {amount(result.repeats, 'repeat')}, "
        f"a position every {result.period_s * 1e3:.1f} ms",
        x=0.01,
        ha="left",
        fontsize=11.0,
        fontweight="bold",
    )
    for column, part in enumerate(result.parts):
        for row, outward in enumerate((True, False)):
            _panel(grid[row, column], result, part, outward=outward)
        grid[0, column].set_title(part)
        grid[1, column].set_xlabel("time since the goal was sent [ms]")
    for axes in grid[:, 0]:
        axes.set_ylabel("angle [°]")
    handles = [
        Line2D([], [], color=GOAL, label="goal"),
        Line2D(
            [], [], color=MEASURED, marker=".", markersize=4, linewidth=0.6, label="position read"
        ),
    ]
    if any(not np.isnan(step.true_rad).all() for step in result.steps):
        handles.append(
            Line2D([], [], color=MODELLED, linewidth=0.9, label="true angle, first repeat")
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _panel(axes: Axes, result: LegStep, part: str, *, outward: bool) -> None:
    every = result.of(part, outward=outward)
    for step in every:
        axes.plot(
            step.t_s * 1e3, np.degrees(step.position_rad), ".-", color=MEASURED, markersize=2.5,
            linewidth=0.5, alpha=0.7,
        )  # fmt: skip
    if not every:
        return
    first = every[0]
    axes.plot(first.t_s * 1e3, np.degrees(first.true_rad), color=MODELLED, linewidth=0.9)
    goal = np.degrees([first.start_rad, first.start_rad, first.goal_rad, first.goal_rad])
    axes.plot(
        np.array([-BEFORE_S, 0.0, 0.0, SHOWN_S]) * 1e3, goal, color=GOAL, linewidth=1.1, zorder=1
    )
    axes.set_xlim(-BEFORE_S * 1e3, SHOWN_S * 1e3)
    axes.margins(y=0.12)
    rise = np.nanmean([step.answer.rise_s for step in every]) * 1e3
    over = np.mean([step.answer.overshoot for step in every])
    error = np.degrees(np.mean([step.answer.steady_error_rad for step in every]))
    error = round(float(error), 2) + 0.0  # no minus before a zero
    axes.annotate(
        f"rise {rise:.0f} ms\novershoot {over:.1%}\nsteady error {error:+.2f}°",
        (0.97, 0.08 if outward else 0.92),
        xycoords="axes fraction",
        ha="right",
        va="bottom" if outward else "top",
        fontsize=8.5,
    )
