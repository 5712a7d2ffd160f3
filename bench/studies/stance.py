"""Rubber tips, soft joints, both, or neither? Eight walks with stance errors, diagnosed.

The thesis's Marvin had systematic errors of femur and tibia while its feet stood, "most likely"
from compliance or from rubber tips, and left it open. Here eight robots on another engine have
either, both or none of them, under two loads, beside all that is never as believed. The diagnosis
sees two recordings of the joints only; then with the height of the trunk beside them; then the
joints of a third walk as well, under the other load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.journal import FOLDER, Journal
from bench.diagnosis.rivals import CLOSE
from bench.diagnosis.robot_features import RobotKind
from bench.diagnosis.robot_gains import RobotFindings
from bench.diagnosis.robot_model import RobotModel
from bench.diagnosis.robot_replay import course
from bench.diagnosis.robot_search import RobotSearch
from bench.figures.style import save
from bench.files import finite, write_json, write_text
from bench.recording import Recording, read, write
from busemu.tables import load_robot
from sim.model import read_model

from .stance_figures import joints_figure, summary_figure
from .stance_runs import SCENE, Cause, Run, draw_runs, key_of, record

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

FORMAT = "busemu-stance-study/1"
ROBOT = "marvin"
#: what could be the matter with a walk, besides tips and joints
RIVALS = (
    "ground_compliance@all",
    "payload@all",
    "foot_slip@all",
    "gain_error@all",
    "supply_voltage@all",
    "backlash@femur",
    "backlash@tibia",
    "load_friction@all",
    "stribeck_friction@all",
    "leg_geometry.tibia@all",
    "dead_zone@all",
)
TIPS = ("foot_compliance@all",)
JOINTS = ("joint_compliance@all", "joint_compliance@femur", "joint_compliance@tibia")
CONTACT_CLASS = ("foot_compliance", "ground_compliance")
JOINT_CLASS = ("joint_compliance", "backlash")
#: what a diagnosis sees: how many of a run's recordings, and of what
CHANNELS = {
    "joints": (2, (RobotKind.JOINTS,)),
    "joints and height": (2, (RobotKind.JOINTS, RobotKind.HEIGHT)),
    "joints under two loads": (3, (RobotKind.JOINTS,)),
}


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What was found in one run with some channels."""

    run: Run
    channels: str
    findings: RobotFindings

    @property
    def cause(self) -> Cause:
        """The answer: a soft ground counts as tips, and play as soft joints: one class each."""
        kinds = {name.partition("@")[0] for name in self.findings.names}
        return Cause.of(
            tips=not kinds.isdisjoint(CONTACT_CLASS), joints=not kinds.isdisjoint(JOINT_CLASS)
        )

    @property
    def undecided(self) -> bool:
        """Whether a cause of the other class would do nearly as well in a named one's place."""
        found = self.findings
        for gain in found.taken:
            own = gain.name.partition("@")[0]
            (step,) = (s for s in found.tried if any(g is gain for g in s))
            close = {g.name.partition("@")[0] for g in step if gain.ahead_of(g) < CLOSE}
            for one, other in ((CONTACT_CLASS, JOINT_CLASS), (JOINT_CLASS, CONTACT_CLASS)):
                if own in one and not close.isdisjoint(other):
                    return True
        return False

    @property
    def word(self) -> str:
        """Right, wrong, or undecided."""
        if self.undecided:
            return "undecided"
        return "right" if self.cause is self.run.cause else "wrong"

    def document(self, model: RobotModel) -> dict[str, Any]:
        """As JSON can hold it."""
        found = self.findings
        return {
            "run": self.run.name,
            "channels": self.channels,
            "answer": self.cause.value,
            "truth": self.run.cause.value,
            "judged": self.word,
            "effects": [
                {
                    "name": name,
                    "value": model.placed[name].knob.value(z),
                    "unit": model.placed[name].parameter.unit,
                }
                for name, z in found.fit.settings
            ],
            "gains": [
                {"name": g.name, "nats": g.nats, "inflation": g.inflation, "held_out": g.held_out}
                for step in found.tried
                for g in step
            ],
            "seen_from": {
                s.name: model.placed[s.name].knob.value(s.floor_z)
                for s in found.screened
                if s.name in (*TIPS, *JOINTS) and math.isfinite(s.floor_z)
            },
            "alike": {name: dict(pairs) for name, pairs in found.alike.items()},
            "rms_mrad": [1e3 * found.rms_before_rad, 1e3 * found.rms_after_rad],
        }


def recordings_of(runs: Sequence[Run], count: int, folder: Path, say: Progress) -> list[Recording]:
    """So many recordings of every run, from the folder where they are there already."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for run in runs:
        for name, plan in run.walks[:count]:
            path = folder / f"{name}.parquet"
            if not path.exists():
                say(f"walking: {name}")
                write(record(run, plan, name), path)
            found.append(read(path))
    return found


def study(seed: int, out: Path, say: Progress) -> dict[str, Any]:
    """Run the study into a folder: recordings, key, result and figures. Returns the result.

    The result is written after each of :data:`CHANNELS`; steps that are done are kept.
    """
    out.mkdir(parents=True, exist_ok=True)
    runs = draw_runs(seed)
    key, digest = key_of(runs, seed)
    write_text(out / "key.sha256", f"{digest}  key.json\n")
    journal = Journal(out / FOLDER)
    result: dict[str, Any] = {
        "format": FORMAT,
        "seed": seed,
        "scene": SCENE,
        "key_sha256": digest,
        "score": {},
        "answers": [],
    }
    answers: list[Answer] = []
    for channels in CHANNELS:
        more, documents = _diagnosed(runs, channels, out, journal, say)
        answers += more
        result["score"][channels] = _score(more)
        result["answers"] += documents
        save(summary_figure(answers), out / "summary.png")
        write_json(out / "study.json", finite(result))
    write_text(out / "key.json", key)
    journal.finished()
    return result


def _diagnosed(
    runs: Sequence[Run], channels: str, out: Path, journal: Journal, say: Progress
) -> tuple[list[Answer], list[dict[str, Any]]]:
    """Every run from some channels; pictures from joints alone."""
    count, kinds = CHANNELS[channels]
    robot = load_robot(ROBOT)
    recordings = recordings_of(runs, count, out / "recordings", say)
    courses = [course(recording, robot) for recording in recordings]
    answers = []
    with RobotModel(read_model(robot), robot, courses, say, journal=journal) as model:
        for number, run in enumerate(runs):
            which = [count * number + k for k in range(count)]
            say(f"diagnosing {run.name} from {channels}")
            search = RobotSearch(model, which, kinds, say)
            answers.append(Answer(run, channels, search.run((*TIPS, *JOINTS, *RIVALS))))
            if channels == "joints":
                _draw(model, answers[-1], which[0], out)
        return answers, [answer.document(model) for answer in answers]


def _score(answers: Sequence[Answer]) -> dict[str, Any]:
    return {
        "right": sum(a.word == "right" for a in answers),
        "undecided": sum(a.undecided for a in answers),
        "wrong": sum(a.word == "wrong" for a in answers),
        "of": len(answers),
        "tips_right": sum(a.cause.tips == a.run.cause.tips for a in answers),
        "joints_right": sum(a.cause.joints == a.run.cause.joints for a in answers),
    }


def _draw(model: RobotModel, answer: Answer, r: int, out: Path) -> None:
    found = answer.findings
    for name, fit in (("before", found.base), ("after", found.fit)):
        model.recentre(fit.settings, fit.nuisances, [r])
        rows = model.modelled(fit.settings, fit.nuisances, r)[RobotKind.JOINTS]
        figure = joints_figure(model, r, rows, f"{answer.run.name}, model {name}")
        save(figure, out / f"{answer.run.name}-{name}.png")
