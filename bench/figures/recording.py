"""What is in a recording, at a glance: motion, sampling, and the servos' own measurements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.recording import Oddity, Recording, Weight
from bench.recording.oddities.channel import Channel, channel

from .style import GOAL, MEASURED, STOP, panels, styled

Floats = NDArray[np.float64]

#: panels in one picture; further servos are left out and counted
MOST_PANELS = 8
#: points of a line beyond which it is thinned to the extremes of so many spans
MOST_POINTS = 20_000
#: an oddity that lasts this share of the recording is about all of it and is not shaded
WHOLE = 0.5
#: registers that belong into one panel, and what the panel shows
PANELS: Sequence[tuple[str, tuple[str, ...]]] = (
    ("duty or load [% of full]", ("present_pwm", "present_load")),
    ("current [A]", ("present_current", "current")),
    ("velocity [rad/s]", ("present_velocity", "present_speed")),
    ("voltage [V]", ("present_input_voltage", "present_voltage")),
    ("temperature [°C]", ("present_temperature",)),
)


@styled
def motion_figure(recording: Recording, found: Sequence[Oddity] = ()) -> Figure:
    """Draw goals and positions of every servo over time, in degrees, with oddities marked.

    Servos whose model is not known are drawn in counts. Spans of oddities are shaded, single
    samples are ringed.
    """
    ids = [i for i in recording.servo_ids if channel(recording, i, "present_position", "read")]
    ids = ids or list(recording.servo_ids)
    shown = ids[:MOST_PANELS]
    title = recording.name + (f" (first {len(shown)} of {len(ids)} servos)" if len(ids) > 8 else "")
    figure, every = panels(len(shown), 9.0, 1.0 + 1.7 * max(len(shown), 1), title, share_x=True)
    start_s = _start(recording)
    for axes, servo_id in zip(every, shown, strict=False):
        goal = channel(recording, servo_id, "goal_position", "write")
        position = channel(recording, servo_id, "present_position", "read")
        scale, unit = _scale(goal or position)
        for series, colour, name in ((goal, GOAL, "goal"), (position, MEASURED, "measured")):
            if series is not None:
                style = "steps-post" if series is goal else "default"
                t, y = thinned(series.t_s - start_s, scale(series))
                if series is goal:
                    held_s = _held_until_s(recording, servo_id, series) - start_s
                    t, y = np.append(t, held_s), np.append(y, y[-1:])
                axes.plot(t, y, color=colour, linewidth=1.0, label=name, drawstyle=style)
        if position is not None:
            _mark(axes, recording, position, scale, found)
        joint = None if recording.robot is None else recording.robot.by_id.get(servo_id)
        axes.set_title(f"servo {servo_id}" + (f", {joint.joint}" if joint else ""))
        axes.set_ylabel(f"angle [{unit}]")
    every[-1].set_xlabel("time [s]")
    _legend(figure, every)
    return figure


@styled
def interval_figure(recording: Recording) -> Figure:
    """Draw how far apart the reads of each register are: a histogram of intervals each."""
    groups = [
        (names, intervals)
        for names, intervals in _intervals(recording)
        if len(intervals) and intervals.max() > 0.0
    ][:MOST_PANELS]
    figure, every = panels(
        len(groups), 9.0, 1.0 + 1.5 * max(len(groups), 1), f"{recording.name}: time between reads"
    )
    for axes, (names, intervals) in zip(every, groups, strict=False):
        milliseconds = 1e3 * intervals
        axes.hist(milliseconds, bins=120, color=MEASURED, alpha=0.75, log=True)
        axes.axvline(float(np.median(milliseconds)), color=STOP, linewidth=1.0)
        axes.set_title(_listed(names))
        axes.set_ylabel("reads")
        low, middle, high = np.percentile(milliseconds, [5.0, 50.0, 95.0])
        axes.set_title(
            f"median {middle:.2f} ms, 5–95 % {low:.2f}–{high:.2f} ms",
            loc="right",
            fontsize=8.5,
            fontweight="normal",
        )
    every[-1].set_xlabel("interval [ms]")
    return figure


@styled
def power_figure(recording: Recording) -> Figure | None:
    """Draw duty, current, velocity, voltage and temperature, a line a servo; ``None`` for none."""
    there = [
        (title, [s for name in names for s in _of_all(recording, name)]) for title, names in PANELS
    ]
    there = [(title, series) for title, series in there if series]
    if not there:
        return None
    title = f"{recording.name}: measurements of servos"
    figure, every = panels(len(there), 9.0, 1.0 + 1.6 * len(there), title, share_x=True)
    start_s = _start(recording)
    for axes, (what, series) in zip(every, there, strict=True):
        factor = 100.0 if "%" in what else 1.0
        for one in series:
            t, y = thinned(one.t_s - start_s, factor * one.si())
            axes.plot(t, y, linewidth=0.9, label=str(one.servo_id))
        axes.set_title(what)
    every[-1].set_xlabel("time [s]")
    if len(recording.servo_ids) > 1:
        _legend(figure, every)
    return figure


def thinned(t_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """A line of at most some 20 000 points: where there are more, the extremes of equal spans."""
    if len(t_s) <= MOST_POINTS or np.isnan(values).all():
        return t_s[:MOST_POINTS], values[:MOST_POINTS]
    edges = np.linspace(0, len(t_s), MOST_POINTS // 2 + 1).astype(np.intp)[:-1]
    filled = np.where(np.isnan(values), np.nanmedian(values), values)
    low, high = np.minimum.reduceat(filled, edges), np.maximum.reduceat(filled, edges)
    return np.repeat(t_s[edges], 2), np.column_stack([low, high]).ravel()


def _mark(
    axes: Axes,
    recording: Recording,
    position: Channel,
    scale: Callable[[Channel], Floats],
    found: Sequence[Oddity],
) -> None:
    start_s, duration_s = _start(recording), recording.duration_s
    values = scale(position)
    label = "odd"
    for oddity in found:
        if oddity.weight < Weight.WARNING or oddity.t_start_s is None:
            continue
        if oddity.servo_id not in (None, position.servo_id):
            continue
        if oddity.register == position.name and oddity.kind in ("glitches", "out_of_range"):
            rows = np.searchsorted(position.rows, np.array(oddity.rows) - 1)
            axes.plot(
                position.t_s[rows] - start_s,
                values[rows],
                "o",
                markersize=7,
                markerfacecolor="none",
                markeredgecolor=STOP,
                label=label,
            )
            label = ""
        elif (
            oddity.t_end_s is not None
            and oddity.register in (None, position.name)
            and oddity.t_end_s - oddity.t_start_s < WHOLE * duration_s
        ):
            axes.axvspan(
                oddity.t_start_s - start_s,
                oddity.t_end_s - start_s,
                color=STOP,
                alpha=0.18,
                linewidth=0,
                label=label,
            )
            label = ""


def _held_until_s(recording: Recording, servo_id: int, goal: Channel) -> float:
    """Until when the last goal was in force [s]: until the torque went off, or to the end."""
    torque = channel(recording, servo_id, "torque_enable", "write")
    if torque is not None:
        off = torque.t_s[(torque.t_s >= goal.t_s[-1]) & (torque.counts() == 0)]
        if len(off):
            return float(off[0])
    return float(recording.t_s[-1])


def _scale(series: Channel | None) -> tuple[Callable[[Channel], Floats], str]:
    if series is None or series.register is None or series.register.si_unit != "rad":
        return (lambda one: one.counts()), "counts"
    return (lambda one: np.degrees(one.si())), "°"


def _intervals(recording: Recording) -> Iterator[tuple[list[str], Floats]]:
    """Intervals of the registers that are read at the same times, those of all servos together."""
    by_times: dict[tuple[int, float, float], tuple[list[str], Floats]] = {}
    for (servo_id, name, op), rows in recording.by_series.items():
        if op != "read" or len(rows) < 3:
            continue
        times = recording.t_s[rows]
        key = (
            len(rows),
            round(times[-1] - times[0], 4),
            round(float(np.median(np.diff(times))), 5),
        )
        names, _ = by_times.setdefault(key, ([], np.diff(times)))
        text = name if "/" in name else f"{servo_id} {name}"
        names.append(text)
    yield from by_times.values()


def _listed(names: Sequence[str]) -> str:
    few = ", ".join(names[:3])
    return few + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _of_all(recording: Recording, name: str) -> Iterator[Channel]:
    for servo_id in recording.servo_ids:
        series = channel(recording, servo_id, name, "read")
        if series is not None and series.register is not None:
            yield series


def _start(recording: Recording) -> float:
    return float(recording.t_s[0]) if len(recording) else 0.0


def _legend(figure: Figure, every: Sequence[Axes]) -> None:
    named: dict[str, Artist] = {}
    for axes in every:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        figure.legend(
            list(named.values()), list(named), loc="upper right", ncols=min(len(named), 9)
        )
