"""What the experiments ask of a recording: the measured span, tracks, truth, voltage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from hal.legs import quantity

from ..recording import JointTrack, Recording, joint_track
from .experiment import ExperimentError

Floats = NDArray[np.float64]


def robot_of(recordings: Sequence[Recording], experiment: str) -> Robot:
    """The one robot of several recordings. Raises :class:`ExperimentError`."""
    if not recordings:
        raise ExperimentError(f"{experiment}: no recording to evaluate")
    robots = [recording.robot for recording in recordings]
    first = robots[0]
    if first is None or any(robot is None for robot in robots):
        named = recordings[0].metadata.get("robot")
        raise ExperimentError(
            f"{experiment}: the robot {named!r} of {recordings[0].name} is not known: name one in "
            'the metadata as robot = "...", a name or the path of a robot file'
        )
    if len({robot.name for robot in robots if robot is not None}) > 1:
        raise ExperimentError(f"{experiment}: recordings of several robots: evaluate one at a time")
    return first


def condition(recording: Recording, key: str) -> Any:
    """A word of a recording's ``condition``. Raises :class:`ExperimentError` if it has none."""
    found = recording.metadata.get("condition", {})
    if key not in found:
        raise ExperimentError(
            f"{recording.name}: its metadata needs {key} under [condition]: add it "
            f"(see docs/how-to/experiments.md)"
        )
    return found[key]


def span_s(recording: Recording, key: str) -> tuple[float, float]:
    """A span of the host's time [s] that ``condition`` gives: ``key = [from, to]``."""
    (span,) = spans_s(recording, key, 1)
    return span


def spans_s(recording: Recording, key: str, count: int | None = None) -> list[tuple[float, float]]:
    """Spans of the host's time [s]: ``key = [from, to, from, to]``, or just ``count`` of them."""
    found = condition(recording, key)
    numbers = isinstance(found, list) and all(isinstance(t, int | float) for t in found)
    spans = list(zip(found[::2], found[1::2], strict=False)) if numbers else []
    whole = bool(spans) and 2 * len(spans) == len(found) and count in (None, len(spans))
    if not whole or not all(start < end for start, end in spans):
        raise ExperimentError(
            f"{recording.name}: condition {key} = {found!r} must be [from, to"
            + ("]" if count == 1 else ", from, to, ...]")
            + ", in s on the clock of t_s"
        )
    return [(float(start), float(end)) for start, end in spans]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """One joint over a span, every array of shape (samples,), one entry a position read.

    ``true_nm``, ``true_rad`` are what an observer beside an emulated robot saw at these instants,
    NaN where there was none.
    """

    joint: str
    t_s: Floats
    position_rad: Floats
    error_rad: Floats  #: goal in force minus position
    voltage_v: Floats
    true_nm: Floats
    true_rad: Floats


def samples(recording: Recording, robot: Robot, joint: str, span: tuple[float, float]) -> Samples:
    """One joint over ``span`` [s, host's clock]. Raises ``RecordingError``."""
    track: JointTrack = joint_track(recording, joint, robot)
    inside = (track.position_t_s >= span[0]) & (track.position_t_s <= span[1])
    times = track.position_t_s[inside]
    if not len(times):
        raise ExperimentError(
            f"{recording.name}: no position of {joint} was read between {span[0]:.3f} s and "
            f"{span[1]:.3f} s"
        )
    return Samples(
        joint,
        times,
        track.position_rad[inside],
        track.error_rad[inside],
        voltage_v(recording, track.servo_id, robot, times),
        observed(recording, f"rig/{joint}_nm", times),
        observed(recording, f"rig/{joint}_rad", times),
    )


def observed(recording: Recording, name: str, t_s: Floats) -> Floats:
    """A namespaced register at ``t_s``, linear in between; NaN where it was not recorded."""
    series = recording.observed(name)
    if not len(series.value):
        return np.full(np.shape(t_s), np.nan)
    return np.interp(t_s, series.t_sample_s, series.value, left=np.nan, right=np.nan)


def voltage_v(recording: Recording, servo_id: int, robot: Robot, t_s: Floats) -> Floats:
    """Voltage at a servo's terminals at ``t_s`` [V].

    As the servo measured it; else the metadata's ``supply_v``; else the robot file's.
    """
    if servo_id in recording.models and "present_voltage" in recording.models[servo_id]:
        series = recording.si(servo_id, "present_voltage", "read")
        if len(series.value):
            return np.interp(t_s, series.t_sample_s, series.value)
    given = recording.metadata.get("condition", {}).get("supply_v")
    volts = quantity(robot.document, "supply", "voltage_v") if given is None else float(given)
    return np.full(np.shape(t_s), volts)


def cut_at_s(recording: Recording, servo_id: int, span: tuple[float, float]) -> float | None:
    """When within ``span`` a servo was first seen shut down [s].

    Seen is the register that its shutdown cuts: it reads 0.
    """
    register = str(recording.models[servo_id].drive["shutdown_cuts"])
    times, raw = recording.series(servo_id, register, "read")
    found = times[(raw == 0.0) & (times >= span[0]) & (times <= span[1])]
    return float(found[0]) if len(found) else None


def rms(values: Floats) -> float:
    """Root mean square of the values that are there; NaN if none is."""
    there = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(np.square(there)))) if len(there) else float("nan")
