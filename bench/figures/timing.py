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
#: height of a line, and where there are many of them, in inches
ROW_IN, LOW_ROW_IN, MANY_ROWS = 0.62, 0.3, 12
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
    height_in = ROW_IN if len(rows) <= MANY_ROWS else LOW_ROW_IN
    figure, (axes,) = panels(1, 8.0, 1.2 + height_in * max(len(rows), 1), title)
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
