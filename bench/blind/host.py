"""The operator's program on the bus: when it writes and reads, and what the registers then show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.motions import ExperimentPlan
from busemu.tables import Register

from .pendulum import Commands, Trace
from .rigs import Style
from .servos import Sheet
from .specimen import Specimen

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REPLY_S = 0.6e-3  #: from the end of the instruction packet to the end of the status packet
VELOCITY_WINDOW_S = 0.016  #: the firmware's speed is a difference over so long; assumed
RAIL_LAG_S = 0.02  #: of the voltage register; assumed


@dataclass(frozen=True, slots=True)
class Line:
    """What the line and the host's clock do to a recording."""

    latency_s: float = 0.1e-3  #: from the host's stamp to the servo, at most
    jitter: float = 0.0  #: spread of the loop's period, as a share
    hiccup_rate: float = 0.0  #: share of loops in which something else held the host up
    hiccup_s: float = 3e-3
    lost_rate: float = 0.0
    clock_ppm: float = 0.0


@dataclass(frozen=True)
class Schedule:
    """Instants of one recording, in the servo's time [s]; ``read_s`` has shape (loops, reads)."""

    style: Style
    write_s: Floats
    read_s: Floats
    arrive_s: Floats  #: of the writes
    sample_s: Floats  #: of the reads


def schedule(
    style: Style, duration_s: float, line: Line, random: np.random.Generator, access_s: float = 0.0
) -> Schedule:
    """When the loop writes and reads."""
    access_s = access_s or style.access_s
    loops = int(duration_s / style.period_s)
    spread = 1.0 + line.jitter * random.standard_normal(loops).clip(-2.0, 2.0)
    held_up = random.random(loops) < line.hiccup_rate
    late = np.where(held_up, random.exponential(line.hiccup_s, loops), 0.0)
    busy_s = access_s * (1 + len(style.reads))
    periods = np.maximum(style.period_s * spread, busy_s) + late
    write = np.concatenate(([0.0], np.cumsum(periods)[:-1]))
    write = write[write < duration_s]
    read = write[:, None] + access_s * (1.0 + np.arange(len(style.reads)))
    wait = line.latency_s * random.random((len(write), 1 + len(style.reads)))
    return Schedule(style, write, read, write + wait[:, 0], read + wait[:, 1:])


def commands(
    plan: ExperimentPlan, sheet: Sheet, timing: Schedule, start_rad: float | None = None
) -> Commands:
    """What reaches the servo under a schedule; goals are rounded to counts."""
    goal = np.round(plan.motion.goal_rad(timing.write_s) / sheet.step_rad) * sheet.step_rad
    off = plan.motion.torque_off_s
    first = math.inf
    if off is not None and (after := np.flatnonzero(timing.write_s >= off)).size:
        first = float(timing.arrive_s[after[0]])
    end = float(timing.sample_s[-1, -1]) + 2e-3
    return Commands(timing.arrive_s, goal, end, first, plan.registers, plan.warm_start_s, start_rad)


@dataclass(frozen=True)
class Shown:
    """What the registers show at the instants of a schedule; arrays of shape (loops,)."""

    roles: Mapping[str, Floats]  #: SI, before rounding
    counts: Mapping[str, Ints]
    truth_rad: Floats  #: the position register without rounding, noise and outliers
    taken_s: Floats  #: the ticks at which these were measured
    lost: NDArray[np.bool_]  #: (loops, reads)


def show(
    specimen: Specimen, trace: Trace, timing: Schedule, line: Line, random: np.random.Generator
) -> Shown:
    """Sample a trace as the bus does: registers change at the firmware's ticks."""
    roles: dict[str, Floats] = {}
    counts: dict[str, Ints] = {}
    truth = taken = np.empty(0)
    for column, role in enumerate(timing.style.reads):
        at = timing.sample_s[:, column]
        register = specimen.sheet.table[specimen.sheet.roles[role]]
        value = _value(role, specimen, trace, at)
        count = np.round(value / register.si_scale).astype(np.int64) + register.zero
        if role == "position":
            tick = trace.last(at - specimen.sensing.late_s)
            truth, taken = value, trace.t_s[tick]
            count = trace.count[tick].astype(np.int64) + register.zero
            struck = random.random(len(at)) < specimen.sensing.outlier_rate
            bit = random.integers(4, 9, len(at))
            count = np.where(struck, count ^ (1 << bit), count)
            value = np.where(struck, (count - register.zero) * register.si_scale, value)
        roles[role] = value
        counts[role] = np.clip(count, *_bounds(register))
    lost = random.random(timing.sample_s.shape) < line.lost_rate
    return Shown(roles, counts, truth, taken, lost)


def _value(role: str, specimen: Specimen, trace: Trace, at: Floats) -> Floats:
    sensing = specimen.sensing
    if role == "position":
        return trace.sensed_rad[trace.last(at - sensing.late_s)]
    if role == "duty":
        return trace.duty[trace.last(held(at, sensing.hold_s, sensing.hold_phase_s))]
    if role == "voltage":
        at = held(at, sensing.voltage_hold_s, sensing.hold_phase_s)
    at = trace.t_s[trace.last(at)]
    if role == "velocity":
        before = np.interp(at - VELOCITY_WINDOW_S, trace.t_s, trace.sensed_rad)
        return (np.interp(at, trace.t_s, trace.sensed_rad) - before) / VELOCITY_WINDOW_S
    if role == "voltage":
        half = 0.5 * RAIL_LAG_S
        rail = np.interp([at - RAIL_LAG_S, at - half, at], trace.t_s, trace.rail_v).mean(axis=0)
        lagged: Floats = rail + sensing.voltage_offset_v
        return lagged
    return np.interp(at, trace.t_s, trace.temperature_c)


def held(at_s: Floats, period_s: float, phase_s: float) -> Floats:
    """When what is shown at an instant was renewed; at once, if no period is given."""
    if period_s <= 0.0:
        return at_s
    return np.floor((at_s - phase_s) / period_s) * period_s + phase_s


def _bounds(register: Register) -> tuple[int, int]:
    if register.minimum or register.maximum:
        return register.minimum, register.maximum
    return 0, register.raw_maximum


def encode(register: Register, counts: Ints) -> Floats:
    """Raw values on the wire for signed counts, as the event table wants them."""
    if register.encoding == "signed":
        return (counts & register.raw_maximum).astype(np.float64)
    if register.encoding == "sign_magnitude":
        sign = 1 << register.sign_bit
        return np.where(counts < 0, sign | -counts, counts).astype(np.float64)
    return counts.astype(np.float64)


@dataclass(frozen=True)
class Table:
    """An event table, and where in it the positions are: rows of shape (loops,)."""

    events: pa.Table
    position_rows: NDArray[np.intp]
    shift_s: float  #: the table's time when the schedule began


def event_table(
    servo_id: int,
    sheet: Sheet,
    timing: Schedule,
    goals_rad: Floats,
    off_s: float,
    shown: Shown,
    line: Line,
) -> Table:
    """All accesses of a recording, in the host's time."""
    clock = 1.0 + 1e-6 * line.clock_ppm
    goal = sheet.table["goal_position"]
    goal_count = np.round(goals_rad / goal.si_scale).astype(np.int64) + goal.zero
    blocks: list[tuple[Floats, Floats, str, str, Floats]] = []
    still_on = timing.arrive_s < off_s
    writes = timing.write_s * clock
    none = np.full(len(writes), np.nan)
    blocks.append(
        (writes[still_on], none[still_on], "write", goal.name, encode(goal, goal_count)[still_on])
    )
    on = np.array([-0.01])
    blocks.append((on, np.array([np.nan]), "write", "torque_enable", np.array([1.0])))
    if math.isfinite(off_s):
        first = writes[~still_on][:1]
        blocks.append((first, np.full(1, np.nan), "write", "torque_enable", np.zeros(1)))
    for column, role in enumerate(timing.style.reads):
        register = sheet.table[sheet.roles[role]]
        lost = shown.lost[:, column]
        asked = timing.read_s[:, column] * clock
        reply = np.where(lost, np.nan, (timing.sample_s[:, column] + REPLY_S) * clock)
        raw = np.where(lost, np.nan, encode(register, shown.counts[role]))
        blocks.append((asked, reply, "read", register.name, raw))
    t = np.concatenate([block[0] for block in blocks])
    order = np.argsort(t, kind="stable")
    kinds = np.repeat(np.arange(len(blocks)), [len(block[0]) for block in blocks])[order]

    def texts(place: int) -> pa.Array:
        return pa.DictionaryArray.from_arrays(
            pa.array(kinds.astype(np.int32)), pa.array([str(block[place]) for block in blocks])
        )

    position = next(i for i, block in enumerate(blocks) if block[3] == sheet.roles["position"])
    events = pa.table(
        {
            "t_s": t[order] - t[order][0],
            "t_reply_s": np.concatenate([block[1] for block in blocks])[order] - t[order][0],
            "servo_id": np.full(len(t), servo_id, dtype=np.int16),
            "op": texts(2),
            "register": texts(3),
            "raw": np.concatenate([block[4] for block in blocks])[order],
        }
    )
    return Table(events, np.flatnonzero(kinds == position), -float(t[order][0]))
