"""Oddities of supply and heat: a voltage that sags or contradicts the metadata, a warm servo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..recording import Recording
from ..rules import READ
from .channel import Channel, at, channel
from .oddity import Oddity, Weight

VOLTAGES = ("present_input_voltage", "present_voltage")
#: a typed-in voltage is contradicted where the middle half of the register's values is this far
#: away, and by this share; assumed: one and a half steps of the register
CONTRADICTED_V, CONTRADICTED = 0.15, 0.025
#: swings of the voltage worth telling, as a share of its median; assumed
SWING = 0.05
#: a servo this much warmer at the end has another winding resistance (3.9 % for 10 K of copper)
WARMING_K = 5.0


def check(recording: Recording) -> Iterator[Oddity]:
    """All that is odd about voltages and temperatures."""
    told: set[float] = set()
    for servo_id in recording.servo_ids:
        for name in VOLTAGES:
            series = channel(recording, servo_id, name, READ)
            if series is None or series.register is None or np.isnan(series.raw).all():
                continue
            yield from _typed_in(recording, series, told)
            yield from _swing(series)
            yield from _limits(series)
        warm = channel(recording, servo_id, "present_temperature", READ)
        if warm is not None and warm.register is not None:
            yield from _warming(warm)


def _typed_in(recording: Recording, series: Channel, told: set[float]) -> Iterator[Oddity]:
    typed, where = _typed_voltage(recording)
    low, median, high = (float(v) for v in np.nanpercentile(series.si(), [25.0, 50.0, 75.0]))
    if typed is None:
        return
    slack = max(CONTRADICTED_V, CONTRADICTED * typed)
    if low - slack <= typed <= high + slack:
        return
    if round(median, 1) in told:
        return
    told.add(round(median, 1))
    yield at(
        series,
        np.flatnonzero(~np.isnan(series.raw)),
        "supply_contradicted",
        Weight.WARNING,
        f"{where} says {typed:g} V, the register {median:.1f} V (median)",
        f"full duty gives {median / typed - 1.0:+.0%} torque and speed against the model"
        if typed > 0.0
        else "a model at that does not move",
        f"use {median:.1f} V, or measure at the servo",
    )


def _typed_voltage(recording: Recording) -> tuple[float | None, str]:
    condition = recording.metadata.get("condition", {})
    if isinstance(condition, Mapping) and _number(condition.get("supply_v")):
        return float(condition["supply_v"]), "supply_v in [condition]"
    supply = None if recording.robot is None else recording.robot.document.get("supply")
    entry = supply.get("voltage_v") if isinstance(supply, Mapping) else None
    if isinstance(entry, Mapping) and _number(entry.get("value")):
        return float(entry["value"]), "the robot's file"
    return None, ""


def _swing(series: Channel) -> Iterator[Oddity]:
    volts = series.si()
    median = float(np.nanmedian(volts))
    low, high = (float(np.nanpercentile(volts, p)) for p in (0.5, 99.5))
    if median <= 0.0 or high - low < SWING * median + 1.5 * _step(series):
        return
    places = np.flatnonzero(volts <= low)
    rises = high - median > 0.5 * (median - low)
    yield at(
        series,
        places,
        "supply_swings",
        Weight.WARNING,
        f"{np.nanmin(volts):.1f} to {np.nanmax(volts):.1f} V about {median:.1f} V during motion",
        "torque and top speed follow the voltage"
        + (
            "; it rises where the joint is driven back: the supply takes no current"
            if rises
            else ""
        ),
        "model the source with its resistance, or use the recorded voltage",
    )


def _limits(series: Channel) -> Iterator[Oddity]:
    model, volts = series.model, series.si()
    if model is None:
        return
    for name, beyond in (("max_voltage_limit", np.greater), ("min_voltage_limit", np.less)):
        if name not in model or model[name].initial is None:
            continue
        limit = model[name].to_si(int(model[name].initial or 0))
        places = np.flatnonzero(beyond(volts, limit) & ~np.isclose(volts, limit))
        if places.size > 0.01 * len(volts):
            yield at(
                series,
                places,
                "beyond_voltage_limit",
                Weight.NOTE,
                f"{places.size / len(volts):.0%} of the samples are beyond the factory's {name} "
                f"of {limit:g} V",
                "the data sheet's numbers do not hold there, and an alarm may cut the torque",
                "check the limit set in the servo; scale the data sheet by the voltage",
            )


def _warming(series: Channel) -> Iterator[Oddity]:
    kelvin = series.si()
    kelvin = kelvin[~np.isnan(kelvin)]
    if len(kelvin) < 20:
        return
    rise = float(np.median(kelvin[-10:]) - np.median(kelvin[:10]))
    if rise >= WARMING_K:
        yield at(
            series,
            np.arange(len(series.raw)),
            "warming",
            Weight.NOTE,
            f"{rise:.0f} K warmer at the end ({np.median(kelvin[-10:]):.0f} degC)",
            "the winding is warmer still: its resistance rises 0.39 % a kelvin, friction falls",
            "compare early with late spans; let it cool between runs",
        )


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _step(series: Channel) -> float:
    return 0.0 if series.register is None else series.register.si_scale
