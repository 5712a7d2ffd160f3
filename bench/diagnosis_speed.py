"""``python -m bench.diagnosis_speed``: what a diagnosis costs, by recordings and by effects.

A rig of the other engine with one effect hidden in it is recorded (ten recordings of 6 s), and
diagnosed as ``busemu prove`` does it: all of it, with fewer recordings, with fewer effects to
choose from. With ``--robot`` it is a whole robot that walks (six recordings). Processor time does
not count other work; time on the wall does. ::

    python -m bench.diagnosis_speed
    python -m bench.diagnosis_speed --robot marvin-walk     # half an hour
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import track

from busemu.tables import Robot, load_robot

from .blind.rigs import RIGS
from .blind.scenes import SCENES
from .diagnosis.robot.running import walks
from .figures.tables import aligned
from .proof.diagnosing import joint_names, robot_names
from .proof.staging import stage

JOINT = "xl330-pendulum"
HIDDEN = {False: "load_friction", True: "joint_compliance"}
RATIO = 5.0  #: of what is hidden to the least that could be seen
#: groups that are fitted, effects to choose from; none: all
JOINT_TRIALS: tuple[tuple[int | None, int | None], ...] = (
    (None, None),
    (3, None),
    (2, None),
    (None, 12),
    (None, 4),
)
ROBOT_TRIALS: tuple[tuple[int | None, int | None], ...] = ((None, None), (1, None), (None, 4))


@dataclass(frozen=True, slots=True)
class Cost:
    """What one diagnosis took."""

    recordings: int
    effects: int
    processor_s: float
    wall_s: float
    answer: str


def main() -> None:
    """Record, diagnose again and again, print a table."""
    reader = argparse.ArgumentParser(
        prog="python -m bench.diagnosis_speed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    on_feet = [name for name, scene in SCENES.items() if scene.support == "ground"]
    reader.add_argument("--rig", default=JOINT, choices=RIGS, help="of one joint (%(default)s)")
    reader.add_argument("--robot", choices=on_feet, help="on its feet, in place of a rig")
    reader.add_argument("--seed", type=int, default=7, help="of the case (%(default)s)")
    asked = reader.parse_args()
    rig, robot = asked.robot or asked.rig, asked.robot is not None
    with tempfile.TemporaryDirectory(prefix="busemu-") as folder:
        case = written(Path(folder), rig, HIDDEN[robot], asked.seed)
        trials = ROBOT_TRIALS if robot else JOINT_TRIALS
        costs = [
            diagnosed(case, Path(folder) / f"{k}", groups, effects)
            for k, (groups, effects) in enumerate(track(trials, description="diagnosing"))
        ]
    rows = [
        [f"{c.recordings}", f"{c.effects}", f"{c.processor_s:.0f} s", f"{c.wall_s:.0f} s", c.answer]
        for c in costs
    ]
    print(f"{rig}, {HIDDEN[robot]} hidden at {RATIO:g} floors, seed {asked.seed}")
    print(aligned(["recordings", "effects", "processor", "wall", "answer"], rows))
    print(f"of {os.cpu_count()} processors; load at the end {os.getloadavg()[0]:.1f}")


def written(folder: Path, rig: str, effect: str, seed: int) -> Path:
    """A case of the other engine; its folder."""
    told = [f"--seed={seed}", "--kind=single", f"--effect={effect}", f"--ratio={RATIO}"]
    subprocess.run(
        [sys.executable, "-m", "bench.blind", *told, f"--rig={rig}", "--concealment=plain",
         f"--out={folder / 'cases'}"],
        check=True,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return folder / "cases" / "case-0001"


def diagnosed(case: Path, folder: Path, groups: int | None, effects: int | None) -> Cost:
    """Diagnose part of a case's recordings with part of the catalogue, in another process."""
    public: dict[str, Any] = json.loads((case / "case.json").read_text("utf-8"))
    known = effects_of(load_robot(case / "robot.toml"))
    stage(case, public, folder / "stage", () if effects is None else known[:effects])
    held_out = public["held_out"]
    paths = sorted((folder / "stage" / "recordings").glob("*.parquet"))
    by_group: dict[str, list[Path]] = {}
    for path in paths:
        by_group.setdefault(path.stem.rpartition("-")[0], []).append(path)
    fitted = [name for name in by_group if name not in held_out]
    for name in fitted[groups:] if groups else ():
        for path in by_group.pop(name):
            path.unlink()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun_s = time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "bench.proof.diagnosing", folder / "stage", folder / "out"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    wall_s = time.monotonic() - begun_s
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    answer = json.loads((folder / "out" / "diagnosis.json").read_text("utf-8"))
    names = ", ".join(f"{c['effect']} {c['probability']:.2f}" for c in answer["causes"])
    count = sum(map(len, by_group.values()))
    total = len(known) if effects is None else effects
    return Cost(count, total, spent_s, wall_s, f"{answer['verdict']}: {names}".rstrip(": "))


def effects_of(robot: Robot) -> tuple[str, ...]:
    """Effects that could be named, that which is hidden first."""
    legged = walks(robot)
    names = {*(robot_names(robot) if legged else joint_names())}
    return (HIDDEN[legged], *sorted(names - {HIDDEN[legged]}))


if __name__ == "__main__":
    main()
