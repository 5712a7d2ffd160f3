"""Torque analysis: the tibia's motion, the torques of three joints, and the load recovered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.figures.style import GOAL, INK, MEASURED, MODELLED, START, STOP, styled
from busemu.wording import amount

from ..weighing import DUTY, PAST_FRICTION

if TYPE_CHECKING:
    from ..torque_analysis_result import TorqueAnalysis

LOAD_COLOURS = (START, MEASURED, MODELLED)
#: Width of the loads' axis where there is only one load [g].
ONE_LOAD_G = 200.0


@styled
def torque_analysis_figure(result: TorqueAnalysis) -> Figure:
    """A thin line a repeat from the position error, a broad one a load for the true torque.

    A fifth panel, right of the thesis's four, where the robot was weighed.
    """
    weighed = bool(result.weighings)
    figure = Figure(figsize=(13.2 if weighed else 9.6, 6.8), layout="constrained")
    cells = figure.add_gridspec(2, 3 if weighed else 2)
    first = figure.add_subplot(cells[0, 0])
    grid = np.array(
        [
            [first, figure.add_subplot(cells[0, 1], sharex=first)],
            [figure.add_subplot(cells[1, at], sharex=first) for at in (0, 1)],
        ]
    )
    for axes in grid[0]:
        axes.tick_params(labelbottom=False)
    if weighed:
        _load(figure.add_subplot(cells[:, 2]), result)
    figure.suptitle(
        f"Torque analysis: {result.robot}, {result.leg} extends its tibia, "
        f"{amount(result.repeats, 'repeat')} a load",
        x=0.01,
        ha="left",
        fontsize=11.0,
        fontweight="bold",
    )
    _motion(grid[0, 0], result)
    for axes, part in zip(
        (grid[0, 1], grid[1, 0], grid[1, 1]), ("coxa", "femur", "tibia"), strict=True
    ):
        _torque(axes, result, part)
    for axes in grid[1]:
        axes.set_xlabel("time since the tibia began to move [s]")
    low = min(axes.get_ylim()[0] for axes in (grid[0, 1], grid[1, 0], grid[1, 1]))
    high = max(axes.get_ylim()[1] for axes in (grid[0, 1], grid[1, 0], grid[1, 1]))
    for axes in (grid[0, 1], grid[1, 0], grid[1, 1]):
        axes.set_ylim(low, high)
    _legend(figure, result)
    return figure


def _motion(axes: Axes, result: TorqueAnalysis) -> None:
    for load_kg, colour in zip(result.loads_kg, LOAD_COLOURS, strict=False):
        for course in result.of("tibia", load_kg):
            axes.plot(course.t_s, np.degrees(course.goal_rad), color=GOAL, linewidth=0.9, zorder=1)
            axes.plot(course.t_s, np.degrees(course.position_rad), color=colour, linewidth=0.8)
    axes.set_title("tibia: the motion (grey: goal)")
    axes.set_ylabel("angle [°]")


def _torque(axes: Axes, result: TorqueAnalysis, part: str) -> None:
    for sign in (-1.0, 1.0):
        axes.axhline(sign * result.stall_at_nm, color=STOP, linewidth=0.9, linestyle=":")
    for load_kg, colour in zip(result.loads_kg, LOAD_COLOURS, strict=False):
        every = result.of(part, load_kg)
        if every and not np.isnan(every[0].true_nm).all():
            axes.plot(every[0].t_s, every[0].true_nm, color=colour, linewidth=2.4, alpha=0.3)
        for course in every:
            torque = np.where(course.before, course.past_friction_nm, np.nan)
            axes.plot(course.t_s, torque, color=colour, linewidth=0.7)
            if not np.isnan(course.shut_down_s):
                at = int(np.flatnonzero(course.before)[-1])
                axes.plot(
                    course.t_s[at], torque[at], "x", color=STOP, markersize=7,
                    markeredgewidth=1.6, zorder=4,
                )  # fmt: skip
    axes.set_title(part)
    axes.set_ylabel("torque [N m]")


def _load(axes: Axes, result: TorqueAnalysis) -> None:
    known = [load_kg * 1e3 for load_kg in result.loads_kg]
    beside = 0.08 * max(max(known) - min(known), ONE_LOAD_G)
    axes.set_xlim(min(known) - beside, max(known) + beside)
    axes.axline((0.0, 0.0), slope=1.0, color=GOAL, linewidth=2.4, alpha=0.5, label="true load")
    ways = ((DUTY, "o", "none", "duty x stall"), (PAST_FRICTION, "o", "full", "and friction"))
    for how, marker, fill, label in ways:
        for load_kg, colour in zip(result.loads_kg, LOAD_COLOURS, strict=False):
            every = [w.mean_kg(how) * 1e3 for w in result.weighed(load_kg)]
            axes.plot(
                [load_kg * 1e3] * len(every), every, marker, color=colour, markersize=6,
                fillstyle=fill, alpha=0.8,
            )  # fmt: skip
        axes.plot([], [], marker, color=INK, markersize=6, fillstyle=fill, label=label)
    axes.set_title("load on the trunk, by what the feet carry")
    axes.set_xlabel("true load [g]")
    axes.set_ylabel("load from joint data [g]")
    axes.legend(loc="upper left")


def _legend(figure: Figure, result: TorqueAnalysis) -> None:
    handles = [
        Line2D([], [], color=colour, label=f"+{load_kg * 1e3:.0f} g")
        for load_kg, colour in zip(result.loads_kg, LOAD_COLOURS, strict=False)
    ]
    if any(not np.isnan(course.true_nm).all() for course in result.courses):
        handles.append(
            Line2D([], [], color=GOAL, linewidth=2.4, alpha=0.5, label="true torque, first repeat")
        )
    handles.append(Line2D([], [], color=INK, linewidth=0.7, label="from position error"))
    handles.append(Line2D([], [], color=STOP, linestyle=":", label="stall torque"))
    if any(not np.isnan(course.shut_down_s) for course in result.courses):
        handles.append(
            Line2D([], [], color=STOP, marker="x", linestyle="", label="servo shut down")
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
