"""What all figures share: colours, sizes, grids, and writing a file without a display."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..files import replacing

INK = "#22272e"
GRID = "#e3e6ea"
GOAL = "#8a919c"
MEASURED = "#0b6bcb"
MODELLED = "#e07b00"
STANCE = "#e4e9f0"
START = "#2e8b57"
STOP = "#c0392b"

#: dots an inch of pictures made of dots
DPI = 150

#: rcParams; the names' type differs between matplotlib's versions
_LOOK: Mapping[Any, Any] = MappingProxyType(
    {
        "font.size": 9.0,
        "axes.titlesize": 10.0,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.labelcolor": INK,
        "axes.edgecolor": "#a5acb5",
        "axes.linewidth": 0.8,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": GRID,
        "grid.linewidth": 0.8,
        "xtick.color": INK,
        "ytick.color": INK,
        "text.color": INK,
        "legend.frameon": False,
        "legend.fontsize": 8.5,
        "lines.linewidth": 1.3,
        "svg.hashsalt": "busemu",
    }
)


#: decorator of every function that draws: its figure gets the common style
styled = mpl.rc_context(dict(_LOOK))


def panels(
    count: int, width_in: float, height_in: float, title: str = "", *, share_x: bool = False
) -> tuple[Figure, list[Axes]]:
    """Make a figure of ``count`` panels below each other, in the common style; sizes in inches."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = figure.subplots(max(count, 1), 1, sharex=share_x, squeeze=False)[:, 0]
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11.0, fontweight="bold")
    return figure, list(axes)


@styled
def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as what the suffix says (``.png``, ``.svg``, ``.pdf``); returns the path.

    The file is whole or not there. Raises ``ValueError`` for another suffix, and ``OSError``.
    """
    path = Path(path)
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix.removeprefix("."), dpi=DPI)
    return path
