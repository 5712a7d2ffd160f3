"""Recording a case: one plan on its hidden specimen, and the truth beside what was read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.motions import ExperimentPlan
from bench.recording import Recording
from bench.recording.metadata import FORMAT

from .believed import SERVO_ID, metadata
from .case import Case
from .host import commands, event_table, schedule, show
from .nuisances import draw_passing
from .pendulum import roll

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """A recording with what is true of it.

    ``truth``: columns ``recording``, ``row`` (of the event table, from 0), ``servo_id``,
    ``t_true_s`` (the tick at which it was measured, in the recording's time) and ``position_rad``
    (of the servo: the register's value without rounding, noise and outliers), a row for every read
    of a position.
    """

    recording: Recording
    truth: pa.Table
    oracle_mse_rad2: float  #: of the positions that were read, against the truth


def record(case: Case, plan: ExperimentPlan, name: str, group: str, late: float) -> Measured:
    """Run a plan on a case's specimen.

    ``late``: 0 at the beginning of the operator's session, 1 at its end. The same case, plan and
    name give the same bytes.
    """
    random = np.random.default_rng([case.seed, 21, *name.encode()])
    passing = draw_passing(random, late)
    specimen = case.specimen(plan, passing)
    sheet, style = specimen.sheet, case.ground.style
    line = case.nuisances.line()
    timing = schedule(style, plan.motion.duration_s, line, random)
    start = float(plan.motion.goal_rad(0.0)) + passing.start_off_rad
    orders = commands(plan, sheet, timing, start)
    trace = roll(specimen, orders, random)
    shown = show(specimen, trace, timing, line, random)
    table = event_table(SERVO_ID, sheet, timing, orders.goal_rad, orders.torque_off_s, shown, line)
    document = metadata(case.ground.rig, plan, name, group)
    recording = Recording.checked(table.events, {"format": FORMAT, **document})
    rows = table.position_rows
    raw = table.events.column("raw").to_numpy()[rows]
    register = sheet.table[sheet.roles["position"]]
    read = np.array([np.nan if np.isnan(r) else register.to_si(int(r)) for r in raw])
    clock = 1.0 + 1e-6 * line.clock_ppm
    truth = pa.table(
        {
            "recording": pa.array([name] * len(rows)).dictionary_encode(),
            "row": rows.astype(np.int64),
            "servo_id": np.full(len(rows), SERVO_ID, dtype=np.int16),
            "t_true_s": shown.taken_s * clock + table.shift_s,
            "position_rad": shown.truth_rad,
        }
    )
    return Measured(recording, truth, float(np.nanmean((read - shown.truth_rad) ** 2)))
