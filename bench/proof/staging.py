"""What of a case a diagnosis gets to see: a copy of its public part, and nothing sealed."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path
from typing import Any

from bench.diagnosis.robot.running import walks
from bench.recording import read
from busemu.tables import load_robot

from .equivalence import Sight, same

TOLD = "told.json"
MENU = "menu.json"  #: experiments that a diagnosis could have proposed
TRACE = "trace.npz"  #: a recording that judged, before and after
#: registers beside the position that say something of the drive
OF_DRIVE = (
    "present_pwm",
    "present_current",
    "present_load",
    "present_voltage",
    "present_input_voltage",
)


def of_robot(case: Path) -> bool:
    """Whether a case is diagnosed as a whole robot, as ``busemu diagnose`` decides."""
    return walks(load_robot(case / "robot.toml"))


def sight_of(case: Path) -> Sight:
    """What the recordings of a case can show: from the robot file and a recording."""
    if of_robot(case):
        return Sight(position_only=True, upright=False, all_feet=True, legs=True)
    robot: dict[str, Any] = tomllib.loads((case / "robot.toml").read_text("utf-8"))
    x, y, z = robot["body"][0]["axis"]["value"]
    first = read(min((case / "recordings").glob("*.parquet")))
    registers = {name for _, name, op in first.by_series if op == "read"}
    of_drive = any(name.startswith(OF_DRIVE) for name in registers)
    return Sight(position_only=not of_drive, upright=abs(z) > max(abs(x), abs(y)))


def stage(case: Path, public: dict[str, Any], into: Path, catalogue: tuple[str, ...]) -> None:
    """Copy the public part of a case. What is left out goes with all that is one with it."""
    shutil.rmtree(into, ignore_errors=True)
    into.mkdir(parents=True)
    shutil.copytree(case / "recordings", into / "recordings")
    shutil.copy(case / "robot.toml", into / "robot.toml")
    without: set[str] = set()
    if public["catalogue_without"]:
        sight = sight_of(case)
        for name in public["catalogue_without"]:
            without |= same(name, sight)
    told = {
        "held_out": public["held_out"],
        "without": sorted(without),
        "catalogue": list(catalogue),
    }
    (into / TOLD).write_text(json.dumps(told), "utf-8")
