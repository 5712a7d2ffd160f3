"""``python -m bench.proof.diagnosing STAGE OUT``: one diagnosis, in a process that knows no key.

STAGE has ``recordings/*.parquet``, ``robot.toml`` and ``told.json``: the groups that are held out,
and the effects that are left in or out of the catalogue. OUT gets what ``busemu diagnose`` writes,
the menu that the next experiment was chosen from, and the worst of the recordings that judged.
"""

from __future__ import annotations

import json
import sys
from datetime import date
from pathlib import Path

import numpy as np

from bench.diagnosis.knobs import SEEN, joint_effects
from bench.diagnosis.next_experiment import menu
from bench.diagnosis.report.traces import traces_of, worst
from bench.diagnosis.running import Split, diagnose, group_of, write
from bench.files import write_json
from bench.recording import Recording, read
from busemu.tables import load_robot

from .staging import MENU, TOLD, TRACE


def split_of(recordings: list[Recording], held_out: list[str]) -> Split:
    """Fit all groups but those held out."""
    return Split(
        tuple(r for r in recordings if group_of(r) not in held_out),
        tuple(r for r in recordings if group_of(r) in held_out),
    )


def left_out(told: dict[str, list[str]]) -> list[str]:
    """Effects of one joint that the catalogue shall lack."""
    known = (*joint_effects(), *sorted(SEEN))
    only = told["catalogue"] or known
    return [name for name in known if name not in only or name in told["without"]]


def main(stage: Path, out: Path) -> None:
    """Diagnose what is staged."""
    told = json.loads((stage / TOLD).read_text("utf-8"))
    robot = load_robot(stage / "robot.toml")
    recordings = [read(path) for path in sorted((stage / "recordings").glob("*.parquet"))]
    findings = diagnose(
        robot,
        split_of(recordings, told["held_out"]),
        without=left_out(told),
        say=lambda stage_: print(stage_, flush=True),
    )
    write(robot, findings, out, date.today())
    (only,) = findings
    write_json(out / MENU, [choice.plan.document() for choice in menu(only.model)])
    shown = worst(traces_of(only))
    np.savez_compressed(
        out / TRACE,
        t_s=shown.t_s,
        measured_rad=shown.measured_rad,
        before_rad=shown.before_rad,
        after_rad=shown.after_rad,
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
