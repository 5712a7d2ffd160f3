"""Small logs in the shapes of other people's files, and where their real ones lie."""

import gzip
import json
import math
import os
from pathlib import Path

import pytest

STEP_RAD = 2.0 * math.pi / 4096


def recordings(*parts):
    """A folder of the real sets; skips the test where they are not."""
    place = os.environ.get("BUSEMU_RECORDINGS")
    if not place:
        pytest.skip("BUSEMU_RECORDINGS does not say where the recordings of others are")
    folder = Path(place, *parts)
    if not folder.exists():
        pytest.skip(f"{folder} is not there")
    return folder


def bam_entries(
    count=200, period_s=0.005, lead_s=0.003, off_from=None, trajectory="sin_time_square"
):
    """Samples of a joint that misses its goal by 20 counts; goals by the recorder's formula."""
    assert trajectory == "sin_time_square"
    found = []
    for i in range(count):
        t = 0.01 + i * period_s
        goal = math.sin((t - lead_s) ** 2)
        position = (round(goal / STEP_RAD) - 20 * (-1) ** (i // 50)) * STEP_RAD
        duty = round(0.002877 * 400 * (goal - position) * 885)
        found.append(
            {
                "position": position,
                "speed": 3 * 0.229 * math.pi / 30.0,
                "load": duty & 0xFFFF,
                "input_volts": 7.3,
                "temp": 28,
                "timestamp": t,
                "goal_position": goal,
                "torque_enable": off_from is None or i < off_from,
            }
        )
    return found


def bam_log(path, entries=None, **more):
    document = {
        "mass": 0.49,
        "length": 0.1,
        "kp": 400,
        "vin": 7.4,
        "motor": "xl330",
        "trajectory": "sin_time_square",
        "entries": bam_entries() if entries is None else entries,
    }
    path.write_text(json.dumps({k: v for k, v in (document | more).items() if v is not None}))
    return path


def pair(folder, rows=40, half=0.0, scale=STEP_RAD, packed=True):
    """A control and a state file of two joints and a jaw; returns the control file."""
    folder.mkdir(parents=True, exist_ok=True)
    control = ["type,timestamp,positions"]
    state = ["type,timestamp,positions,velocities,torques"]
    for i in range(rows):
        t = 2.5 + i * 20000.0
        goals = [0.001 * i, -0.002 * i, 0.5 + 0.001 * i]
        measured = [(i + half) * STEP_RAD, -2 * i * STEP_RAD, (600 + i) / 1523]
        speeds = [50 * scale, -100 * scale, 0.0]
        control.append(f'CONTROL,{t},"{goals}"')
        state.append(f'STATE_MOTOR,{t},"{measured}","{speeds}","[0.0, 0.022814, 0.045628]"')
    (folder / "joint_list.txt").write_text("Rotation\nPitch\nJaw\n")
    for name, lines in (("control", control), ("state_motor", state)):
        data = ("\n".join(lines) + "\n").encode()
        if packed:
            (folder / f"{name}.csv.gz").write_bytes(gzip.compress(data))
        else:
            (folder / f"{name}.csv").write_bytes(data)
    return folder / ("control.csv.gz" if packed else "control.csv")


def lines(path, *text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(text) + "\n")
    return path


def duty_log(path, rows=40):
    return lines(
        path,
        "time_0.1ms,pwm_command_of_3000,position_steps_4096,speed_steps_per_s",
        *(f"{10 * i},-1500,{(4090 + i) % 4096},{20 * i}" for i in range(rows)),
    )


def register_log(path, rows=40, set_point=2000):
    return lines(
        path,
        "time_us,position_steps,speed_reg,current_reg,load_reg,setpoint_reg",
        *(f"{10000 * i},{100 + i},{1024 + 20},{2048 - i},{96},{set_point}" for i in range(rows)),
    )


def dump(path, rows=40):
    """Bytes 30 to 37 and 46: goal 1201, speed 0, torque limit 1023, position 1200 + i, moving."""
    return lines(
        path,
        "time_us," + ",".join(f"reg{i}" for i in [*range(30, 38), 46, 53]),
        *(f"{2000 * i},177,4,0,0,255,3,{(176 + i) % 256},4,1,9" for i in range(rows)),
    )


def telemetry(path, rows=40):
    return lines(
        path,
        "timestamp,target pos (5),pos (5),speed (5),load (5),current (5),temp (5),"
        "status (5),moving (5)",
        "2025-11-09T09:27:03.748Z,1947,,,,,,,",
        *(
            f"2025-11-09T09:27:{4 + i * 0.1:06.3f}Z,{1947 if i < 20 else 2047},{2042 - i},"
            f"{32768 + 50},{1024 + 40},1,37,0,1"
            for i in range(rows)
        ),
    )


WIDE_MAP = """
format = "busemu-columns/1"
robot = "marvin"
source = "real"
group = "steps"
[time]
column = "t"
unit = "ms"
[[column]]
name = "femur goal"
joint = "leg1.femur"
register = "goal_position"
op = "write"
unit = "deg"
[[column]]
name = "femur"
joint = "leg1.femur"
register = "present_position"
unit = "rad"
at_s = 0.002
[[column]]
name = "load"
servo = 3
register = "present_load"
unit = "percent"
sign = -1
offset = 1.0
[[column]]
name = "roll"
register = "imu/roll_rad"
unit = "deg"
"""


def wide(path, rows=40, text=WIDE_MAP):
    lines(
        path,
        "t,femur goal,femur,load,roll,unused",
        *(
            f"{20 * i},{30 + i / 10},{(30 + i / 10) / 57.29578},{-10 + i / 10},{i},0"
            for i in range(rows)
        ),
    )
    path.with_name(f"{path.stem}.columns.toml").write_text(text)
    return path


MAKERS = {
    "bam": lambda folder: bam_log(folder / "log.json"),
    "so101": lambda folder: pair(folder / "motion"),
    "dynaban": lambda folder: register_log(folder / "test_VitesseCte2000rpmX100.csv"),
    "dump": lambda folder: dump(folder / "hold_Kp8.csv"),
    "duty": lambda folder: duty_log(folder / "gearbox_only" / "type0_test00.csv"),
    "telemetry": lambda folder: telemetry(folder / "telemetry.csv"),
    "wide-csv": lambda folder: wide(folder / "wide.csv"),
}


def same(left, right):
    """Whether two recordings hold the same rows, bit for bit."""
    return left.table.to_pylist().__repr__() == right.table.to_pylist().__repr__()
