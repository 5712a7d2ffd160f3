"""Pictures of the stance study, laid out as the thesis has its walks: joints over gait phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bench.diagnosis.robot_features import RobotKind
from bench.diagnosis.robot_model import ENGINES_RAD
from bench.figures.gait import LEGS
from bench.figures.style import GOAL, MEASURED, MODELLED, STANCE, styled
from hal.legs import PARTS

if TYPE_CHECKING:
    from bench.diagnosis.robot_model import RobotModel

    from .stance import Answer

Floats = NDArray[np.float64]


@styled
def joints_figure(model: RobotModel, r: int, modelled_rad: Floats, title: str) -> Figure:
    """One recording: a column a leg, a row a joint; goal, real and model over the gait's phase.

    ``modelled_rad`` are a model's joint rows. Below each pair of angles stands the difference.
    """
    features = model.features[r]
    assert features.phase is not None
    names = [joint.name for joint in model.base.joints]
    figure = Figure(figsize=(13.6, 9.6), layout="constrained")
    grid = figure.subplots(
        2 * len(PARTS), len(LEGS), sharex=True, sharey="row", height_ratios=[2, 1] * len(PARTS)
    )
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.0, fontweight="bold")
    recorded = model.recorded(r, RobotKind.JOINTS)
    for column, (leg, words) in enumerate(LEGS.items()):
        grid[0, column].set_title(f"{words}\n({leg})")
        for number, part in enumerate(PARTS):
            mine = features.joint_row == names.index(f"{leg}.{part}")
            phase = (features.t_s[mine] % 1000.0) / features.phase.period_s
            above, below = grid[2 * number, column], grid[2 * number + 1, column]
            for axes in (above, below):
                _shade(axes, phase, features.stance[mine])
            above.plot(phase, np.degrees(features.goal_rad[mine]), color=GOAL)
            above.plot(phase, np.degrees(recorded[mine]), color=MEASURED)
            above.plot(phase, np.degrees(modelled_rad[mine]), color=MODELLED, linestyle="--")
            below.axhline(0.0, color=GOAL, linewidth=0.7)
            below.plot(phase, np.degrees(recorded[mine] - modelled_rad[mine]), color=MEASURED)
            if column == 0:
                above.set_ylabel(f"{part} [°]")
                below.set_ylabel("real - model")
        grid[-1, column].set_xlabel("phase")
        grid[-1, column].set_xlim(0.0, 1.0)
    handles = [
        Line2D([], [], color=GOAL, label="goal"),
        Line2D([], [], color=MEASURED, label="real"),
        Line2D([], [], color=MODELLED, linestyle="--", label="model"),
    ]
    figure.legend(handles=handles, loc="outside lower right", ncols=3)
    return figure


def _shade(axes: Axes, phase: Floats, stance: NDArray[np.bool_]) -> None:
    half = 0.5 / max(len(phase), 1)
    for x in phase[stance]:
        axes.axvspan(x - half, x + half, color=STANCE, linewidth=0, zorder=0)


@styled
def summary_figure(answers: Sequence[Answer]) -> Figure:
    """What every run's misfit was as believed, with nuisances, and at the end; and the answers."""
    figure = Figure(figsize=(8.6, 0.32 * len(answers) + 1.6), layout="constrained")
    axes = figure.subplots()
    labels = []
    for row, answer in enumerate(answers):
        before = 1e3 * answer.findings.rms_before_rad
        after = 1e3 * answer.findings.rms_after_rad
        axes.plot([before, after], [row, row], color=GOAL, linewidth=1.0)
        for x, colour in ((before, GOAL), (after, MODELLED)):
            axes.plot(x, row, "o", color=colour)
        labels.append(
            f"{answer.run.name}, {answer.channels}: {answer.cause.value} "
            f"(true: {answer.run.cause.value}) {answer.word}"
        )
    axes.axvline(1e3 * ENGINES_RAD, color=GOAL, linestyle=":")
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel("RMS of real less model over gait phase [mrad]; dotted: what engines differ by")
    handles = [
        Line2D([], [], color=colour, marker="o", linestyle="", label=words)
        for colour, words in (
            (GOAL, "with nuisances"),
            (MODELLED, "with what was found"),
        )
    ]
    axes.legend(handles=handles, loc="best")
    return figure
