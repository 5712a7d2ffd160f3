"""The body's path from above.

Ground frame: x and y as the trunk's own (x right, y forward) while its yaw is 0. Yaw grows
counter-clockwise, so the trunk looks along ``(-sin yaw, cos yaw)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .style import INK, MEASURED, START, STOP, panels, styled

Floats = NDArray[np.float64]

#: heading arrows along a path
ARROWS = 12
#: a picture's narrow side is at least this share of the longer extent of the path
NARROWEST = 0.8


@dataclass(frozen=True, slots=True)
class Displacement:
    """How far a body went, and how much it turned."""

    distance_m: float  #: from the first point to the last, as the crow flies
    turned_rad: float  #: yaw gained, counter-clockwise; whole turns count
    duration_s: float

    @property
    def speed_m_s(self) -> float:
        """Distance over duration [m/s]; 0 for no duration."""
        return self.distance_m / self.duration_s if self.duration_s > 0.0 else 0.0


def displacement(t_s: Floats, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> Displacement:
    """Measure a path; all of shape (samples,). Raises ``ValueError`` for no samples."""
    if not len(t_s):
        raise ValueError("a path needs at least one sample")
    dx, dy = float(x_m[-1] - x_m[0]), float(y_m[-1] - y_m[0])
    turned = np.unwrap(yaw_rad)
    return Displacement(
        distance_m=float(np.hypot(dx, dy)),
        turned_rad=float(turned[-1] - turned[0]),
        duration_s=float(t_s[-1] - t_s[0]),
    )


@styled
def path_figure(
    t_s: Floats, x_m: Floats, y_m: Floats, yaw_rad: Floats, *, title: str = "Path of the body"
) -> Figure:
    """Draw a path from above, to scale, with start, stop and headings; all of shape (samples,).

    Distance, speed and turn are given below the title. Raises ``ValueError`` for no samples.
    """
    measured = displacement(t_s, x_m, y_m, yaw_rad)
    span_m = max(np.ptp(x_m), np.ptp(y_m), 0.1)
    (low_x, high_x), (low_y, high_y) = (_room(v, NARROWEST * span_m) for v in (x_m, y_m))
    figure, (axes,) = panels(1, 6.2, 5.3 * (high_y - low_y) / (high_x - low_x) + 1.1, title)
    axes.plot(x_m, y_m, color=MEASURED)
    at = np.unique(np.linspace(0, len(t_s) - 1, ARROWS).astype(int))
    reach = 0.06 * max(high_x - low_x, high_y - low_y)
    axes.quiver(
        x_m[at],
        y_m[at],
        -np.sin(yaw_rad[at]) * reach,
        np.cos(yaw_rad[at]) * reach,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        units="inches",
        width=0.022,
        color=INK,
        zorder=3,
    )
    for i, colour, marker, label in ((0, START, "o", "start"), (-1, STOP, "s", "stop")):
        axes.plot(x_m[i], y_m[i], marker, color=colour, markersize=7, label=label, zorder=4)
    axes.set_aspect("equal")
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)
    axes.set_xlabel("x, to the right [m]")
    axes.set_ylabel("y, ahead [m]")
    axes.legend(loc="best")
    axes.set_title(
        f"{measured.distance_m:.3f} m in {measured.duration_s:.1f} s "
        f"({measured.speed_m_s * 100:.1f} cm/s), turned {np.degrees(measured.turned_rad):+.1f}°",
        fontweight="normal",
        fontsize=9,
    )
    return figure


def _room(values: Floats, least_m: float) -> tuple[float, float]:
    """Give bounds around ``values`` with a margin, at least ``least_m`` apart."""
    low, high = float(np.min(values)), float(np.max(values))
    spare = max(0.12 * (high - low), (least_m - (high - low)) / 2.0)
    return low - spare, high + spare
