"""The picture of the stance study: every run's misfit before and after, and what was said of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from bench.figures.style import GOAL, MODELLED, START, styled

if TYPE_CHECKING:
    from .stance import Answer


@styled
def summary_figure(answers: Sequence[Answer]) -> Figure:
    """Every run's misfit with tolerances fitted and with what was found; and the answers.

    Of the walk that was held out, which was under the other load.
    """
    figure = Figure(figsize=(9.6, 0.32 * len(answers) + 1.6), layout="constrained")
    axes = figure.subplots()
    labels = []
    for row, answer in enumerate(answers):
        fit = answer.diagnosis["fit"]
        before, after, floor = (1e3 * fit[key] for key in ("before", "after", "noise_floor"))
        axes.plot([before, after], [row, row], color=GOAL, linewidth=1.0)
        axes.plot(before, row, "o", color=MODELLED, label="tolerances fitted" if not row else None)
        axes.plot(after, row, "o", color=START, label="with what was found" if not row else None)
        axes.plot(floor, row, "|", color=GOAL, label="noise" if not row else None)
        labels.append(
            f"{answer.run.name}, {answer.part.name}: {answer.cause.value} "
            f"(true: {answer.run.cause.value}) {answer.word}"
        )
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel("joints of a walk under the other load, real less model, RMS [mrad]")
    figure.legend(loc="outside lower right", ncols=3)
    return figure
