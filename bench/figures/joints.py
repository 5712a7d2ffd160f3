"""Joint trajectories against their goals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.recording.joints import JointTrack

from .style import GOAL, MEASURED, STANCE, panels, styled

Floats = NDArray[np.float64]

#: up to this many samples each is drawn as a dot
DOTS = 400


@styled
def joint_figure(
    tracks: Sequence[JointTrack],
    *,
    stance: Floats | None = None,
    window_s: tuple[float, float] | None = None,
    title: str = "",
) -> Figure:
    """Draw a panel a joint: goals as a step line, measured positions, both in degrees.

    ``tracks``: of one leg, say; times on one axis. ``stance``: spans [s] of shape (n, 2) in which
    the foot is down, shaded. ``window_s``: from when to when is drawn, all of it by default. The
    root mean square of goal minus position over that window stands in every panel.
    """
    figure, every = panels(
        len(tracks), 8.0, 0.7 + 1.55 * len(tracks), title or _leg(tracks), share_x=True
    )
    start_s, stop_s = window_s or _extent(tracks)
    for axes, track in zip(every, tracks, strict=True):
        _shade(axes, stance, start_s, stop_s)
        _draw(axes, track, start_s, stop_s)
    every[-1].set_xlabel("time [s]")
    every[-1].set_xlim(start_s, stop_s)
    figure.legend(*every[0].get_legend_handles_labels(), loc="upper right", ncols=3)
    return figure


def _draw(axes: Axes, track: JointTrack, start_s: float, stop_s: float) -> None:
    within = track.goal_t_s[(track.goal_t_s > start_s) & (track.goal_t_s < stop_s)]
    goals = np.concatenate([[start_s], within, [stop_s]])
    axes.plot(
        goals,
        np.degrees(track.goal_at(goals)),
        drawstyle="steps-post",
        color=GOAL,
        linewidth=1.1,
        label="goal",
    )
    inside = (track.position_t_s >= start_s) & (track.position_t_s <= stop_s)
    times, positions = track.position_t_s[inside], np.degrees(track.position_rad[inside])
    axes.plot(
        times,
        positions,
        color=MEASURED,
        marker="." if len(times) <= DOTS else "",
        markersize=3.5,
        label="measured",
    )
    axes.set_title(track.joint.rpartition(".")[2])
    axes.set_ylabel("angle [°]")
    axes.margins(y=0.08)
    error = track.error_rad[inside]
    error = error[~np.isnan(error)]
    if error.size:
        rms = np.degrees(np.sqrt(np.mean(np.square(error))))
        axes.set_title(
            f"RMS of goal − measured {rms:.1f}°", loc="right", fontsize=8.5, fontweight="normal"
        )


def _shade(axes: Axes, stance: Floats | None, start_s: float, stop_s: float) -> None:
    if stance is None:
        return
    shown = np.clip(stance, start_s, stop_s)
    label = "foot down"
    for a, b in shown[shown[:, 1] > shown[:, 0]].tolist():
        axes.axvspan(a, b, color=STANCE, linewidth=0, zorder=0, label=label)
        label = ""


def _extent(tracks: Sequence[JointTrack]) -> tuple[float, float]:
    every = [t for track in tracks for t in (track.goal_t_s, track.position_t_s) if len(t)]
    if not every:
        return 0.0, 1.0
    start_s, stop_s = min(float(t[0]) for t in every), max(float(t[-1]) for t in every)
    return start_s, stop_s if stop_s > start_s else start_s + 1.0


def _leg(tracks: Sequence[JointTrack]) -> str:
    legs = sorted({track.joint.partition(".")[0] for track in tracks})
    return f"Joints of {', '.join(legs)}" if legs else ""
