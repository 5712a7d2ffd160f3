"""Rubber tips, soft joints, both, or neither? Eight walks with stance errors, diagnosed.

The thesis's Marvin had systematic errors of femur and tibia while its feet stood, "most likely"
from compliance or from rubber tips, and left it open. Here eight robots on another engine have
either, both or none of them, beside all that is never as believed. Each walks three times, twice
under its own load and once under the other, and ``busemu diagnose`` is given the three recordings
of the joints' registers alone. Of a run that is undecided then how the trunk leans is given beside
them, by an inertial sensor; of one that is undecided still, the height of the trunk; and at last
walks with the tips off are diagnosed first.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.diagnosis.journal import FOLDER, Journal
from bench.diagnosis.report import Origin, write_report
from bench.diagnosis.robot.replay import HEIGHT
from bench.diagnosis.robot.running import run_robot
from bench.diagnosis.running import Split
from bench.diagnosis.watch import Watch
from bench.figures.style import save
from bench.files import finite, write_json, write_text
from bench.recording import Recording, read, write
from busemu.tables import Robot, load_robot

from .stance_figures import summary_figure
from .stance_page import write_page
from .stance_runs import BARE, IMU, SCENE, Cause, Run, draw_runs, key_of, only, record

Progress = Callable[[str], None]

FORMAT = "busemu-stance-study/2"
ROBOT = "marvin"
DIAGNOSIS = "diagnosis.json"
LAST = "the last that was asked"  #: of each run, in the score
CONTACT_CLASS = frozenset({"foot_compliance", "ground_compliance"})
JOINT_CLASS = frozenset({"joint_compliance", "backlash"})


@dataclass(frozen=True, slots=True)
class Part:
    """What a diagnosis is given beside the registers of the joints.

    ``beside`` are registers of other instruments. ``bare``: the robot walks with its tips off,
    too, and the walks with tips are diagnosed with the better model that comes of it.
    """

    name: str
    beside: frozenset[str] = frozenset()
    bare: bool = False

    @property
    def folder(self) -> str:
        """Of its diagnoses, within that of a run."""
        return self.name.replace(" ", "-")


JOINTS = Part("joints")
#: each is asked of runs that are undecided with the one before
PARTS = (
    JOINTS,
    Part("joints and inertial sensor", frozenset(IMU)),
    Part("joints and height", frozenset({HEIGHT})),
    Part("joints and tips off", bare=True),
)


@dataclass(frozen=True)
class Answer:
    """What a diagnosis said of one run: ``diagnosis.json``, as a document."""

    run: Run
    part: Part
    diagnosis: Mapping[str, Any]

    @cached_property
    def effects(self) -> frozenset[str]:
        """Names of what was found."""
        return frozenset(cause["effect"] for cause in self.diagnosis["causes"])

    @property
    def folder(self) -> str:
        """Where the diagnosis is, within that of the study."""
        return f"{self.run.name}/{self.part.folder}"

    @property
    def cause(self) -> Cause:
        """The answer: a soft ground counts as tips, and play as soft joints: one class each."""
        return Cause.of(
            tips=not self.effects.isdisjoint(CONTACT_CLASS),
            joints=not self.effects.isdisjoint(JOINT_CLASS),
        )

    @property
    def undecided(self) -> bool:
        """Whether it says that it cannot tell.

        So it does of a misfit without a name, and where a cause of the other class might as well be
        in the place of one that is named, unless that has a name of its own.
        """
        if self.diagnosis["verdict"] == "unexplained":
            return True
        for cause in self.diagnosis["causes"]:
            rivals = {rival["effect"] for rival in cause["indistinguishable_from"]}
            for own, other in ((CONTACT_CLASS, JOINT_CLASS), (JOINT_CLASS, CONTACT_CLASS)):
                if cause["effect"] in own and rivals & other and not self.effects & other:
                    return True
        return False

    @property
    def word(self) -> str:
        """Right, wrong, or undecided. What is named beside tips and joints is hidden in none."""
        if self.undecided:
            return "undecided"
        alarm = self.effects - CONTACT_CLASS - JOINT_CLASS
        return "right" if self.cause is self.run.cause and not alarm else "wrong"

    def document(self) -> dict[str, Any]:
        """As ``study.json`` has it."""
        return {
            "run": self.run.name,
            "part": self.part.name,
            "answer": self.cause.value,
            "truth": self.run.cause.value,
            "judged": self.word,
            **{key: self.diagnosis[key] for key in ("verdict", "causes", "fit", "next_experiment")},
        }


def study(seed: int, out: Path, say: Progress) -> dict[str, Any]:
    """Run the study into a folder. Returns the result, as ``study.json`` has it.

    The folder gets ``key.sha256`` before anything is diagnosed; for every run and part what
    ``busemu diagnose`` leaves; ``study.json``, ``index.html`` and ``summary.png``, renewed after
    each diagnosis; and in the end ``key.json``. Diagnoses that are there are not made again, and
    one that was stopped goes on.
    """
    out.mkdir(parents=True, exist_ok=True)
    runs = draw_runs(seed)
    key, digest = key_of(runs, seed)
    write_text(out / "key.sha256", f"{digest}  key.json\n")
    answers: list[Answer] = []
    result: dict[str, Any] = {}
    for answer in _answered(runs, out, say):
        answers.append(answer)
        result = {
            "format": FORMAT,
            "seed": seed,
            "scene": SCENE,
            "key_sha256": digest,
            "score": {
                **{part.name: scored([a for a in answers if a.part is part]) for part in PARTS},
                LAST: scored(list({a.run.name: a for a in answers}.values())),
            },
            "answers": [a.document() for a in answers],
        }
        save(summary_figure(answers), out / "summary.png")
        write_page(out, answers, result)
        write_json(out / "study.json", finite(result))
    write_text(out / "key.json", key)
    return result


def _answered(runs: Sequence[Run], out: Path, say: Progress) -> Iterator[Answer]:
    latest: dict[str, Answer] = {}
    for part in PARTS:
        for run in runs:
            if run.name in latest and not latest[run.name].undecided:
                continue
            latest[run.name] = Answer(run, part, _diagnosed(run, part, out / run.name, say))
            yield latest[run.name]


def _diagnosed(run: Run, part: Part, folder: Path, say: Progress) -> Mapping[str, Any]:
    """What is said of a run with what a part gives."""
    own, robot, told = folder / part.folder, load_robot(ROBOT), f"{run.name} from {part.name}"
    if not part.bare:
        recordings = recordings_of(run, folder / "walks", say)
        return diagnosis(robot, [only(r, part.beside) for r in recordings], own, told, say)
    without = [only(r, ()) for r in recordings_of(run, folder / "walks", say, bare=True)]
    bare = diagnosis(robot, without, folder / BARE, f"{told}, off", say)
    better = load_robot(folder / BARE / "model.toml")
    recordings = [only(r, ()) for r in recordings_of(run, folder / "walks", say)]
    found = diagnosis(better, recordings, own, f"{told}, on", say)
    return {**found, "causes": [*bare["causes"], *found["causes"]]}


def recordings_of(run: Run, folder: Path, say: Progress, *, bare: bool = False) -> list[Recording]:
    """The recordings of a run, from the folder where they are there already."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for name, plan in run.walks(bare=bare):
        path = folder / f"{name}.parquet"
        if not path.exists():
            say(f"walking: {name}")
            write(record(run, plan, name, bare=bare), path)
        found.append(read(path))
    return found


def diagnosis(
    robot: Robot, recordings: Sequence[Recording], folder: Path, title: str, say: Progress
) -> dict[str, Any]:
    """What ``busemu diagnose`` says with the last recording held out, and leaves in a folder.

    A diagnosis that is there is not made again.
    """
    if not (folder / DIAGNOSIS).exists():
        _diagnose(robot, recordings, folder, title, say)
    try:
        told: dict[str, Any] = json.loads((folder / DIAGNOSIS).read_text("utf-8"))
    except ValueError as error:
        raise ValueError(
            f"{folder / DIAGNOSIS}: {error}: delete it, and it is made again"
        ) from None
    return told


def _diagnose(
    robot: Robot, recordings: Sequence[Recording], folder: Path, title: str, say: Progress
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    journal = Journal(folder / FOLDER)
    parts = Split(tuple(recordings[:-1]), tuple(recordings[-1:]))
    on = date.today()
    watch = Watch(lambda stage: say(f"{title}: {stage}"))
    answers = run_robot(robot, parts, folder, on, watch=watch, journal=journal)
    model = str(folder / "model.toml")
    origin = Origin(robot.name, title, answers.fitted, (), 0, on, model)
    write_report(folder / "report.html", answers.diagnosis, answers.traces, origin)
    journal.finished()


def scored(answers: Sequence[Answer]) -> dict[str, int]:
    """How many answers are right, undecided and wrong, and right about tips and about joints."""
    words = [answer.word for answer in answers]
    return {
        **{word: words.count(word) for word in ("right", "undecided", "wrong")},
        "of": len(answers),
        "tips_right": sum(a.cause.tips == a.run.cause.tips for a in answers),
        "joints_right": sum(a.cause.joints == a.run.cause.joints for a in answers),
    }
