"""Durations of bus transactions: measured, modelled, and what the thesis found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .style import INK, MEASURED, MODELLED, panels, styled

Floats = NDArray[np.float64]

#: whiskers reach from and to these percentiles
WHISKERS = (5.0, 95.0)
MS = 1e3
#: the thesis's mark stands this far below its bar
THESIS_OFFSET = 0.34


@dataclass(frozen=True, slots=True, eq=False)
class TimingRow:
    """One kind of transaction (``"reading all 18"``); durations in seconds."""

    kind: str
    measured_s: Floats  #: shape (transactions,)
    modelled_s: float | None = None
    thesis_s: float | None = None
    thesis_is_bound: bool = False  #: the thesis says "within", not "takes"

    @property
    def summary_s(self) -> tuple[float, float, float]:
        """5th percentile, median, 95th percentile of what was measured [s]; NaN for nothing."""
        if not len(self.measured_s):
            return (float("nan"),) * 3
        low, middle, high = np.percentile(self.measured_s, (WHISKERS[0], 50.0, WHISKERS[1]))
        return float(low), float(middle), float(high)


@styled
def timing_figure(rows: Sequence[TimingRow], *, title: str = "Time a transaction takes") -> Figure:
    """Draw, a line a kind: median with 5-95 % whiskers, the model's value, the thesis's value."""
    figure, (axes,) = panels(1, 8.0, 1.2 + 0.62 * max(len(rows), 1), title)
    places = np.arange(len(rows), dtype=np.float64)
    summary = np.array([row.summary_s for row in rows]).reshape(-1, 3) * MS
    low, middle, high = summary.T
    axes.barh(places, middle, height=0.42, color=MEASURED, alpha=0.22, linewidth=0)
    axes.errorbar(
        middle,
        places,
        xerr=np.maximum([middle - low, high - middle], 0.0),
        fmt="o",
        color=MEASURED,
        markersize=5,
        capsize=4,
        elinewidth=1.4,
        label="measured: median, 5–95 %",
    )
    _marks(axes, [r.modelled_s for r in rows], "modelled", marker="|", color=MODELLED, size=15.0)
    _marks(
        axes,
        [r.thesis_s for r in rows],
        "thesis",
        marker="D",
        color=INK,
        size=5.0,
        offset=THESIS_OFFSET,
    )
    for place, row in zip(places, rows, strict=True):
        axes.annotate(
            "-" if np.isnan(middle[int(place)]) else f"{middle[int(place)]:.2f} ms",
            (1.0, place),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            color=MEASURED,
            fontsize=8.5,
        )
        if row.thesis_s is not None and row.thesis_is_bound:
            axes.annotate(
                "at most",
                (row.thesis_s * MS, place + THESIS_OFFSET),
                xytext=(7, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.0,
            )
    axes.set_yticks(places, [row.kind for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.5)
    axes.set_xlim(left=0.0)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("time [ms]")
    figure.legend(loc="upper right", ncols=3)
    return figure


@styled
def histogram_figure(
    durations_s: Floats, *, marks_s: dict[str, float] | None = None, title: str = "", bins: int = 60
) -> Figure:
    """Draw how often each duration came; ``durations_s`` of shape (n,), named lines at ``marks_s``.

    The highest 0.1 % are gathered in the last bin, so that one stall does not flatten the rest;
    the longest is named.
    """
    figure, (axes,) = panels(1, 8.0, 2.8, title)
    if len(durations_s):
        top = float(np.percentile(durations_s, 99.9)) * MS
        shown = np.minimum(durations_s * MS, top)
        axes.hist(shown, bins=bins, color=MEASURED, alpha=0.85, linewidth=0)
        axes.set_title(
            f"{len(durations_s)} transactions, median {np.median(durations_s) * MS:.3f} ms, "
            f"longest {np.max(durations_s) * MS:.3f} ms",
            fontweight="normal",
            fontsize=9,
        )
    for (name, at_s), colour in zip((marks_s or {}).items(), (INK, MODELLED) * 8, strict=False):
        axes.axvline(at_s * MS, color=colour, linestyle="--", linewidth=1.2, label=name)
    if marks_s:
        axes.legend(loc="upper right")
    axes.set_xlabel("time [ms]")
    axes.set_ylabel("transactions")
    return figure


def _marks(
    axes: Axes,
    values: Sequence[float | None],
    label: str,
    *,
    marker: str,
    color: str,
    size: float,
    offset: float = 0.0,
) -> None:
    there = [
        (value * MS, place + offset) for place, value in enumerate(values) if value is not None
    ]
    if there:
        x, y = zip(*there, strict=True)
        axes.plot(
            x,
            y,
            marker,
            color=color,
            markersize=size,
            markeredgewidth=2.2 if marker == "|" else 1.0,
            label=label,
            zorder=4,
        )
