"""Arms logged as a pair of files: ``control.csv`` (goals) and ``state_motor.csv`` (measurements).

Rows ``CONTROL,timestamp,"[...]"`` and ``STATE_MOTOR,timestamp,"[...]","[...]","[...]"``, the time
in microseconds, a list of all joints a cell: positions [rad], velocities and currents in the units
of their session. ``joint_list.txt`` beside them names the joints. Servos are STS3215, numbered from
1.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.recording import Recording, RecordingError
from busemu.tables import ControlTable, load_table

from .rows import EventColumns, Floats, group_name, raw_of_counts
from .source import LARGEST, TextTable, bare_name, csv_table

NAME = "so101"
MODEL = "STS3215"
ROBOT = "so101"
ARM_JOINTS = 6  #: of the SO-101
CONTROL, STATE = "control", "state_motor"
KINDS: Mapping[str, str] = MappingProxyType({CONTROL: "CONTROL", STATE: "STATE_MOTOR"})
#: counts a turn of the encoder; source: Feetech data sheet, STS3215
TURN_COUNTS = 4096
CENTRE = 2048
#: the authors' factor from the current register to what they call torque; source: README of SAGE
TORQUE_A_COUNT = 0.022814
#: a joint that is logged as a share of its range
SHARE_JOINT = re.compile("jaw|gripper", re.IGNORECASE)
#: counts that the whole range of the published arm's jaw has, by session; found from the steps of
#: its measured positions
JAW_COUNTS = (1523, 1506)
#: how far from whole counts measured positions may lie and still be counts
ON_COUNTS = 0.02


def recognises(head: str) -> bool:
    """Whether a file that begins like this is one of such a pair."""
    return head.startswith("type,timestamp,positions")


def partner(path: Path) -> tuple[Path, Path]:
    """The (control, state) files of the pair that ``path`` is one of.

    Raises :class:`RecordingError` if the other one is missing.
    """
    name = bare_name(path)
    kind = next((k for k in KINDS if name.endswith(k)), None)
    if kind is None:
        raise RecordingError(
            path, f"the name of such a file ends in {CONTROL} or {STATE}: name it so"
        )
    found = {kind: path}
    for other in KINDS:
        stem = name.removesuffix(kind) + other
        if other != kind:
            places = [path.with_name(stem + suffix) for suffix in (".csv.gz", ".csv")]
            there = next((place for place in places if place.is_file()), None)
            if there is None:
                raise RecordingError(
                    path,
                    f"{stem}.csv(.gz) is missing beside it: goals and measurements go together",
                )
            found[other] = there
    return found[CONTROL], found[STATE]


def read(path: Path) -> list[Recording]:
    """Read the pair that ``path`` is one of. Raises :class:`RecordingError`."""
    control_path, state_path = partner(path)
    control, state = csv_table(control_path), csv_table(state_path)
    goal_s, state_s = _times(control, CONTROL), _times(state, STATE)
    goals, positions = _lists(control, "positions"), _lists(state, "positions")
    if goals.shape[1] != positions.shape[1]:
        raise RecordingError(
            control_path,
            f"{goals.shape[1]} goals a row, but {state_path.name} has {positions.shape[1]} joints",
        )
    joints = _joints(path, positions.shape[1])
    table = load_table(MODEL)
    events = EventColumns()
    events.note_order(goal_s, "goals")
    events.note_order(state_s, "measurements")
    scales = [_scale(name, positions[:, i], events) for i, name in enumerate(joints)]
    for i, scale in enumerate(scales):
        raw = raw_of_counts(table["goal_position"], scale.counts(goals[:, i]), control_path)
        events.write(i + 1, "goal_position", goal_s, raw)
    for i, scale in enumerate(scales):
        raw = raw_of_counts(table["present_position"], scale.counts(positions[:, i]), state_path)
        events.read(i + 1, "present_position", state_s, raw)
    _motion(events, table, state, state_s)
    events.note(
        "one time a loop: its start; goals are written and registers read one servo after the "
        "other some milliseconds later"
    )
    return [events.recording(state_path, NAME, _metadata(state_path, joints, scales))]


@dataclass(frozen=True, slots=True)
class _Scale:
    """How a joint's numbers became of counts: ``count = value * counts_a_unit + zero_count``."""

    counts_a_unit: float
    zero_count: float
    unit: str

    def counts(self, values: Floats) -> Floats:
        """Whole counts nearest to ``values``."""
        found: Floats = np.round(values * self.counts_a_unit + self.zero_count)
        return found


def _scale(joint: str, values: Floats, events: EventColumns) -> _Scale:
    """Find how the recorder made numbers of counts: the step is known, where zero lay is not."""
    used = np.unique(values[~np.isnan(values)])
    if SHARE_JOINT.search(joint) and used.size and used[0] >= -0.5 and used[-1] <= 1.5:
        counts = _range_counts(used)
        if counts is None:
            counts = JAW_COUNTS[0]
            events.note(f"{joint}: its range in counts is not known, {counts} assumed")
        return _Scale(float(counts), CENTRE, "share of the calibrated range")
    counts_a_rad = TURN_COUNTS / (2.0 * np.pi)
    for shift in (0.0, 0.5):
        if used.size and _off_counts(used * counts_a_rad + shift) < ON_COUNTS:
            return _Scale(counts_a_rad, CENTRE - shift, "rad")
    events.note(f"{joint}: measured positions are no whole counts; rounded to the nearest")
    return _Scale(counts_a_rad, CENTRE, "rad")


def _off_counts(counts: Floats) -> float:
    return float(np.abs(counts - np.round(counts)).max())


def _range_counts(used: Floats) -> int | None:
    """The smallest number of counts in the range that makes all shares whole counts."""
    candidates = (*JAW_COUNTS, *range(100, TURN_COUNTS + 1))
    return next((counts for counts in candidates if _off_counts(used * counts) < ON_COUNTS), None)


def _motion(events: EventColumns, table: ControlTable, state: TextTable, times: Floats) -> None:
    """Velocities and currents: in SI and in the authors' torque, or as registers."""
    if "velocities" in state.names:
        velocities = _lists(state, "velocities")
        register = table["present_speed"]
        counts = velocities / register.si_scale
        if _off_counts(velocities) == 0.0 and np.abs(velocities).max() >= 1.0:
            counts = velocities
            events.note("velocities are whole numbers: taken for register counts, not rad/s")
        for i in range(counts.shape[1]):
            raw = raw_of_counts(register, np.round(counts[:, i]), state.path, "velocity")
            events.read(i + 1, register.name, times, raw)
    if "torques" in state.names:
        torques = _lists(state, "torques")
        counts = torques / TORQUE_A_COUNT
        if _off_counts(torques) == 0.0 and np.abs(torques).max() >= 1.0:
            counts = torques
            events.note("torques are whole numbers: taken for counts of the current register")
        for i in range(counts.shape[1]):
            raw = raw_of_counts(
                table["present_current"], np.round(counts[:, i]), state.path, "torque"
            )
            events.read(i + 1, "present_current", times, raw)


def _times(table: TextTable, kind: str) -> Floats:
    table.require("type", "timestamp", "positions")
    for row, what in enumerate(table.texts("type"), start=1):
        if what != KINDS[kind]:
            raise RecordingError(
                table.path, f"type {what[:40]!r} among rows of type {KINDS[kind]}", row
            )
    return table.times("timestamp", 1e-6)


def _lists(table: TextTable, name: str) -> Floats:
    """A column of lists as an array, shape (rows, joints)."""
    rows: list[list[float]] = []
    for number, cell in enumerate(table.texts(name), start=1):
        try:
            values = json.loads(cell.replace("nan", "NaN").replace("None", "null"))
            row = [float("nan") if value is None else float(value) for value in values]
        except (ValueError, TypeError, OverflowError, RecursionError):
            raise RecordingError(
                table.path, f"{name} {cell[:40]!r} is no list of numbers", number
            ) from None
        if not row or (rows and len(row) != len(rows[0])):
            wanted = len(rows[0]) if rows else "some"
            raise RecordingError(
                table.path, f"{name} has {len(row)} joints, the rows above {wanted}", number
            )
        if (np.abs(row) > LARGEST).any():
            raise RecordingError(
                table.path, f"{name} {cell[:40]!r} is nothing that was measured", number
            )
        rows.append(row)
    values_found: NDArray[np.float64] = np.array(rows)
    return values_found


def _joints(path: Path, count: int) -> list[str]:
    beside = path.with_name("joint_list.txt")
    names = beside.read_text("utf-8", errors="replace").split() if beside.is_file() else []
    return names if len(names) == count else [f"joint{i + 1}" for i in range(count)]


def _metadata(path: Path, joints: list[str], scales: list[_Scale]) -> dict[str, Any]:
    motion = path.resolve().parent.name
    session = path.resolve().parent.parent.name
    servos: dict[str, Any] = {}
    for number, (joint, scale) in enumerate(zip(joints, scales, strict=True), start=1):
        logged = {"unit": scale.unit, "zero_count": scale.zero_count}
        logged["counts_a_unit"] = scale.counts_a_unit
        servos[str(number)] = {"model": MODEL, "joint": joint, "logged": logged}
    metadata: dict[str, Any] = {
        "name": group_name((session, motion)),
        "group": group_name((motion,)),
        "condition": {"support": "rig"},
        "bus": {"protocol": 1.0},
        "servo": servos,
    }
    if len(joints) == ARM_JOINTS:
        metadata["robot"] = ROBOT
    return metadata
