"""Locomotion: a column a leg; foot path, joint angles and torques over the gait's phase."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.figures.gait import LEGS
from bench.figures.style import GOAL, INK, MEASURED, MODELLED, STANCE, START, STOP, styled
from busemu.wording import amount
from hal.legs import PARTS

from ..gait_phase import profile

if TYPE_CHECKING:
    from ..locomotion_result import Locomotion

TORQUE_COLOURS = (START, "#7b4fb3", MODELLED)


@styled
def locomotion_figure(result: Locomotion) -> Figure:
    """Means over the cycles of each repeat; stance is shaded, 0.75 x stall dashed."""
    from ..locomotion_result import TORQUE_LIMIT  # noqa: PLC0415

    names = [leg for leg in LEGS if leg in result.legs] or list(result.legs)
    figure = Figure(figsize=(13.6, 10.4), layout="constrained")
    grid = figure.subplots(5, len(names), squeeze=False, sharey="row")
    figure.suptitle(
        f"Locomotion: {result.robot}, {amount(len(result.walks), 'repeat')}, "
        f"stride {result.stride_m(commanded=True) * 1e3:.0f} mm, period {result.period_s:.2f} s",
        x=0.01,
        ha="left",
        fontsize=11.0,
        fontweight="bold",
    )
    for column, leg in enumerate(names):
        grid[0, column].set_title(f"{LEGS.get(leg, '')}\n({leg})".lstrip())
        _path(grid[0, column], result, leg)
        for row, part in enumerate(PARTS, start=1):
            _angle(grid[row, column], result, leg, part)
        _torque(grid[4, column], result, leg, TORQUE_LIMIT)
        grid[4, column].set_xlabel("phase")
        for axes in grid[1:, column]:
            axes.set_xlim(0.0, 1.0)
            axes.axvspan(0.0, result.duty_factor, color=STANCE, linewidth=0, zorder=0)
    for row, label in enumerate(
        ("foot height [mm]", *(f"{part} [°]" for part in PARTS), "torque / stall")
    ):
        grid[row, 0].set_ylabel(label)
    _legend(figure, result)
    return figure


def _path(axes: Axes, result: Locomotion, leg: str) -> None:
    for walk in result.walks:
        course = next(c for c in walk.legs if c.leg == leg)
        ground = float(np.quantile(course.commanded_m[:, 2], 0.1))
        for feet, colour in ((course.commanded_m, GOAL), (course.measured_m, MEASURED)):
            _, ahead = profile(course.phase, feet[:, 1] - course.commanded_m[:, 1].mean())
            _, height = profile(course.phase, feet[:, 2] - ground)
            axes.plot(
                np.append(ahead, ahead[0]) * 1e3, np.append(height, height[0]) * 1e3,
                color=colour, linewidth=0.9,
            )  # fmt: skip
    axes.set_xlabel("foot ahead [mm]")


def _angle(axes: Axes, result: Locomotion, leg: str, part: str) -> None:
    for course in result.courses(part, leg):
        for value, colour in ((course.goal_rad, GOAL), (course.position_rad, MEASURED)):
            phase, angle = profile(course.phase, value)
            axes.plot(phase, np.degrees(angle), color=colour, linewidth=0.9)
    axes.tick_params(labelbottom=False)


def _torque(axes: Axes, result: Locomotion, leg: str, limit: float) -> None:
    for sign in (-1.0, 1.0):
        axes.axhline(sign * limit, color=STOP, linewidth=0.9, linestyle="--")
    for part, colour in zip(PARTS, TORQUE_COLOURS, strict=True):
        for number, course in enumerate(result.courses(part, leg)):
            stall = result.stalls_nm[course.joint]
            phase, torque = profile(course.phase, course.torque_nm / stall)
            axes.plot(phase, torque, color=colour, linewidth=0.8)
            if number == 0 and not np.isnan(course.true_nm).all():
                phase, torque = profile(course.phase, course.true_nm / stall)
                axes.plot(phase, torque, color=colour, linewidth=2.6, alpha=0.3)
    axes.set_ylim(-1.0, 1.0)


def _legend(figure: Figure, result: Locomotion) -> None:
    handles = [
        Line2D([], [], color=GOAL, label="goal"),
        Line2D([], [], color=MEASURED, label="measured by the joints"),
        *(
            Line2D([], [], color=colour, label=f"torque of {part}, from position error")
            for part, colour in zip(PARTS, TORQUE_COLOURS, strict=True)
        ),
    ]
    if any(not np.isnan(c.true_nm).all() for c in result.courses("femur")):
        handles.append(Line2D([], [], color=INK, linewidth=2.6, alpha=0.3, label="true torque"))
    handles.append(Line2D([], [], color=STOP, linestyle="--", label="0.75 × stall"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
