"""The landscape of a search: speed over ``v_left`` and ``v_right``, and what forbids the rest."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke

from ..figures.style import GOAL, INK, MEASURED, MODELLED, STOP, styled
from .candidate import STRIDES
from .methods import Method
from .outcome import Outcome, Reason, best

if TYPE_CHECKING:
    from .search import Found, Result

#: Colour, mark and hatching of what forbids a walk. Marks show the gravest reason, cells all.
REASONS = {
    Reason.FALL: ("#5d4a7a", "v", "...."),
    Reason.SELF_COLLISION: (STOP, "X", "////"),
    Reason.TORQUE: (MODELLED, "^", "\\\\\\\\"),
}
READABLE = [withStroke(linewidth=2.5, foreground="white")]  # on any colour
COLOURS = {Method.CMA: MEASURED, Method.GRID: GOAL}
TITLES = {
    Method.GRID: "Grid: strides only",
    Method.CMA: "CMA-ES: strides, period, lift, duty, posture",
}


class _Scale:
    """Colours of speeds, from standing still to the fastest [mm/s]."""

    def __init__(self, fastest_mm_s: float) -> None:
        self.bar = ScalarMappable(Normalize(0.0, fastest_mm_s), "viridis")

    def __call__(self, walk: Outcome) -> str:
        (colour,) = self.bar.to_rgba(np.array([walk.speed_m_s * 1e3]))
        return to_hex(colour)


@styled
def landscape(result: Result) -> Figure:
    """A panel a method, and how the fastest allowed walk came about."""
    every = [outcome for found in result.found for outcome in found.outcomes]
    fastest = max((o.speed_m_s for o in every if o.allowed), default=0.0) * 1e3
    scale = _Scale(max(fastest, 1.0))
    figure = Figure(figsize=(4.6 * (len(result.found) + 1) + 0.6, 5.0), layout="constrained")
    panels = figure.subplots(1, len(result.found) + 1, squeeze=False)[0]
    figure.suptitle(
        f"{result.robot.name}: walks of {result.plan.seconds:g} s, "
        f"at most {result.plan.budget} a method, "
        f"torque below {result.original.torque_limit:g} x stall",
        x=0.01,
        ha="left",
        fontsize=11.0,
        fontweight="bold",
    )
    for axes, found in zip(panels, result.found, strict=False):
        _strides(axes, found, result, scale)
    figure.colorbar(scale.bar, ax=panels[len(result.found) - 1], label="speed, if allowed [mm/s]")
    _course(panels[-1], result)
    _legend(figure, result, every)
    return figure


def _strides(axes: Axes, found: Found, result: Result, scale: _Scale) -> None:
    axes.set_title(TITLES[found.method])
    if found.method is Method.GRID:
        _cells(axes, found.outcomes, scale)
    else:
        _points(axes, found.outcomes, scale)
        axes.set_xlim(0.0, STRIDES[1] + 0.5)
        axes.set_ylim(0.0, STRIDES[1] + 0.5)
    for gain in (1.0, 4.0, 6.0):
        axes.plot(gain, gain, "+", color=INK, markersize=8, zorder=4, path_effects=READABLE)
        axes.annotate(
            f"{gain:g} x",
            (gain, gain),
            (5, -11),
            textcoords="offset points",
            fontsize=8,
            path_effects=READABLE,
            zorder=4,
        )
    chosen = found.checks[0] if found.checks else best(list(found.outcomes))
    if chosen is not None:
        at = chosen.job.candidate
        axes.plot(at.v_left, at.v_right, "o", color=INK, fillstyle="none", markersize=13, zorder=5)
    axes.set_aspect("equal")
    axes.set_xlabel("v_left")
    axes.set_ylabel("v_right")


def _cells(axes: Axes, outcomes: Iterable[Outcome], scale: _Scale) -> None:
    """Walks as the cells of the grid they lie on; what the legs cannot reach stays empty."""
    walks = list(outcomes)
    values = sorted({walk.job.candidate.v_left for walk in walks})
    side = min(np.diff(values), default=1.0)
    for walk in walks:
        at = walk.job.candidate
        corner = at.v_left - 0.5 * side, at.v_right - 0.5 * side
        if walk.allowed:
            axes.add_patch(Rectangle(corner, side, side, facecolor=scale(walk), edgecolor="white"))
        for reason in walk.reasons:
            colour, _, hatch = REASONS[reason]
            axes.add_patch(
                Rectangle(
                    corner,
                    side,
                    side,
                    facecolor="none",
                    edgecolor=colour,
                    hatch=hatch,
                    linewidth=0.0,
                )
            )
    low, high = STRIDES
    axes.grid(visible=False)
    axes.set_xlim(low - 0.5 * side, high + 0.5 * side)
    axes.set_ylim(low - 0.5 * side, high + 0.5 * side)


def _points(axes: Axes, outcomes: Iterable[Outcome], scale: _Scale) -> None:
    for walk in outcomes:
        at = walk.job.candidate
        if walk.allowed:
            colour, mark = scale(walk), "o"
        else:
            colour, mark, _ = REASONS[walk.reasons[0]]
        axes.plot(at.v_left, at.v_right, mark, color=colour, markersize=7,
                  markeredgecolor="white", markeredgewidth=0.6, zorder=3)  # fmt: skip


def _course(axes: Axes, result: Result) -> None:
    axes.set_title("Fastest allowed walk so far")
    for found in result.found:
        speeds = np.array(found.course_m_s) * 1e3
        walks = np.arange(1, len(speeds) + 1)
        colour = COLOURS[found.method]
        axes.step(walks, speeds, where="post", color=colour, label=found.method.value)
        if found.checks:
            checked = found.speed_m_s * 1e3
            axes.plot(len(speeds), checked, "o", color=colour, markersize=6)
    axes.axhline(result.original.speed_m_s * 1e3, color=INK, linestyle=":", label="original gait")
    handles, _ = axes.get_legend_handles_labels()
    handles.append(Line2D([], [], marker="o", linestyle="none", color=GOAL, label="checked, mean"))
    axes.legend(handles=handles, loc="best")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("walks")
    axes.set_ylabel("speed [mm/s]")


def _legend(figure: Figure, result: Result, outcomes: Iterable[Outcome]) -> None:
    shown = {reason for outcome in outcomes for reason in outcome.reasons}
    handles: list[Any] = []  # the type hints of matplotlib know no pairs
    labels = []
    for reason, (colour, mark, hatch) in REASONS.items():
        if reason in shown:
            cell = Patch(facecolor="none", edgecolor=colour, hatch=hatch, linewidth=0.0)
            point = Line2D([], [], marker=mark, linestyle="none", color=colour, mec="white")
            handles.append((cell, point))
            labels.append(reason.value)
    ring = Line2D([], [], marker="o", linestyle="none", color=INK, fillstyle="none", markersize=10)
    handles.append(ring)
    labels.append("chosen")
    if any(_has_gaps(found) for found in result.found):
        handles.append(Patch(facecolor="white", edgecolor=GOAL, linewidth=0.6))
        labels.append("out of the legs' reach, not walked")
    figure.legend(handles, labels, loc="outside lower left", ncols=len(handles))


def _has_gaps(found: Found) -> bool:
    """Whether a grid has strides that were not walked."""
    values = {walk.job.candidate.v_left for walk in found.outcomes}
    return found.method is Method.GRID and len(found.outcomes) < len(values) ** 2
