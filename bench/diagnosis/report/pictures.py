"""Pictures of a report: recorded against modelled motion, and where the difference lives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.figures.style import GOAL, INK, panels, styled

from .inline import AFTER, BAND, BEFORE
from .traces import Trace, rms
from .words import phase

Floats = NDArray[np.float64]

WIDTH_IN = 8.6
POINTS = 1600  #: of a line; a page is wide enough for no more
CLOSE_S = 0.6  #: how much of a motion is shown closely
SPANS = 40  #: of time, in the picture of the misfit over time
MOST_JOINTS = 6  #: in the picture of parts of the motion: those missed by most
MOST_RECORDINGS = 24  #: in the picture of recordings: the worst
ALL = "all of it"
MARK = 0.35  #: how far a bar stands from the middle of its row


@styled
def motion_picture(trace: Trace, floor_rad: float) -> Figure:
    """Draw one recording: the whole motion, the stretch missed by most, the misfit over time."""
    figure, (whole, close, misfit) = panels(3, WIDTH_IN, 7.0)
    start, end = worst_stretch(trace)
    near = (trace.t_s >= start) & (trace.t_s <= end)
    t = trace.t_s
    for axes, part in ((whole, np.ones(len(t), bool)), (close, near)):
        for values, colour, name, width in (
            (trace.goal_rad, GOAL, "goal", 0.9),
            (trace.measured_rad, INK, "recorded", 1.8),
            (trace.before_rad, BEFORE, "model before", 1.5),
            (trace.after_rad, AFTER, "model after", 1.1),
        ):
            if not np.isnan(values).all():
                line = _thin(t[part], np.degrees(values[part]))
                axes.plot(*line, color=colour, lw=width, label=name)
        axes.set_ylabel("angle [°]")
    whole.axvspan(start, end, color=BAND, lw=0.0, zorder=0)
    whole.set_title("motion")
    whole.legend(loc="lower left", bbox_to_anchor=(0.25, 1.0), ncols=4, borderaxespad=0.2)
    close.set_title("the shaded stretch, where the model before is farthest off")
    close.set_xlim(start, end)
    seen = np.concatenate(
        [v[near] for v in (trace.measured_rad, trace.before_rad, trace.after_rad)]
    )
    _limit(close, np.degrees(seen))
    _floor(misfit, floor_rad)
    for values, colour, width in ((trace.before_rad, BEFORE, 1.5), (trace.after_rad, AFTER, 1.0)):
        left = np.degrees(trace.measured_rad - values)
        misfit.plot(*_thin(t, left), color=colour, lw=width)
    misfit.set_title("recorded less modelled; the band is the floor (rounding, spread of repeats)")
    misfit.set_ylabel("misfit [°]")
    misfit.set_xlabel("time [s]")
    for axes in (whole, misfit):
        axes.set_xlim(t[0], t[-1])
    return figure


@styled
def regime_picture(traces: Sequence[Trace], floor_rad: float) -> Figure:
    """Draw the misfit before and after by part of the motion, a panel a joint."""
    every_joint = dict.fromkeys(trace.joint for trace in traces)
    parts_of = {joint: _by_part([t for t in traces if t.joint == joint]) for joint in every_joint}
    joints = sorted(parts_of, key=lambda joint: -parts_of[joint][ALL][0])[:MOST_JOINTS]
    rows = {joint: parts_of[joint] for joint in joints}
    height = 0.9 + sum(0.45 + 0.42 * len(parts) for parts in rows.values())
    figure, every = panels(len(joints), WIDTH_IN, height, share_x=True)
    for axes, (joint, parts) in zip(every, rows.items(), strict=True):
        at = np.arange(len(parts), dtype=np.float64)
        for offset, column, colour, name in (
            (-0.5, 0, BEFORE, "before"),
            (0.5, 1, AFTER, "after"),
        ):
            widths = np.degrees([row[column] for row in parts.values()])
            axes.barh(at + MARK * offset, widths, MARK, color=colour, label=name)
        axes.axvline(np.degrees(floor_rad), color=INK, lw=1.0, ls=":", label="floor")
        shares = [f"{phase(part)} ({100 * row[2]:.0f} %)" for part, row in parts.items()]
        axes.set_yticks(at, shares)
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_title(joint)
    every[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    every[-1].set_xlabel("misfit, root mean square [°]; in brackets: share of the time")
    return figure


@styled
def time_picture(traces: Sequence[Trace], floor_rad: float) -> Figure:
    """Draw the misfit over the time since a recording began, all recordings together."""
    figure, (axes,) = panels(1, WIDTH_IN, 2.5)
    end = max(float(trace.t_s[-1]) for trace in traces)
    edges = np.linspace(0.0, end, SPANS + 1)
    _floor(axes, floor_rad, both=False)
    for name, colour in (("before", BEFORE), ("after", AFTER)):
        squares = np.zeros(SPANS)
        counts = np.zeros(SPANS)
        for trace in traces:
            modelled = trace.before_rad if name == "before" else trace.after_rad
            span = np.clip(np.searchsorted(edges, trace.t_s, side="right") - 1, 0, SPANS - 1)
            squares += np.bincount(span, (trace.measured_rad - modelled) ** 2, SPANS)
            counts += np.bincount(span, minlength=SPANS)
        there = counts > 0
        level = np.sqrt(squares[there] / counts[there])
        middle = 0.5 * (edges[1:] + edges[:-1])[there]
        axes.plot(middle, np.degrees(level), color=colour, label=name)
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(0.0, end)
    axes.set_xlabel("time since the recording began [s]")
    axes.set_ylabel("misfit, rms [°]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    return figure


@styled
def recordings_picture(traces: Sequence[Trace], floor_rad: float) -> Figure:
    """Draw every recording's misfit, before and after."""
    ordered = sorted(traces, key=lambda trace: -trace.rms_before_rad)[:MOST_RECORDINGS]
    figure, (axes,) = panels(1, WIDTH_IN, 1.1 + 0.27 * len(ordered))
    at = np.arange(len(ordered))
    before = np.degrees([trace.rms_before_rad for trace in ordered])
    after = np.degrees([trace.rms_after_rad for trace in ordered])
    axes.hlines(at, after, before, color=BAND, lw=5.0)
    axes.plot(before, at, "o", color=BEFORE, ms=6, label="before")
    axes.plot(after, at, "o", color=AFTER, ms=6, label="after")
    axes.axvline(np.degrees(floor_rad), color=INK, lw=1.0, ls=":", label="floor")
    several = len({trace.joint for trace in traces}) > 1
    axes.set_yticks(at, [f"{t.name}, {t.joint}" if several else t.name for t in ordered])
    axes.set_ylim(len(ordered) - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("misfit, root mean square [°]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    return figure


def worst_stretch(trace: Trace) -> tuple[float, float]:
    """Begin and end [s] of the stretch in which the believed model is farthest off."""
    squares = (trace.measured_rad - trace.before_rad) ** 2
    first, last = float(trace.t_s[0]), float(trace.t_s[-1])
    starts = np.arange(first, max(first, last - CLOSE_S) + 1e-9, CLOSE_S / 4.0)
    sums = np.concatenate([[0.0], np.cumsum(squares)])
    low = np.searchsorted(trace.t_s, starts)
    high = np.searchsorted(trace.t_s, starts + CLOSE_S)
    start = float(starts[int(np.argmax(sums[high] - sums[low]))])
    return start, min(last, start + CLOSE_S)


def _by_part(traces: Sequence[Trace]) -> dict[str, tuple[float, float, float]]:
    """Misfit before and after [rad] and share of the time: of all, then of parts, worst first."""
    before = np.concatenate([t.measured_rad - t.before_rad for t in traces])
    after = np.concatenate([t.measured_rad - t.after_rad for t in traces])
    found = {}
    for part in dict.fromkeys(name for trace in traces for name in trace.parts):
        mask = np.concatenate([t.parts.get(part, np.zeros(len(t.t_s), bool)) for t in traces])
        if mask.any():
            found[part] = (rms(before[mask]), rms(after[mask]), float(mask.mean()))
    ordered = sorted(found.items(), key=lambda item: -item[1][0])
    return {ALL: (rms(before), rms(after), 1.0), **dict(ordered)}


def _floor(axes: Axes, floor_rad: float, *, both: bool = True) -> None:
    floor = float(np.degrees(floor_rad))
    axes.axhspan(-floor if both else 0.0, floor, color=BAND, lw=0.0, zorder=0, label="floor")


def _limit(axes: Axes, values: Floats) -> None:
    """Show ``values`` and a little more, whatever else is drawn (a goal far away)."""
    low, high = float(np.min(values)), float(np.max(values))
    room = 0.15 * max(high - low, 1e-3)
    axes.set_ylim(low - room, high + room)


def _thin(t_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """A line of at most :data:`POINTS` points: beyond, the extremes of equal spans."""
    if len(t_s) <= POINTS:
        return t_s, values
    edges = np.linspace(0, len(t_s), POINTS // 2 + 1).astype(np.intp)[:-1]
    low, high = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    return np.repeat(t_s[edges], 2), np.column_stack([low, high]).ravel()
