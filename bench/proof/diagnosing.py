"""``python -m bench.proof.diagnosing STAGE OUT``: one diagnosis, in a process that knows no key.

STAGE has ``recordings/*.parquet``, ``robot.toml`` and ``told.json``: the groups that are held out,
and the effects that are left in or out of the catalogue. OUT gets what ``busemu diagnose`` writes,
the menu that the next experiment was chosen from (of one joint only), and the worst of the
recordings that judged. A robot with legs is diagnosed as a whole, as there.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from bench.diagnosis.joint.next_experiment import menu
from bench.diagnosis.knobs import SEEN, joint_effects
from bench.diagnosis.report.traces import Trace, traces_of, worst
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.running import run_robot, walks
from bench.diagnosis.running import Split, diagnose, group_of, write
from bench.diagnosis.watch import Watch
from bench.files import write_json
from bench.recording import Recording, read
from busemu.tables import Robot, load_robot
from sim.model import read_model

from .staging import MENU, TOLD, TRACE


def split_of(recordings: list[Recording], held_out: list[str]) -> Split:
    """Fit all groups but those held out."""
    return Split(
        tuple(r for r in recordings if group_of(r) not in held_out),
        tuple(r for r in recordings if group_of(r) in held_out),
    )


def left_out(told: dict[str, list[str]], known: Sequence[str]) -> list[str]:
    """Of the effects that could be named, those that the catalogue shall lack."""
    only = told["catalogue"] or known
    return [name for name in known if name not in only or name in told["without"]]


def main(stage: Path, out: Path) -> None:
    """Diagnose what is staged."""
    told = json.loads((stage / TOLD).read_text("utf-8"))
    robot = load_robot(stage / "robot.toml")
    recordings = [read(path) for path in sorted((stage / "recordings").glob("*.parquet"))]
    parts = split_of(recordings, told["held_out"])
    of_it = _robot if walks(robot) else _joint
    shown = worst(of_it(robot, parts, told, out))
    np.savez_compressed(
        out / TRACE,
        t_s=shown.t_s,
        measured_rad=shown.measured_rad,
        before_rad=shown.before_rad,
        after_rad=shown.after_rad,
    )


def joint_names() -> tuple[str, ...]:
    """Effects of one joint that can be named."""
    return (*joint_effects(), *sorted(SEEN))


def robot_names(robot: Robot) -> tuple[str, ...]:
    """Effects of a whole robot that can be named."""
    return tuple(
        sorted({placed.effect.name for placed in placed_effects(read_model(robot)).values()})
    )


def _joint(robot: Robot, parts: Split, told: dict[str, Any], out: Path) -> Sequence[Trace]:
    findings = diagnose(robot, parts, without=left_out(told, joint_names()), say=_say)
    write(robot, findings, out, date.today())
    (only,) = findings
    write_json(out / MENU, [choice.plan.document() for choice in menu(only.model)])
    return traces_of(only)


def _robot(robot: Robot, parts: Split, told: dict[str, Any], out: Path) -> Sequence[Trace]:
    without = left_out(told, robot_names(robot))
    return run_robot(robot, parts, out, date.today(), without=without, watch=Watch(_say)).traces


def _say(stage: str) -> None:
    print(stage, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
