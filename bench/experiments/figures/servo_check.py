"""Servo check: torque and duty against position error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.figures.style import GOAL, INK, MEASURED, MODELLED, STANCE, styled
from busemu.wording import amount

if TYPE_CHECKING:
    from ..servo_check_result import ServoCheck

#: Points beyond these are thinned out: their dots would hide each other.
MOST_DOTS = 4000


@styled
def servo_check_figure(result: ServoCheck) -> Figure:
    """Torque against position error where it is known; below it the servo's own load register."""
    known = result.line is not None
    figure = Figure(figsize=(7.2, 7.4 if known else 3.9), layout="constrained")
    every = figure.subplots(2 if known else 1, 1, sharex=True, squeeze=False)[:, 0]
    figure.suptitle(
        f"Servo check: {result.robot}, {result.joint} blocked, {amount(result.repeats, 'repeat')}",
        x=0.01,
        ha="left",
        fontsize=11.0,
        fontweight="bold",
    )
    if known:
        _torque(every[0], result)
    _duty(every[-1], result)
    every[-1].set_xlabel("position error, goal − position [rad]")
    return figure


def _torque(axes: Axes, result: ServoCheck) -> None:
    error, duty = _expected(result)
    stall, friction = result.expected_stall_nm, result.sensor.friction_nm
    motor = duty * (stall + friction)
    axes.fill_between(
        error,
        np.clip(motor - friction, -stall, stall),
        np.clip(motor + friction, -stall, stall),
        color=STANCE,
        linewidth=0,
        label="what friction leaves open",
    )
    for sign in (-1.0, 1.0):
        axes.axhline(sign * stall, color=GOAL, linewidth=1.0, linestyle="--")
    axes.annotate(
        f"stall torque {stall:.3g} N m at {result.supply_v:.1f} V",
        (error[0], stall),
        xytext=(2, -11),
        textcoords="offset points",
        fontsize=8.5,
    )
    for way, colour, label in (
        (result.rising, MEASURED, "measured, into the block"),
        (~result.rising, MODELLED, "measured, and back"),
    ):
        shown = np.flatnonzero(way)[_thinned(int(way.sum()))]
        axes.plot(
            result.error_rad[shown], result.torque_nm[shown], ".", color=colour, markersize=2.2,
            label=label,
        )  # fmt: skip
    axes.plot(
        error,
        np.clip(motor, -stall, stall),
        color=INK,
        linewidth=1.0,
        label="the drive's constants",
    )
    axes.set_ylabel("torque on the joint [N m]")
    line = result.line
    assert line is not None
    axes.set_title(
        f"slope {line.slope:.2f} N m/rad (from constants {result.expected_slope_nm_rad:.2f}), "
        f"stall {result.stall_nm:.3f} N m, friction {result.friction_nm:.3f} N m",
        fontweight="normal",
        fontsize=9,
    )
    axes.legend(loc="center right", markerscale=3, bbox_to_anchor=(1.0, 0.26))


def _duty(axes: Axes, result: ServoCheck) -> None:
    error, expected = _expected(result)
    for way, colour, label in (
        (result.rising, MEASURED, "into the block"),
        (~result.rising, MODELLED, "and back"),
    ):
        there = way & ~np.isnan(result.load)
        axes.plot(
            result.error_rad[there], result.load[there], ".", color=colour, markersize=4,
            label=label,
        )  # fmt: skip
    axes.plot(error, expected, color=INK, linewidth=1.0, label="position law of the registers")
    for sign in (-1.0, 1.0):
        axes.axhline(sign, color=GOAL, linewidth=0.9, linestyle="--")
    axes.set_ylabel(f"{result.load_register}, as duty")
    renewed = f"; the servo renews its load every {result.load_refresh_s * 1e3:.0f} ms"
    axes.set_title(
        f"gain {result.gain_per_rad:.2f} duty/rad (control table "
        f"{result.sensor.law.gain_ccw_per_rad:.2f})" + (renewed if result.load_refresh_s else ""),
        fontweight="normal",
        fontsize=9,
    )
    axes.legend(loc="center right", markerscale=2, bbox_to_anchor=(1.0, 0.26))


def _expected(result: ServoCheck) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors [rad] and the duty that the position law makes of them."""
    widest = float(np.nanmax(np.abs(result.error_rad)))
    steps = int(np.ceil(widest / result.sensor.count_rad))
    error = np.arange(-steps, steps + 1, dtype=np.float64) * result.sensor.count_rad
    return error, result.sensor.duty(error)


def _thinned(count: int) -> slice:
    return slice(None, None, max(1, count // MOST_DOTS))
