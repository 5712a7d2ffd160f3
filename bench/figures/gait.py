"""Gait diagrams: which foot is down when."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .style import INK, panels, styled

Floats = NDArray[np.float64]

#: legs from the top row down: left side front to rear, then right side; the tripods alternate
LEGS: Mapping[str, str] = MappingProxyType(
    {
        "leg1": "left front",
        "leg5": "left middle",
        "leg3": "left rear",
        "leg2": "right front",
        "leg6": "right middle",
        "leg4": "right rear",
    }
)
#: a foot that presses harder than this is down
CONTACT_N = 0.05
BAR_HEIGHT = 0.62


def spans(t_s: Floats, down: NDArray[np.bool_]) -> Floats:
    """Turn samples into spans in which the foot is down: starts and ends [s], shape (n, 2).

    ``t_s`` and ``down`` are of shape (samples,); a sample holds until the next one, and a span that
    is open at the end ends with the last sample. Spans of no length are left out.
    """
    if not len(t_s):
        return np.empty((0, 2))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], down, [False]]).astype(np.int8)))
    found = np.append(t_s, t_s[-1])[edges].reshape(-1, 2)
    kept: Floats = found[found[:, 1] > found[:, 0]]
    return kept


def contact_spans(t_s: Floats, force_n: Floats, threshold_n: float = CONTACT_N) -> Floats:
    """Find spans in which a foot presses harder than ``threshold_n`` [N], as :func:`spans`."""
    return spans(t_s, force_n > threshold_n)


def duty_factor(stance: Floats, duration_s: float) -> float:
    """Tell the share of ``duration_s`` in which a foot is down."""
    return float((stance[:, 1] - stance[:, 0]).sum() / duration_s) if duration_s > 0.0 else 0.0


@styled
def gait_figure(
    stances: Mapping[str, Floats],
    *,
    window_s: tuple[float, float] | None = None,
    title: str = "Gait: black where the foot is down, and for how much of the time",
) -> Figure:
    """Draw a row a leg with a bar for every span in which its foot is down.

    ``stances``: spans [s] of shape (n, 2) by leg (``leg1`` to ``leg6``; others are drawn below by
    their own names). ``window_s``: from when to when is drawn, all of it by default; the share of
    it in which a foot is down stands at the right.
    """
    names = [leg for leg in LEGS if leg in stances] + [leg for leg in stances if leg not in LEGS]
    ends = [stances[leg] for leg in names if len(stances[leg])]
    if window_s is None and ends:
        window_s = (min(s[0, 0] for s in ends), max(s[-1, 1] for s in ends))
    start_s, stop_s = window_s or (0.0, 1.0)
    figure, (axes,) = panels(1, 8.0, 0.9 + 0.34 * max(len(names), 1), title)
    for row, leg in enumerate(names):
        shown = np.clip(stances[leg], start_s, stop_s)
        shown = shown[shown[:, 1] > shown[:, 0]]
        bars = [(a, b - a) for a, b in shown.tolist()]
        axes.broken_barh(bars, (row - BAR_HEIGHT / 2, BAR_HEIGHT), facecolors=INK, linewidth=0)
        share = duty_factor(shown, stop_s - start_s)
        axes.annotate(
            f"{share:.0%}",
            (1.0, row),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
        )
    axes.set_yticks(range(len(names)), [f"{LEGS.get(n, '')} ({n})".lstrip() for n in names])
    axes.set_ylim(max(len(names), 1) - 0.5, -0.5)
    axes.set_xlim(start_s, stop_s)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("time [s]")
    return figure
