"""What a servo's controller was told, from the recorded writes to its registers.

The writes go into the emulator's own servo, which turns registers into drive commands; so a
replayed recording means by a register what the emulated bus means by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.recording import Recording
from busemu.plant import DriveCommand, ServoState
from busemu.servo import Servo
from busemu.tables import ControlTable, ServoMount
from sim.drive import fields, lanes
from sim.drive.bank import command_column
from sim.rollout import Replay

Floats = NDArray[np.float64]


@dataclass(slots=True)
class _Listener:
    """A plant that notes what a servo tells its drive, and stands where the recording does."""

    position_t_s: Floats
    position_rad: Floats
    now_s: float = 0.0
    latest: DriveCommand = field(default_factory=DriveCommand)

    def advance(self, to_s: float) -> None:
        self.now_s = to_s

    def command(self, servo_id: int, command: DriveCommand) -> None:
        self.latest = command

    def sample(self, servo_id: int) -> ServoState:
        position = 0.0
        if len(self.position_rad):
            position = float(np.interp(self.now_s, self.position_t_s, self.position_rad))
        return ServoState(position, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0)

    def observe(self) -> Mapping[str, float]:
        return {}


def drive_commands(
    recording: Recording,
    mount: ServoMount,
    table: ControlTable,
    position_t_s: Floats,
    position_rad: Floats,
    origin_s: float,
) -> tuple[Floats, Floats]:
    """The column of commands at ``origin_s`` [s, host], and all later changes of it.

    Changes are rows of time [s since ``origin_s``], field of :mod:`sim.drive.fields` and value.
    Registers nobody wrote are as the metadata has them, else as the robot's file, else the
    factory's. A servo whose ``torque_enable`` is nowhere told was switched on before, as was one
    that was given goals and then switched off.
    """
    settings = dict(mount.registers)
    servo_entry = recording.metadata.get("servo", {}).get(str(mount.servo_id), {})
    settings |= servo_entry.get("registers", {})
    listener = _Listener(position_t_s, position_rad, float(origin_s))
    servo = Servo(mount, table, listener, recording_baud_rate(recording))
    rows = _writes(recording, mount.servo_id, table)
    if _was_on(rows):
        settings.setdefault("torque_enable", 1)
    for name, raw in settings.items():
        if name in table and name not in ("id", "baud_rate"):
            servo.memory[name] = int(raw)
    settled = _apply(servo, listener, "torque_enable", servo.memory["torque_enable"], table)
    column = command_column(settled)
    changes: list[tuple[float, int, float]] = []
    start = column
    for t_s, name, raw in rows:
        listener.advance(t_s)
        servo.listens(t_s)
        after = command_column(_apply(servo, listener, name, raw, table))
        moved = np.flatnonzero(after != column)
        if t_s <= origin_s:
            start = after
        else:
            changes += [(t_s - origin_s, int(k), float(after[k])) for k in moved]
        column = after
    return start, np.array(changes, np.float64).reshape(-1, 3)


def recording_baud_rate(recording: Recording) -> int:
    """The bus's baud rate as the metadata or the robot's file has it, else 1 Mbps."""
    told = recording.metadata.get("bus", {}).get("baud_rate")
    if told is None and recording.robot is not None:
        told = recording.robot.baud_rate
    return int(told or 1_000_000)


def _apply(
    servo: Servo, listener: _Listener, name: str, raw: int, table: ControlTable
) -> DriveCommand:
    register = table[name]
    if register.writable:
        servo.write(register.address, int(raw).to_bytes(register.size, "little"))
    return listener.latest


def _writes(
    recording: Recording, servo_id: int, table: ControlTable
) -> list[tuple[float, str, int]]:
    """Times, registers and raw values of everything written to a servo, in order."""
    rows: list[tuple[float, str, int]] = []
    for servo, name, op in recording.by_series:
        if servo == servo_id and op == "write" and name in table:
            times, raw = recording.series(servo_id, name, "write")
            rows += [
                (float(t), name, int(value))
                for t, value in zip(times.tolist(), raw.tolist(), strict=True)
            ]
    return sorted(rows, key=lambda row: row[0])


def _was_on(rows: Sequence[tuple[float, str, int]]) -> bool:
    """Whether writes to a servo speak of a torque that was on before the first of them."""
    names = [name for _, name, _ in rows]
    if "torque_enable" not in names:
        return True
    first = names.index("torque_enable")
    return not rows[first][2] and any(name.startswith("goal_") for name in names[:first])


def supply_events(t_s: Floats, volts: Floats) -> Floats:
    """A recorded voltage as what the supply does: rows as :func:`drive_commands` gives them."""
    field_number = float(lanes.SUPPLY_EVENT + fields.SUPPLY_VOLTAGE)
    return np.stack([t_s, np.full_like(t_s, field_number), volts], axis=1)


def without_supply(replay: Replay) -> Replay:
    """A replay without what was told of its supply, which is the candidate's then."""
    return replace(replay, events=replay.events[replay.events[:, 1] < lanes.SUPPLY_EVENT])
