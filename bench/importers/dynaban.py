"""Logs of a Dynamixel on a bench as CSV, one row a sample, units in the header.

Three shapes: an on-board tracker's ``time_0.1ms, position_steps_4096``, with
``pwm_command_of_3000`` where the duty is applied directly; registers by name
(``time_us, position_steps, speed_reg, current_reg, load_reg, setpoint_reg``); and dumps of the
control table's bytes (``time_us, reg30, reg31, ...``). The servo is an MX-64.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from bench.recording import Recording, RecordingError
from busemu.tables import ControlTable, load_table

from .rows import EventColumns, Floats, changes, group_name, raw_of_counts, raw_of_si, whole
from .source import TextTable, bare_name, csv_table

NAME = "dynaban"
MODEL, ROBOT, SERVO_ID = "MX-64", "mx64-bench", 1
#: name of the column of times -> seconds a unit
TIMES: Mapping[str, float] = MappingProxyType({"time_0.1ms": 1e-4, "time_us": 1e-6})
#: a column of raw register values -> the register
REGISTERS: Mapping[str, str] = MappingProxyType(
    {
        "position_steps_4096": "present_position",
        "position_steps": "present_position",
        "speed_reg": "present_speed",
        "current_reg": "current",
        "load_reg": "present_load",
    }
)
FULL_COMMAND = 3000.0  #: full supply voltage in pwm_command_of_3000
TURN_COUNTS = 4096
BYTE = re.compile(r"reg(\d+)$")
#: what the name of a file says of its set points: wheel mode, torque mode, joint mode
VELOCITY, TORQUE, LIFT = re.compile("rpmX100"), re.compile(r"Couple.*mA"), re.compile("Experience")
LIFT_SPEED = re.compile(r"Experience(?:Neg)?(\d+)Rpm")
WEIGHT = re.compile(r"(\d+)(k?g)(?:_(\d+)cm)?(?=_|$)")
GAIN = re.compile(r"Kp(\d+)$")


def recognises(head: str) -> bool:
    """Whether a file that begins like this is such a log."""
    first = head.split("\n", 1)[0]
    return any(first.startswith(f"{time},position_steps") for time in TIMES) or first.startswith(
        ("time_0.1ms,pwm_command_of_3000", "time_us,reg")
    )


def read(path: Path) -> list[Recording]:
    """Read one log. Raises :class:`RecordingError`."""
    cells = csv_table(path)
    time = next((name for name in TIMES if name in cells.names), None)
    if time is None:
        raise RecordingError(path, f"no column of times: one of {', '.join(TIMES)} is needed")
    t_s = cells.times(time, TIMES[time])
    table = load_table(MODEL)
    events = EventColumns()
    events.note_order(t_s)
    registers: dict[str, int] = {}
    condition: dict[str, Any] = {"support": "rig"} | _told_by_name(path)
    if gain := GAIN.search(bare_name(path)):
        registers["p_gain"] = int(gain[1])
    group: tuple[object, ...] = (path.resolve().parent.name, bare_name(path))
    if "pwm_command_of_3000" in cells.names:
        command = cells.numbers("pwm_command_of_3000")
        events.observe("goal_duty", t_s, command / FULL_COMMAND)
        events.note(
            "firmware that applies the duty directly: no register of the model holds it, see "
            "foreign/goal_duty (share of full duty); torque_enable is taken for on"
        )
        registers["torque_enable"] = 1
        low, high = np.nanmin(command), np.nanmax(command)
        kind = bare_name(path).split("_")[0]
        group = (path.resolve().parent.name, kind, f"{low:.0f}_to_{high:.0f}")
    if "setpoint_reg" in cells.names:
        _set_points(events, table, cells, t_s, registers)
    _named(events, cells, t_s)
    if any(BYTE.match(name) for name in cells.names):
        registers |= _bytes(events, table, cells, t_s)
    if "speed_steps_per_s" in cells.names:
        speed = cells.numbers("speed_steps_per_s") * (2.0 * np.pi / TURN_COUNTS)
        events.observe("velocity_rad_s", t_s, speed)
    metadata = {
        "name": group_name((path.resolve().parent.name, bare_name(path))),
        "robot": ROBOT,
        "group": group_name(group),
        "condition": condition,
        "bus": {"protocol": table.protocol},
        "servo": {str(SERVO_ID): {"model": MODEL, "registers": registers}},
    }
    return [events.recording(path, NAME, metadata)]


def _told_by_name(path: Path) -> dict[str, Any]:
    """What folder and file are called after: the load, a weight on an arm."""
    folder = path.resolve().parent.name
    told: dict[str, Any] = {"load": folder}
    for text in (bare_name(path), folder):
        if weight := WEIGHT.search(text):
            told["payload_kg"] = int(weight[1]) * (1.0 if weight[2] == "kg" else 1e-3)
            if weight[3]:
                told["payload_at_m"] = int(weight[3]) * 1e-2
            break
    if speed := LIFT_SPEED.search(bare_name(path)):
        told["set_velocity_rad_s"] = int(speed[1]) * np.pi / 30.0
    return told


def _named(events: EventColumns, cells: TextTable, t_s: Floats) -> None:
    """Columns of raw register values; the position of a reference is a goal."""
    for column, name in REGISTERS.items():
        if column not in cells.names:
            continue
        raw = whole(cells.numbers(column), cells.path, column)
        if name == "present_position" and bare_name(cells.path) == "ideal":
            events.write(SERVO_ID, "goal_position", t_s, raw)
            events.note("the file is a reference: its positions are taken for goals")
        else:
            events.read(SERVO_ID, name, t_s, raw)


def _set_points(
    events: EventColumns,
    table: ControlTable,
    cells: TextTable,
    t_s: Floats,
    registers: dict[str, int],
) -> None:
    """Set points, as the file's name says what they are; positive ones turn it clockwise."""
    values, name = cells.numbers("setpoint_reg"), bare_name(cells.path)
    first = changes(values)
    if TORQUE.search(name):
        raw = raw_of_si(table["goal_torque"], -values * 1e-3, cells.path, "setpoint_reg")
        events.write(SERVO_ID, "goal_torque", t_s[first], raw[first])
        registers |= {"torque_ctrl_mode_enable": 1}
        what = "goal_torque (set points in mA, positive clockwise)"
    elif VELOCITY.search(name):
        rad_s = -values * 0.01 * np.pi / 30.0
        raw = raw_of_si(table["moving_speed"], rad_s, cells.path, "setpoint_reg")
        events.write(SERVO_ID, "moving_speed", t_s[first], raw[first])
        registers |= {"cw_angle_limit": 0, "ccw_angle_limit": 0}
        what = "moving_speed in wheel mode (set points in 0.01 rpm, positive clockwise)"
    elif LIFT.search(name):
        counts = np.round(values * TURN_COUNTS / 360.0)
        raw = raw_of_counts(table["goal_position"], counts, cells.path, "setpoint_reg")
        events.write(SERVO_ID, "goal_position", t_s[first], raw[first])
        what = "goal_position (set points in degrees from count 0)"
    else:
        events.observe("setpoint", t_s, values)
        events.note("setpoint_reg: the file's name does not say of what; see foreign/setpoint")
        return
    events.note(f"changes of setpoint_reg are taken for writes of {what}")


def _bytes(
    events: EventColumns, table: ControlTable, cells: TextTable, t_s: Floats
) -> dict[str, int]:
    """Bytes by address, put together through the control table; returns writable constants."""
    values: dict[int, Floats] = {}
    for column in cells.names:
        if found := BYTE.match(column):
            byte = whole(cells.numbers(column), cells.path, column)
            wrong = np.flatnonzero((byte < 0) | (byte > 255))
            if wrong.size:
                row = int(wrong[0])
                raise RecordingError(cells.path, f"{column} {byte[row]:g} is no byte", row + 1)
            values[int(found[1])] = byte
    constant: dict[str, int] = {}
    for register in table.registers:
        places = range(register.address, register.address + register.size)
        if not all(place in values for place in places):
            continue
        raw = sum((values.pop(p) * 256.0**i for i, p in enumerate(places)), np.zeros(len(t_s)))
        events.read(SERVO_ID, register.name, t_s, raw)
        if register.writable and len(set(raw.tolist())) == 1:
            constant[register.name] = int(raw[0])
    for address, byte in values.items():
        events.observe(f"register_{address}", t_s, byte)
    if values:
        events.note(
            f"bytes at {', '.join(map(str, sorted(values)))} belong to no whole register of "
            f"{table.model}: see foreign/register_N"
        )
    return constant
